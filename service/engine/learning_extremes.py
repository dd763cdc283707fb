"""Runs inside a render process: numbers at the edge of float32 for the Learn view. Plain values in and out."""

from __future__ import annotations

import math
from typing import Any

from service.engine.turn import Failure
from service.engine.worker import failure_of


def rung(name: str, k: int) -> dict[str, Any] | Failure:
    """One place on the ladder of an extreme."""
    try:
        from renderer.lesson import extremes

        found = extremes.rung(name, k)
        is_number = math.isfinite(found.naive)
        return {
            "at": found.at,
            "exact": found.exact,
            "naive": found.naive if is_number else None,
            "ours": found.ours,
            "half": found.half,
            "places": len(extremes.LADDERS[name][1]),
        }
    except Exception as error:
        return failure_of(error)
