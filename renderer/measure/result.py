"""What was measured, and what follows from it. Pure arithmetic: nothing is rendered here.

Squared error times seconds is a constant of a setting (its "variance × time"); efficiency is its reciprocal. From it
follows the time to any target, and which setting is best for a budget. A shallower depth leaves light out: its error
does not fall below that, so it wins only where time is short, and is always named.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderer.estimate.interval import t_quantile
from renderer.measure.candidates import Candidate

Z95 = 1.96
LATER = 1 / 8  # of the time, from which on a start no longer bends the curve
LEAST_STRETCHES, MOST_STRETCHES = 4, 8  # of a curve, from which its scatter is read
TARGETS = (0.10, 0.05, 0.02, 0.01)
BUDGETS = (1.0, 10.0, 60.0, 600.0)
# Below both of these an error is a lower bound at best. Few replicates alone are no reason: that is a short run.
MIN_TRUSTED = 0.5  # of the pixels
MIN_FOUND = 0.9  # of the lit pixels have found light often


@dataclass(frozen=True, slots=True)
class Point:
    """One point of a curve. error: relative image error, with a 95 % interval. true_error: against the reference."""

    seconds: float
    spp: float
    error: float
    low: float
    high: float
    true_error: float | None = None


@dataclass(frozen=True, slots=True)
class TimeTo:
    """Seconds to a target error. is_measured: the run got there; else it is a forecast from variance × time."""

    target: float
    seconds: float
    is_measured: bool


@dataclass(frozen=True, slots=True)
class Row:
    """One setting. curve: error over render time. lost_light: share of the light that a shallower depth leaves out,
    and lost_rel_mse what that does to the squared error; both 0 for settings that leave nothing out.
    """

    candidate: Candidate
    curve: tuple[Point, ...]
    samples: int
    seconds: float
    share_trusted: float
    share_found: float
    invalid: int
    lost_light: float = 0.0
    lost_rel_mse: float = 0.0

    @property
    def name(self) -> str:
        """Of the setting."""
        return self.candidate.name

    @property
    def last(self) -> Point | None:
        """The end of the curve; None where no light was found."""
        return self.curve[-1] if self.curve else None

    @property
    def is_trusted(self) -> bool:
        """Whether most pixels' intervals can be believed; else the true error may be far larger."""
        return self.share_trusted >= MIN_TRUSTED or self.share_found >= MIN_FOUND

    @property
    def samples_per_second(self) -> float:
        """Camera paths per second of render time."""
        return self.samples / self.seconds if self.seconds > 0 else math.nan

    @property
    def variance_time(self) -> float:
        """Squared relative error × seconds; infinite where no light was found."""
        return math.inf if self.last is None else self.last.error**2 * self.last.seconds

    @property
    def log_spread(self) -> float | None:
        """Standard error of the logarithm of variance × time; None where the run was too short or cannot be trusted.

        From how evenly work, 1 / error², grew over the stretches of the curve's later part (the jackknife), where both
        noise and a machine that was not always equally fast show; and from how well the last error is known.
        """
        stretches = _stretches(self.curve)
        if not self.is_trusted or self.last is None or stretches is None:
            return None
        seconds, work = stretches
        rate, m = work.sum() / seconds.sum(), len(seconds)
        if rate <= 0 or self.last.low <= 0:
            return None
        of_rate = math.sqrt(float(np.square(work - rate * seconds).sum()) * m / (m - 1)) / work.sum()
        of_error = math.log(self.last.high / self.last.low) / (2 * Z95)
        return math.hypot(of_rate, 2 * of_error)

    @property
    def log_reach(self) -> float | None:
        """Half-width of the 95 % interval of the logarithm of variance × time; None where log_spread is."""
        if self.log_spread is None:
            return None
        degrees = min(LEAST_STRETCHES, len(self.curve) - 1)
        return float(t_quantile(0.975, degrees)) * self.log_spread

    def time_interval(self, target: float) -> tuple[float, float] | None:
        """95 % interval of the time to a target; None where there is no such time, or too little is known of it. Light
        that a shallower depth leaves out counts as known."""
        found, reach = self.time_to(target), self.log_reach
        if found is None or reach is None:
            return None
        return found.seconds * math.exp(-reach), found.seconds * math.exp(reach)

    @property
    def efficiency(self) -> float:
        """1 / (variance × seconds)."""
        return 1 / self.variance_time if self.variance_time > 0 else math.inf

    def error_after(self, seconds: float) -> float:
        """Expected relative error after a time, light that is left out included."""
        return math.sqrt(self.variance_time / seconds + self.lost_rel_mse)

    def time_to(self, target: float) -> TimeTo | None:
        """When the error is below a target; None where light that is left out forbids it."""
        for before, after in zip((None, *self.curve), self.curve, strict=False):
            if after.error <= target:
                return TimeTo(target, _crossing(before, after, target), True)
        room = target**2 - self.lost_rel_mse
        if not math.isfinite(self.variance_time) or room <= 0:
            return None
        return TimeTo(target, self.variance_time / room, False)


