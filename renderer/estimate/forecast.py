"""When will the target be reached? From error² × samples, which is constant for Monte Carlo, and the pace of late.

What stops a render is the upper bound of its error. Its logarithm over that of the error falls like 1/√samples, so the
bound comes down faster than the error does; a bound far above the error says that tails have not shown yet, and that
nothing can be foretold. The error itself is underestimated by some 0.6/samples at first, because a pixel's bright
values make its mean large as well. Targets are looked at between rounds only: a render ends half a round late, in the
mean. `python -m tests.coverage_study stopping` measures what forecasts are worth.

Enters: the curve of error over time so far. Leaves: the seconds left and an interval, or None while it is not worth
showing: until all pixels have a variance, and while the constant still drifts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

MIN_POINTS = 2  # for the pace
EARLY = 0.6  # of the logarithm of the error that is not seen yet, times the samples
MAX_DRIFT = 0.35  # of the logarithm of the samples foretold, over the points used; more is no forecast
MAX_CAUTION = 1.65  # the bound over the error; beyond, it is the tail that will decide
OVERSHOOT = 1.075  # half of what a round adds
MIN_SPREAD = 0.05  # of the logarithm of the samples,
DOUBT = 0.4  # and this share of that of the bound over the error
ADAPTING = 1.2  # times fewer samples that adaptive rounds will need, in the middle of what was measured,
ADAPTING_SPREAD = 0.3  # and how much the logarithm of that varies between scenes
Z95 = 1.96


@dataclass(frozen=True, slots=True)
class CurvePoint:
    """One point of the convergence curve. upper: confidence bound of the error, None where there is none yet."""

    seconds: float
    spp: float
    error: float
    upper: float | None = None


@dataclass(frozen=True, slots=True)
class Curve:
    """Error over time of one estimate, carried on with it. region: whose error it is, "" for the whole image.
    confidence: of the bounds.
    """

    region: str = ""
    confidence: float = 0.95
    points: tuple[CurvePoint, ...] = ()

    def about(self, region: str, confidence: float) -> Curve:
        """What it says to another question: nothing of another region, and no bounds of another confidence."""
        if region != self.region:
            return Curve(region, confidence)
        points = self.points
        if confidence != self.confidence:
            points = tuple(replace(point, upper=None) for point in points)
        return Curve(region, confidence, points)

    def extended(self, point: CurvePoint) -> Curve:
        """With one more point."""
        return replace(self, points=(*self.points, point))

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for files."""
        points = [[p.seconds, p.spp, p.error, p.upper] for p in self.points]
        return {"region": self.region, "confidence": self.confidence, "points": points}

    @classmethod
    def of(cls, kept: dict[str, Any]) -> Curve:
        """From plain values."""
        return cls(kept["region"], kept["confidence"], tuple(CurvePoint(*point) for point in kept["points"]))


@dataclass(frozen=True, slots=True)
class Forecast:
    """Seconds of render time until the target error, with a 95 % interval."""

    seconds_left: float
    low: float
    high: float


def forecast(curve: Sequence[CurvePoint], target: float, is_level_so_far: bool = False) -> Forecast | None:
    """Seconds left until the bound of the error falls to `target`; None while that is not known. is_level_so_far:
    whether rounds will be adaptive and have not been yet: the curve knows nothing of what that saves."""
    known = [p for p in curve if p.upper is not None and p.error > 0 and p.spp > 0]
    if len(curve) < MIN_POINTS or not known or _caution(known[-1]) > MAX_CAUTION:
        return None
    recent = known[len(known) // 2 :]
    logs = [math.log(_samples(p, target)) for p in recent]
    if max(logs) - min(logs) > MAX_DRIFT:
        return None
    # The latest point knows most; the ones before it tell how far to believe it.
    centre, last = logs[-1], recent[-1]
    spread = math.sqrt(sum((x - centre) ** 2 for x in logs) / max(len(logs) - 1, 1))
    first = curve[len(curve) // 2 - 1]
    pace = (last.seconds - first.seconds) / (last.spp - first.spp) if last.spp > first.spp else last.seconds / last.spp

    def left(log_samples: float) -> float:
        samples = math.exp(log_samples)
        return pace * (OVERSHOOT * samples - last.spp) if samples > last.spp else 0.0

    margin = Z95 * max(spread, MIN_SPREAD + DOUBT * math.log(_caution(last)))
    if is_level_so_far:
        centre -= math.log(ADAPTING)
        margin = math.hypot(margin, ADAPTING_SPREAD)
    return Forecast(left(centre), left(centre - margin), left(centre + margin))


def _caution(point: CurvePoint) -> float:
    """The bound over the error, at least 1."""
    return max(1.0, (point.upper or 0.0) / point.error)


def _samples(point: CurvePoint, target: float) -> float:
    """Samples per pixel at which the bound will have come down to the target."""
    # In logarithms: samples = of_error + unseen · (1 − now / samples) + excess · √(now / samples).
    now = math.log(point.spp)
    of_error = now + 2 * math.log(point.error / target)
    unseen, excess = 2 * EARLY / point.spp, 2 * math.log(_caution(point))
    low, high = of_error, of_error + unseen + excess
    if of_error + excess <= now:
        return math.exp(min(high, now))
    for _ in range(50):
        middle = 0.5 * (low + high)
        share = math.exp(min(0.0, now - middle))
        is_later = of_error + unseen * (1 - share) + excess * math.sqrt(share) > middle
        low, high = (middle, high) if is_later else (low, middle)
    return math.exp(high)
