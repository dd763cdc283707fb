"""What a render carries on from pass to pass, and what of it a file keeps.

All else in a render (speeds, what is in flight, when the last snapshot was) is only its pace: with this state alone it
goes on as if nothing had happened, to the bit.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from renderer.estimate.error import NOTHING_MISSING, ImageError, Missing
from renderer.estimate.estimate import Estimate, Identity
from renderer.estimate.forecast import Curve, CurvePoint
from renderer.estimate.moments import Moments

CURVE_GROWTH = 1.1  # of the time between two points of the curve


@dataclass(slots=True)
class RenderState:
    """moments: of all pixels. planned: (n,) replicates at the end of the round in progress, None where all are served
    alike. seconds: of rendering so far. curve: error over that time. channels: see `Estimate`. missing: light that no
    sample has met, in every error that is said or judged. look: see `Estimate`; it is not saved.
    """

    identity: Identity
    moments: Moments
    planned: NDArray[np.int64] | None = None
    seconds: float = 0.0
    curve: Curve = field(default_factory=Curve)
    channels: dict[str, NDArray[np.float32]] = field(default_factory=dict)
    missing: Missing = NOTHING_MISSING
    look: NDArray[np.float32] | None = None
    is_shown: bool = False  # a snapshot holds the moments: they are copied before they change

    @classmethod
    def begun(
        cls, identity: Identity, empty: Moments, start: Estimate | None, region: str, confidence: float
    ) -> RenderState:
        """From nothing, or from an estimate. region, confidence: what the curve shall be about."""
        if start is None:
            return cls(identity, empty, curve=Curve(region, confidence))
        return cls(
            identity.also_with(start.identity),
            start.moments.copy(),
            start.planned,
            start.seconds,
            start.curve.about(region, confidence),
            dict(start.channels),
        )

    @property
    def is_round_over(self) -> bool:
        """Whether every pixel has what was planned for it."""
        return self.planned is None or bool((self.moments.tried >= self.planned).all())

    def own_moments(self) -> Moments:
        """The moments, to be changed: apart from those that a snapshot holds."""
        if self.is_shown:
            self.moments, self.is_shown = self.moments.copy(), False
        return self.moments

    def add_look(self, pixels: NDArray[np.integer], radiance: NDArray) -> None:
        """What stands for some pixels (k,) in a first picture: radiance (k, 3), or more."""
        n = len(self.moments.tried)
        self.look = np.full((n, 3), np.nan, np.float32) if self.look is None else self.look.copy()
        self.look[pixels] = radiance[:, :3]

    def extend_curve(self, found: ImageError, replicate_size: int) -> None:
        """Adds a point, unless hardly any time has passed since the last one."""
        points = self.curve.points
        if found.error is None or (points and self.seconds < points[-1].seconds * CURVE_GROWTH):
            return
        spp = float(self.moments.count.mean()) * replicate_size
        self.curve = self.curve.extended(CurvePoint(self.seconds, spp, found.error, found.upper))

    def estimate(self, width: int, height: int, replicate_size: int, notes: dict[str, list[str]]) -> Estimate:
        """What there is, as a value."""
        self.is_shown = True
        return Estimate(
            width=width,
            height=height,
            replicate_size=replicate_size,
            moments=self.moments,
            identity=self.identity,
            seconds=self.seconds,
            ranges=((self.identity.seed, int(self.moments.tried.max())),),
            planned=None if self.is_round_over else self.planned,
            channels=dict(self.channels),
            curve=self.curve,
            look=self.look if int(self.moments.tried.min()) == 0 else None,
            notes=notes,
        )
