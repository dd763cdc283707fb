"""Reconstruction filters by importance sampling: every sample belongs to one pixel, so pixel errors are independent.
Where samples are shared instead, see `film`.

Enters: Mitsuba's reconstruction filter. Leaves: an offset of the sample from the pixel's corner, drawn in proportion to
|filter|, and a weight (1 for positive filters, ± a constant where the filter has negative lobes).
Source: Ernst, Stamminger & Greiner 2006, "Filter importance sampling".
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np

CELLS = 1024  # of the tabulated profile; the density is constant within a cell


class PixelFilter:
    """Draws sample positions for a separable filter given by its 1-D profile."""

    def __init__(self, mi: Any, rfilter: Any) -> None:
        self.mi = mi
        self.is_box = rfilter.is_box_filter()
        if self.is_box:
            return
        radius = float(rfilter.radius())
        centres = (np.arange(CELLS) + 0.5) / CELLS * 2 * radius - radius
        profile = np.array(rfilter.eval(mi.Float(centres.astype(np.float32))), dtype=np.float64)
        mass = np.abs(profile)
        self.radius = radius
        self.cumulative = mi.Float(np.concatenate([[0.0], np.cumsum(mass) / mass.sum()]).astype(np.float32))
        self.has_negative_lobes = bool((profile < 0).any())
        self.sign = mi.Float(np.sign(profile).astype(np.float32))
        self.scale = float(mass.sum() / profile.sum())  # 1 for positive filters
        dr.eval(self.cumulative, self.sign)

    def sample(self, u: Any) -> tuple[Any, Any]:
        """Offset from the pixel's upper left corner (Point2f) and weight (Float) for u in [0,1)²."""
        mi = self.mi
        if self.is_box:
            return mi.Point2f(u), mi.Float(1)
        x, weight_x = self._axis(u.x)
        y, weight_y = self._axis(u.y)
        return mi.Point2f(x, y), weight_x * weight_y

    def _axis(self, u: Any) -> tuple[Any, Any]:
        mi = self.mi
        cell = dr.binary_search(0, CELLS - 1, lambda i: dr.gather(mi.Float, self.cumulative, i + 1) <= u)
        low = dr.gather(mi.Float, self.cumulative, cell)
        high = dr.gather(mi.Float, self.cumulative, cell + 1)
        within = dr.clip((u - low) / dr.maximum(high - low, 1e-12), 0, 1)
        offset = (mi.Float(cell) + within) * (2 * self.radius / CELLS) - self.radius + 0.5
        if not self.has_negative_lobes:
            return offset, mi.Float(1)
        return offset, dr.gather(mi.Float, self.sign, cell) * self.scale
