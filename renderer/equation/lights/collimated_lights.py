"""Light from a rectangle in the direction of its normal alone (Mitsuba's `directionalarea`).

From each point at most one point of the rectangle can be seen shining: the one straight above. It is found exactly,
as a delta light; Mitsuba's own emitter sampling finds nothing, and its `path` renders such scenes black.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np

from renderer.backend import mitsuba
from renderer.equation.lights.group import Hit
from renderer.equation.mueller import intensity

mi: Any = mitsuba()


def is_collimated(emitter: Any) -> bool:
    """Whether this is such a light on a rectangle, whose radiance does not depend on sampled wavelengths."""
    shape = emitter.get_shape()
    if shape is None or emitter.class_name() != "DirectionalArea":
        return False
    return shape.class_name() == "Rectangle" and not mi.is_spectral


class CollimatedLights:
    """emitters: those of this kind in a scene."""

    tells_radiance = False

    def __init__(self, emitters: list[Any]) -> None:
        rows = []  # origin, two half edges, area
        for emitter in emitters:
            shape = emitter.get_shape()
            matrix = np.array(mi.traverse(shape)["to_world"].matrix, np.float64).reshape(4, 4)
            area = float(np.array(shape.surface_area()).ravel()[0])
            rows.append([*matrix[:3, 3], *matrix[:3, 0], *matrix[:3, 1], area])
        self._rows = mi.Float(np.array(rows, np.float32).ravel())

    def sample(self, ref: Any, row: Any, emitter: Any, u: Any, active: Any) -> tuple[Any, Any]:
        """As `LightGroup.sample`; a delta light."""
        known = [dr.gather(mi.Float, self._rows, row * 10 + i, active) for i in range(10)]
        origin, first, second = (mi.Vector3f(*known[i : i + 3]) for i in (0, 3, 6))
        n = dr.normalize(dr.cross(first, second))
        relative = ref.p - mi.Point3f(origin)
        height = dr.dot(relative, n)
        a, b = (dr.dot(relative, edge) / dr.squared_norm(edge) for edge in (first, second))
        is_lit = active & (height > 0) & (dr.abs(a) <= 1) & (dr.abs(b) <= 1)
        at = mi.Point2f(0.5 * (a + 1), 0.5 * (b + 1))
        _, flux = emitter.sample_ray(ref.time, mi.Float(0.5), at, mi.Point2f(0.5), is_lit)  # radiance · area
        ds = dr.zeros(mi.DirectionSample3f)
        ds.p, ds.n, ds.d, ds.dist = ref.p - n * height, n, -n, height
        ds.delta, ds.emitter = mi.Bool(True), emitter
        ds.pdf = dr.select(is_lit, 1, 0)
        return ds, dr.select(is_lit, intensity(flux) / known[9], 0)

    def pdf(self, ref: Any, ds: Any, si: Any, hit: Hit, active: Any) -> Any:
        """As `LightGroup.pdf`: a hit is never of the one direction."""
        return mi.Float(0)

    def emission(self, si: Any, hit: Hit, active: Any) -> Any:
        """As `LightGroup.emission`."""
        return intensity(hit.emitter.eval(si, active))
