"""When will the target be reached? From error² × time, which is constant for Monte Carlo.

Enters: the curve of error over time so far. Leaves: the seconds left and an interval, or None while it is not worth
showing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

MIN_POINTS = 4
Z95 = 1.96


@dataclass(frozen=True, slots=True)
class CurvePoint:
    """One point of the convergence curve."""

    seconds: float
    spp: float
    error: float


@dataclass(frozen=True, slots=True)
class Forecast:
    """Seconds of render time until the target error, with a 95 % interval."""

    seconds_left: float
    low: float
    high: float


def forecast(curve: Sequence[CurvePoint], target: float) -> Forecast | None:
    """Seconds left until `target`, from the later half of the curve; None while fewer than four points are known."""
    if len(curve) < MIN_POINTS:
        return None
    recent = curve[len(curve) // 2 :]
    logs = [math.log(p.error**2 * p.seconds) for p in recent if p.error > 0 and p.seconds > 0]
    if len(logs) < 2:
        return None
    centre = sum(logs) / len(logs)
    spread = math.sqrt(sum((x - centre) ** 2 for x in logs) / (len(logs) - 1))
    now = curve[-1].seconds

    def left(log_constant: float) -> float:
        return max(0.0, math.exp(log_constant) / target**2 - now)

    margin = Z95 * max(spread, 0.02)
    return Forecast(left(centre), left(centre - margin), left(centre + margin))
