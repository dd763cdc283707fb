"""Weights that combine techniques. Source: Veach 1997, sections 9.2 and 10.2."""

from __future__ import annotations

from typing import Any

import drjit as dr


def power_heuristic(pdf: Any, pdf_other: Any) -> Any:
    """Weight of a sample drawn with `pdf` that `pdf_other` could have drawn too (power heuristic, exponent 2).

    In ratio form, 1 / (1 + (b/a)²): the textbook form a²/(a² + b²) is inf/inf beyond 1e19, as for a small light far
    away. A sample that was drawn has pdf > 0; where pdf is 0 the weight is 0.
    """
    ratio = pdf_other / pdf
    return dr.select(pdf > 0, dr.rcp(1 + dr.square(ratio)), 0)
