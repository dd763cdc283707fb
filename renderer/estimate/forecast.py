"""When will the target be reached? From error² × samples, which is constant for Monte Carlo, and the pace of late.

Enters: the curve of error over time so far. Leaves: the seconds left and an interval, or None while it is not worth
showing: early on, heavy tails have not shown yet, and the constant still drifts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

MIN_POINTS = 4
MAX_DRIFT = 0.35  # of the constant over the points used; more is no forecast
MIN_SPREAD = 0.05
Z95 = 1.96


@dataclass(frozen=True, slots=True)
class CurvePoint:
    """One point of the convergence curve. upper: confidence bound of the error, None where there is none yet."""

    seconds: float
    spp: float
    error: float
    upper: float | None = None


@dataclass(frozen=True, slots=True)
class Forecast:
    """Seconds of render time until the target error, with a 95 % interval."""

    seconds_left: float
    low: float
    high: float


def forecast(curve: Sequence[CurvePoint], target: float) -> Forecast | None:
    """Seconds left until the bound of the error falls to `target`; None while that is not known."""
    if len(curve) < MIN_POINTS:
        return None
    recent = [p for p in curve[len(curve) // 2 :] if _stops(p) > 0 and p.spp > 0]
    if len(recent) < 2:
        return None
    logs = [math.log(_stops(p) ** 2 * p.spp) for p in recent]
    if max(logs) - min(logs) > MAX_DRIFT:
        return None
    # The latest point knows most; the one before it damps the noise of its tail.
    centre = logs[-1]
    spread = math.sqrt(sum((x - centre) ** 2 for x in logs) / (len(logs) - 1))
    first, last = recent[0], recent[-1]
    pace = (last.seconds - first.seconds) / (last.spp - first.spp) if last.spp > first.spp else last.seconds / last.spp

    def left(log_constant: float) -> float:
        return max(0.0, pace * (math.exp(log_constant) / target**2 - last.spp))

    margin = Z95 * max(spread, MIN_SPREAD)
    return Forecast(left(centre), left(centre - margin), left(centre + margin))


def _stops(point: CurvePoint) -> float:
    return point.error if point.upper is None else point.upper
