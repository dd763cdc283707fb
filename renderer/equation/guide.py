"""A learned density of incident radiance over place and direction, frozen before the first sample that counts.

Enters: a tree of places, and for each a histogram of directions and the share of directions that stay with the BSDF.
Leaves: directions drawn from a place's histogram, and the solid-angle density of any direction there. It decides how
noisy an image is, never what it converges to: directions are drawn from a mixture with the BSDF's own density.

Places halve the box of the scene by position and by normal, so that those of a wall and of what leans on it are apart,
and a histogram in world space knows which half of the directions lies below the surface. Its cells have equal solid
angles: rows of equal height along z, columns of equal width around it (Archimedes).
Sources: Müller, Gross & Novák 2017 (trees of places); Rath et al. 2020 (second moments); Vévoda et al. 2018.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from renderer.backend import mitsuba
from renderer.equation.tables import last_up_to, table

mi: Any = mitsuba()

ROWS, COLUMNS = 8, 16
CELLS = ROWS * COLUMNS
FEATURES = 6
NORMAL_SCALE = 0.5  # of a normal, beside positions that are taken relative to the scene's size


@dataclass(frozen=True)
class Guide:
    """The value. centre, size: positions are taken relative to them. nodes: (2^depth − 1, 2) float32, feature and
    threshold of each node of a complete binary tree; features are the position and `NORMAL_SCALE` times the normal.
    sums: (2^depth, CELLS + 1) float32, cumulative probabilities of each place's cells. shares: (2^depth,) float32, of
    directions that the BSDF draws.
    """

    centre: tuple[float, float, float]
    size: float
    depth: int
    nodes: NDArray[np.float32]
    sums: NDArray[np.float32]
    shares: NDArray[np.float32]

    @cached_property
    def digest(self) -> str:
        """SHA-256 of all of it, hexadecimal."""
        h = hashlib.sha256(np.array([*self.centre, self.size, self.depth], np.float64).tobytes())
        for one in (self.nodes, self.sums, self.shares):
            h.update(np.ascontiguousarray(one).tobytes())
        return h.hexdigest()


class GuideTables:
    """A guide as a kernel reads it."""

    def __init__(self, guide: Guide) -> None:
        self.depth = guide.depth
        self.centre = mi.Point3f(*(dr.opaque(mi.Float, x) for x in guide.centre))
        self.size = dr.opaque(mi.Float, guide.size)
        self._nodes = table(guide.nodes.ravel(), mi.Float)
        self._sums = table(guide.sums.ravel(), mi.Float)
        self._shares = table(guide.shares, mi.Float)

    def place(self, p: Any, n: Any, active: Any) -> Any:
        """The place of a point p, seen from the side of the unit normal n."""
        at = (p - self.centre) / self.size
        values = (at.x, at.y, at.z, n.x * NORMAL_SCALE, n.y * NORMAL_SCALE, n.z * NORMAL_SCALE)
        node = mi.UInt32(0)
        for _ in range(self.depth):
            split = dr.gather(mi.Vector2f, self._nodes, node, active)
            value = values[0]
            for i in range(1, FEATURES):
                value = dr.select(split.x == i, values[i], value)
            node = 2 * node + dr.select(value <= split.y, mi.UInt32(1), 2)
        return node - (2**self.depth - 1)

    def share(self, place: Any, active: Any) -> Any:
        """Share of the directions of a place that the BSDF draws."""
        return dr.gather(mi.Float, self._shares, place, active)

    def sample(self, place: Any, u_cell: Any, u: Any, active: Any) -> Any:
        """A direction in world space."""
        row = place * (CELLS + 1)
        cell = last_up_to(u_cell, self._sums, row, CELLS, CELLS, active)
        z = (mi.Float(cell // COLUMNS) + u.x) * (2 / ROWS) - 1
        phi = (mi.Float(cell % COLUMNS) + u.y) * (2 * dr.pi / COLUMNS)
        r = dr.safe_sqrt(dr.fma(-z, z, 1))
        s, c = dr.sincos(phi)
        return mi.Vector3f(r * c, r * s, z)

    def pdf(self, place: Any, d: Any, active: Any) -> Any:
        """Solid-angle density with which `sample` draws the direction d of world space."""
        at = place * (CELLS + 1) + cell_of(d)
        low, high = (dr.gather(mi.Float, self._sums, at + i, active) for i in range(2))
        return (high - low) * (CELLS / (4 * dr.pi))


def cell_of(d: Any) -> Any:
    """Number of the cell that the unit direction d lies in."""
    row = dr.clip(mi.Int32((d.z + 1) * (ROWS / 2)), 0, ROWS - 1)
    phi = dr.atan2(d.y, d.x) * (COLUMNS / (2 * dr.pi))
    column = dr.clip(mi.Int32(dr.select(phi < 0, phi + COLUMNS, phi)), 0, COLUMNS - 1)
    return mi.UInt32(row * COLUMNS + column)