@dataclass(frozen=True, slots=True)
class Measurement:
    """All settings of one scene, the default first. reference: name of the file that true errors are against.

    full_size: pixels of the scene's own image over those measured; its times are that much longer.
    """

    scene: str
    digest: str
    width: int
    height: int
    seconds: float
    rows: tuple[Row, ...]
    reference: str | None = None
    full_size: float = 1.0

    @property
    def default(self) -> Row:
        """What the others are compared with."""
        return self.rows[0]

    def relative_efficiency(self, row: Row) -> float:
        """Efficiency as a multiple of the default's."""
        return row.efficiency / self.default.efficiency if self.default.last else math.nan

    def efficiency_interval(self, row: Row) -> tuple[float, float] | None:
        """95 % interval of the relative efficiency; None where too little is known of one of the two."""
        if row is self.default or row.log_spread is None or self.default.log_spread is None:
            return None
        degrees = min(LEAST_STRETCHES, len(row.curve) - 1, len(self.default.curve) - 1)
        reach = float(t_quantile(0.975, degrees)) * math.hypot(row.log_spread, self.default.log_spread)
        ratio = self.relative_efficiency(row)
        return ratio * math.exp(-reach), ratio * math.exp(reach)

    def recommended(self, budget: float, allow_lost_light: bool = False) -> Row | None:
        """The setting with the lowest expected error after `budget` seconds; None where none found any light.

        Only trusted ones, and none that leaves light out unless that is allowed. The default stays unless another is
        better by more than a measurement like this can be wrong.
        """
        usable = [r for r in self.rows if r.last and r.is_trusted and (allow_lost_light or not r.candidate.is_biased)]
        if not usable:
            return self.default if self.default.last else None
        best = min(usable, key=lambda r: r.error_after(budget))
        is_clear = best.error_after(budget) < 0.95 * self.default.error_after(budget)
        return best if is_clear or self.default not in usable else self.default

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for JSON: infinite or unknown numbers are None."""
        return {
            "scene": self.scene,
            "scene_digest": self.digest,
            "width": self.width,
            "height": self.height,
            "seconds": self.seconds,
            "reference": self.reference,
            "full_size": self.full_size,
            "settings": [self._row(row) for row in self.rows],
            "recommended": [self._recommendation(budget) for budget in BUDGETS],
        }

    def _row(self, row: Row) -> dict[str, Any]:
        last = row.last
        times = {t: row.time_to(t) for t in TARGETS}
        return {
            "name": row.name,
            "group": row.candidate.group,
            "settings": row.candidate.settings.as_dict(),
            "samples": row.samples,
            "seconds": row.seconds,
            "samples_per_second": row.samples_per_second,
            "error": None if last is None else last.error,
            "error_interval": None if last is None else [last.low, last.high],
            "true_error": None if last is None else last.true_error,
            "variance_time": row.variance_time if last else None,
            "efficiency": row.efficiency if last else None,
            "relative_efficiency": self.relative_efficiency(row) if last and self.default.last else None,
            "relative_efficiency_interval": self.efficiency_interval(row),
            "share_trusted": row.share_trusted,
            "invalid": row.invalid,
            "lost_light": row.lost_light,
            "time_to": [
                {"target": t, "seconds": found and found.seconds, "measured": bool(found and found.is_measured)}
                for t, found in times.items()
            ],
            "curve": [asdict(point) for point in row.curve],
        }

    def _recommendation(self, budget: float) -> dict[str, Any]:
        best, shallow = self.recommended(budget), self.recommended(budget, allow_lost_light=True)
        return {
            "budget_seconds": budget,
            "name": best and best.name,
            "expected_error": best and best.error_after(budget),
            "if_light_may_be_lost": None if shallow is None or shallow is best else shallow.name,
        }


def _stretches(curve: tuple[Point, ...]) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Seconds and work of a few stretches of the curve's later part; None where there are too few points."""
    later = [point for point in curve if point.seconds >= LATER * curve[-1].seconds and point.error > 0]
    points = later if len(later) > LEAST_STRETCHES else [point for point in curve if point.error > 0]
    if len(points) <= LEAST_STRETCHES:
        return None
    n = min(len(points) - 1, MOST_STRETCHES)
    ends = [points[round(i * (len(points) - 1) / n)] for i in range(n + 1)]
    return np.diff([end.seconds for end in ends]), np.diff([1 / end.error**2 for end in ends])


def _crossing(before: Point | None, after: Point, target: float) -> float:
    """Seconds at which the straight line between two points, in logarithms, meets the target."""
    if before is None or before.error <= after.error:
        return after.seconds
    share = math.log(before.error / target) / math.log(before.error / after.error)
    return before.seconds * (after.seconds / before.seconds) ** share
