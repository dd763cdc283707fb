"""When a render stops, and why. Pure: nothing is rendered here, and no clock is read.

Enters: a target, the replicates and seconds so far, and the moments, with what an audit says is missing in them.
Leaves: a reason, or none. The first limit reached wins. What decides about an error target is the bound of the image
error (`ImageError.upper`), not its estimate; about a share of the pixels, the share's own lower bound.

Looking often would find a favourable moment: an error is judged at checkpoints alone, which grow apart, or at the ends
of adaptive rounds, which do too; `estimate.error.LOOKS` pays for those looks.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from renderer.estimate.correlation import INDEPENDENT, Correlation
from renderer.estimate.error import NOTHING_MISSING, ImageError, Missing, image_error
from renderer.estimate.moments import Moments
from renderer.settings import DEFAULT_CONFIDENCE, Target

Reason = Literal["error", "seconds", "spp", "interrupted"]

MIN_REPLICATES_TO_STOP = 4  # before an error target can be believed
CHECKPOINT_GROWTH = 1.15  # of replicates from one look at the error to the next: at checkpoints, at ends of rounds


@dataclass(frozen=True, slots=True, eq=False)
class StopRule:
    """The rule of one render. width: of the image. replicate_size: samples in a replicate. scope: (n,) pixels whose
    error counts, None for all. is_adaptive: counts may differ by plan. correlation: of neighbouring pixels.
    """

    target: Target
    width: int
    replicate_size: int
    scope: NDArray[np.bool_] | None
    is_adaptive: bool
    correlation: Correlation = INDEPENDENT

    @property
    def replicates_wanted(self) -> int | None:
        """Replicates per pixel that the target's spp asks for, in the mean."""
        return None if self.target.spp is None else -(-self.target.spp // self.replicate_size)

    @property
    def question(self) -> tuple[str, float]:
        """What a convergence curve to this target is about: the region, "" for the whole image, and the confidence."""
        region = self.target.region
        return "" if region is None else region.name, self.target.confidence or DEFAULT_CONFIDENCE

    def is_time_over(self, seconds: float) -> bool:
        """Whether the target's time is used up."""
        return self.target.seconds is not None and seconds >= self.target.seconds

    def limit_reached(self, tried: NDArray[np.int64], seconds: float) -> Reason | None:
        """The limit of samples or time that is reached, if one is. tried: (n,) replicates of each pixel."""
        wanted = self.replicates_wanted
        if wanted is not None and int(tried.sum()) >= wanted * len(tried):
            return "spp"
        return "seconds" if self.is_time_over(seconds) else None

    def is_look(self, tried: NDArray[np.int64], is_round_over: bool) -> bool:
        """Whether the error may be judged now. is_round_over: every pixel has what was planned for it."""
        low = int(tried.min())
        if self.target.error is None or low < MIN_REPLICATES_TO_STOP:
            return False
        return is_checkpoint(low) if low == int(tried.max()) else self.is_adaptive and is_round_over

    def error(self, moments: Moments, missing: Missing = NOTHING_MISSING) -> ImageError:
        """The error of the image, or of the target's region, with the bound that the target's confidence asks for.

        missing: what was not met by any sample so far, and is in the error all the same.
        """
        return image_error(
            moments,
            self.width,
            self.target.error,
            confidence=self.question[1],
            scope=self.scope,
            missing=missing,
            correlation=self.correlation,
        )

    def is_reached(self, found: ImageError) -> bool:
        """Whether the error asked for is reached: no bound counts while the error itself cannot be said."""
        if self.target.error is None or found.error is None:
            return False
        if self.target.share is not None:
            return found.share_lower is not None and found.share_lower >= self.target.share
        return found.upper is not None and found.upper <= self.target.error


def next_checkpoint(replicates: int) -> int:
    """The next number of replicates at which a target may be checked: few, so that looking does not fool it."""
    checkpoint = MIN_REPLICATES_TO_STOP
    while checkpoint <= replicates:
        checkpoint = max(checkpoint + 1, int(checkpoint * CHECKPOINT_GROWTH))
    return checkpoint


def is_checkpoint(replicates: int) -> bool:
    """Whether a target may be checked at this number of replicates."""
    return replicates >= MIN_REPLICATES_TO_STOP and next_checkpoint(replicates - 1) == replicates
