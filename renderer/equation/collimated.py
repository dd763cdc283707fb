"""Light from a rectangle in the direction of its normal alone (Mitsuba's `directionalarea`).

From each point at most one point of the rectangle can be seen shining: the one straight above. It is found exactly,
as a delta light; Mitsuba's own emitter sampling finds nothing, and its `path` renders such scenes black.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from renderer.backend import mitsuba
from renderer.equation.mueller import intensity

mi: Any = mitsuba()


def is_collimated(emitter: Any) -> bool:
    """Whether this is such a light on a rectangle, whose radiance does not depend on sampled wavelengths."""
    shape = emitter.get_shape()
    if shape is None or emitter.class_name() != "DirectionalArea":
        return False
    return shape.class_name() == "Rectangle" and not mi.is_spectral


class CollimatedLights:
    """The collimated lights among `emitters`, in tables by registry id `ids`. `is_empty` where there is none."""

    def __init__(self, emitters: list[Any], ids: NDArray[np.integer]) -> None:
        found = [(i, e) for i, e in zip(ids, emitters, strict=True) if is_collimated(e)]
        self.is_empty = not found
        if self.is_empty:
            return
        # Origin, two half edges, area; an area of 0 is any other light.
        table = np.zeros((int(max(ids)) + 1, 10), np.float32)
        for i, emitter in found:
            shape = emitter.get_shape()
            matrix = np.array(mi.traverse(shape)["to_world"].matrix, np.float64).reshape(4, 4)
            area = float(np.array(shape.surface_area()).ravel()[0])
            table[i] = [*matrix[:3, 3], *matrix[:3, 0], *matrix[:3, 1], area]
        self.table = mi.Float(table.ravel())
        self.last = int(max(ids))

    def sample(self, ref: Any, emitter: Any, ds: Any, weight: Any, active: Any) -> tuple[Any, Any]:
        """Direction sample and weight with those of collimated lights filled in; the others' are kept."""
        key: Any = dr.reinterpret_array(mi.UInt32, emitter)
        known = active & (key <= self.last)
        row = [dr.gather(mi.Float, self.table, dr.select(known, key, 0) * 10 + i, known) for i in range(10)]
        origin, u, v = (mi.Vector3f(*row[i : i + 3]) for i in (0, 3, 6))
        is_collimated = known & (row[9] > 0)
        n = dr.normalize(dr.cross(u, v))
        relative = ref.p - mi.Point3f(origin)
        height = dr.dot(relative, n)
        a, b = dr.dot(relative, u) / dr.squared_norm(u), dr.dot(relative, v) / dr.squared_norm(v)
        is_lit = is_collimated & (height > 0) & (dr.abs(a) <= 1) & (dr.abs(b) <= 1)

        at = mi.Point2f(0.5 * (a + 1), 0.5 * (b + 1))
        _, flux = emitter.sample_ray(ref.time, mi.Float(0.5), at, mi.Point2f(0.5), is_lit)  # radiance · area
        ds.p[is_collimated] = ref.p - n * height
        ds.n[is_collimated] = n
        ds.d[is_collimated] = -n
        ds.dist[is_collimated] = height
        ds.delta[is_collimated] = True
        ds.emitter[is_collimated] = emitter
        ds.pdf[is_collimated] = dr.select(is_lit, 1, 0)
        return ds, dr.select(is_collimated, dr.select(is_lit, intensity(flux) / row[9], 0), weight)
