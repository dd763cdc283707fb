"""Choosing among lights: by their power, or, once a scene has been surveyed, by what each gives at the place.

Enters: probabilities of the emitters and, with a survey, a tree of places with a row of probabilities each. Leaves: the
index of an emitter and the probability with which it was chosen, the same for a light that a ray hit by chance.
Of very many lights, neighbours share an entry of the row, and one of them is chosen by its power.
"""

from __future__ import annotations

import copy
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from renderer.backend import mitsuba
from renderer.equation.lights import place_tree
from renderer.equation.lights.survey import Seen
from renderer.equation.tables import last_up_to, table

mi: Any = mitsuba()

MOST_ENTRIES = 512


class LightChoice:
    """weights: (n,) probability of each emitter, all positive, neighbours beside each other."""

    def __init__(self, weights: NDArray[np.float64]) -> None:
        # Entries of about equal probability; a light that has much of it stands alone.
        middle = np.cumsum(weights) - weights / 2
        n = len(weights)
        entry = np.arange(n) if n <= MOST_ENTRIES else (middle / weights.sum() * MOST_ENTRIES).astype(np.int64)
        _, self.first, entry = np.unique(entry, return_index=True, return_inverse=True)
        self.n_entries = len(self.first)
        self.blind: NDArray[np.float64] = np.bincount(entry, weights).astype(np.float64)
        self.is_shared = self.n_entries < n
        within: NDArray[np.float64] = weights / self.blind[entry]
        if self.is_shared:
            ends = np.append(self.first[1:], n)
            inner = [place_tree.cumulative(within[None, a:b])[0] for a, b in zip(self.first, ends, strict=True)]
            self.most_within = int((ends - self.first).max())
            self._first, self._end = table(self.first, mi.UInt32), table(ends, mi.UInt32)
            self._before = table(np.concatenate([sums[:-1] for sums in inner]), mi.Float)
            self._within = table(np.concatenate([np.diff(sums) for sums in inner]), mi.Float)
        self._entry = table(entry, mi.UInt32)
        self.depth = 0
        self._sums = table(place_tree.cumulative(self.blind[None]).ravel(), mi.Float)

    def visible_share(self, seen: Seen) -> float:
        """How much of the choice falls on lights that give anything, at the median of the points that are lit."""
        gives = seen.given > 0
        lit = gives.any(axis=1)
        return float(np.median(gives[lit] @ self.blind)) if lit.any() else 1.0

    def gain(self, seen: Seen) -> float:
        """How many times smaller the second moment of a light's sample gets by choosing by the place."""
        squares = place_tree.relative_squares(seen.given)
        _, leaf = place_tree.plant(seen.features, squares, seen.depth)
        rows = place_tree.rows_of(squares, leaf, seen.depth, self.blind)
        return float(np.sum(squares / self.blind) / max(np.sum(squares / rows[leaf]), 1e-30))

    def informed(self, seen: Seen) -> LightChoice:
        """The same that chooses by the place."""
        other = copy.copy(self)
        other._learn(seen)
        return other

    def _learn(self, seen: Seen) -> None:
        squares = place_tree.relative_squares(seen.given)
        nodes, leaf = place_tree.plant(seen.features, squares, seen.depth)
        rows = place_tree.rows_of(squares, leaf, seen.depth, self.blind)
        self.depth = seen.depth
        self.centre = mi.Point3f(*(dr.opaque(mi.Float, x) for x in seen.centre))
        self.size = dr.opaque(mi.Float, seen.size)
        self._nodes = table(nodes.ravel(), mi.Float)
        self._sums = table(place_tree.cumulative(rows).ravel(), mi.Float)

    def place(self, p: Any, n: Any, active: Any) -> Any:
        """The place of a point p, seen from the side of the normal n; 0 where places do not matter."""
        if self.depth == 0:
            return mi.UInt32(0)
        at = (p - self.centre) / self.size
        values = (at.x, at.y, at.z, n.x, n.y, n.z)
        node = mi.UInt32(0)
        for _ in range(self.depth):
            split = dr.gather(mi.Vector2f, self._nodes, node, active)
            value = values[0]
            for i in range(1, place_tree.FEATURES):
                value = dr.select(split.x == i, values[i], value)
            node = 2 * node + dr.select(value <= split.y, mi.UInt32(1), 2)
        return node - (2**self.depth - 1)

    def sample(self, place: Any, u: Any, active: Any) -> tuple[Any, Any, Any]:
        """Returns the index of an emitter, u made fresh for choosing a point on it, and the index's probability."""
        row = place * (self.n_entries + 1)
        entry = last_up_to(u.x, self._sums, row, self.n_entries, self.n_entries, active)
        low = dr.gather(mi.Float, self._sums, row + entry, active)
        pmf = dr.gather(mi.Float, self._sums, row + entry + 1, active) - low
        index, fresh, within = self.sample_within(entry, mi.Point2f(_fresh(u.x, low, pmf), u.y), active)
        return index, fresh, pmf * within

    def sample_within(self, entry: Any, u: Any, active: Any) -> tuple[Any, Any, Any]:
        """The same among the emitters that share an entry."""
        if not self.is_shared:
            return entry, u, mi.Float(1)
        first, end = (dr.gather(mi.UInt32, t, entry, active) for t in (self._first, self._end))
        index = first + last_up_to(u.y, self._before, first, end - first, self.most_within, active)
        within = dr.gather(mi.Float, self._within, index, active)
        before = dr.gather(mi.Float, self._before, index, active)
        return index, mi.Point2f(u.x, _fresh(u.y, before, within)), within

    def pmf(self, place: Any, index: Any, active: Any) -> Any:
        """Probability with which `sample` chooses this emitter at this place."""
        entry = dr.gather(mi.UInt32, self._entry, index, active) if self.is_shared else index
        at = place * (self.n_entries + 1) + entry
        pmf = dr.gather(mi.Float, self._sums, at + 1, active) - dr.gather(mi.Float, self._sums, at, active)
        return pmf * dr.gather(mi.Float, self._within, index, active) if self.is_shared else pmf


def _fresh(u: Any, low: Any, share: Any) -> Any:
    """Where u lies within its share, in [0, 1). In the middle of its grid step: few steps make a small share, and
    their lower ends would all lie to one side of the light."""
    return dr.clip((u - low + 0.5 / place_tree.GRID) / share, 0, 1 - 2**-24)
