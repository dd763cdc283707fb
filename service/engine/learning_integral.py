"""Runs inside a render process: Monte Carlo in one dimension, for the Learn view. Plain values in and out."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from service.engine.turn import Failure
from service.engine.worker import failure_of

_CURVE = 257  # places at which f and p are told


@dataclass(frozen=True, slots=True)
class Unfit:
    """What was asked is no integral that can be estimated, and why."""

    why: str


def estimate(
    f: str, a: float, b: float, density: str, n: int, seed: int, shown: int
) -> dict[str, Any] | Unfit | Failure:
    """One estimate from n points, the first `shown` of them, the integrand and the density."""
    from renderer.errors import SettingsError
    from renderer.lesson.one_dimension import Problem

    try:
        problem = Problem(f, a, b, density)
        estimate = problem.estimate(n, seed)
        low, high = estimate.interval() if n > 1 else (math.nan, math.nan)
        truth, truth_error = problem.truth
        x = np.linspace(a, b, _CURVE)
        points = problem.points(min(n, shown), seed)
        return {
            "value": estimate.value,
            "n": estimate.n,
            "variance": _known(estimate.variance),
            "standard_error": _known(estimate.standard_error),
            "low": _known(low),
            "high": _known(high),
            "truth": truth,
            "truth_error": truth_error,
            "conditions": asdict(problem.conditions) | {"mass": _known(problem.conditions.mass)},
            "curve": {"x": _numbers(x), "f": _numbers(problem.f(x)), "p": _numbers(problem.pdf(x))},
            "points": dict(zip(("x", "f", "p"), map(_numbers, points), strict=True)),
        }
    except SettingsError as error:
        return Unfit(str(error))
    except Exception as error:
        return failure_of(error)


def runs(f: str, a: float, b: float, density: str, n: int, count: int) -> dict[str, Any] | Unfit | Failure:
    """Estimates of many runs for ever more points."""
    from renderer.errors import SettingsError
    from renderer.lesson.one_dimension import Problem

    try:
        problem = Problem(f, a, b, density)
        counts, values = problem.runs(n, count)
        return {"counts": counts, "values": values.tolist(), "truth": problem.truth[0]}
    except SettingsError as error:
        return Unfit(str(error))
    except Exception as error:
        return failure_of(error)


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _numbers(values: Any) -> list[float | None]:
    return [_known(float(value)) for value in values]
