"""From what paths brought back to a guide: a tree of places, and for each a histogram of directions. NumPy only.

Enters: records of path vertices. Leaves: a `Guide`. What a direction brings is told by what the place of its next
vertex sends in the mean, not by the one path that went on: where a guide is needed, single paths are too noisy to learn
from. A cell's probability is proportional to the root mean square of what it brings, which leaves least variance.
Sources: Rath et al. 2020 (root mean squares); Dahm & Keller 2017 (learning from what places send).
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from renderer.equation.guide import CELLS, COLUMNS, FEATURES, NORMAL_SCALE, ROWS, Guide
from renderer.equation.lights.place_tree import cumulative

Array = NDArray[np.float64]

DEPTH = 12  # of the tree, at most: 4096 places
RECORDS_PER_PLACE = 32  # at least
PLANTED = 2**16  # records that the tree is made from
PARENT_WEIGHT = 16.0  # records that the larger place counts for, where a small one has seen few
SENDING_WEIGHT = 4.0  # the same, for what places send
EVEN_SHARE = 0.05  # of a histogram, that is spread over all directions
SHARE = 0.5  # of directions that the BSDF draws, before it is known what is better
SHARES = (1.0, 0.75, 0.5, 0.3)  # that are chosen from: below, a guide that is wrong would cost too much
SHARE_WEIGHT = 256.0  # as PARENT_WEIGHT, for the choice among them


@dataclass(frozen=True)
class Records:
    """m vertices of paths, those of a path in order. p, n, d: (m, 3) position, unit normal on the side that is seen,
    and the direction that the path took. pdf: (m,) solid-angle density that d was drawn with. blind: that which the
    BSDF alone draws it with. weight: f·cosθ/pdf. shone: radiance that d found shining at its next vertex, weighted
    against emitter sampling, where that is the next record (has_next). brought: all radiance that came along d. sent:
    that this vertex sent back. is_served: whether a guide can serve the surface. Radiance is the mean of its channels.
    """

    p: Array
    n: Array
    d: Array
    pdf: Array
    blind: Array
    weight: Array
    shone: Array
    brought: Array
    sent: Array
    has_next: NDArray[np.bool_]
    is_served: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.pdf)

    @staticmethod
    def joined(several: list[Records]) -> Records:
        """All of them."""
        return Records(*(np.concatenate([getattr(r, f.name) for r in several]) for f in fields(Records)))


def fit(records: Records, centre: Array, size: float, n_last: int = 0) -> Guide:
    """A guide. centre, size: of the scene. n_last: so many records at the end judge what those before them would have
    given, and with it how large the BSDF's share is in each place; with 0, it is SHARE everywhere."""
    features = features_of(records.p, records.n, centre, size)
    depth = int(np.clip(np.log2(max(len(records), 1) / RECORDS_PER_PLACE), 1, DEPTH))
    nodes = plant(features[:: len(records) // PLANTED + 1], depth)
    leaf = leaves(nodes, features)
    radiance = _expected(records, leaf, depth)
    cell = leaf * CELLS + cells_of(records.d)
    cosine = np.abs(np.sum(records.d * records.n, axis=1))
    squares = np.where(records.is_served, np.square(radiance * cosine), 0) / records.pdf
    shares = np.full(1 << depth, SHARE)
    if n_last:
        earlier, last = slice(None, len(records) - n_last), slice(len(records) - n_last, None)
        rows = _rows(squares[earlier], cell[earlier], leaf[earlier], depth)
        guided = rows.ravel()[cell[last]] * (CELLS / (4 * np.pi))
        shares = _shares(records, last, guided, radiance[last] * records.weight[last], leaf[last], depth)
    sums = cumulative(_rows(squares, cell, leaf, depth))
    middle = float(centre[0]), float(centre[1]), float(centre[2])
    return Guide(middle, size, depth, nodes, sums, shares.astype(np.float32))


def _expected(records: Records, leaf: NDArray[np.int64], depth: int) -> Array:
    """(m,) radiance that comes along each record's direction, by what the next vertex's place sends in the mean."""
    sums = np.bincount(leaf, records.sent, 1 << depth)[:, None]
    sent = _smoothed(sums, np.bincount(leaf, minlength=1 << depth), SENDING_WEIGHT)[:, 0]
    return np.where(records.has_next, records.shone + np.append(sent[leaf[1:]], 0), records.brought)


def _rows(squares: Array, cell: NDArray[np.int64], leaf: NDArray[np.int64], depth: int) -> Array:
    """(places, CELLS) probabilities of directions."""
    sums = np.bincount(cell, squares, CELLS << depth).reshape(-1, CELLS)
    wanted = np.sqrt(_smoothed(sums, np.bincount(leaf, minlength=1 << depth), PARENT_WEIGHT))
    total = wanted.sum(axis=1, keepdims=True)
    rows = np.where(total > 0, wanted / np.where(total > 0, total, 1), 1 / CELLS)
    return (1 - EVEN_SHARE) * rows + EVEN_SHARE / CELLS


def _shares(records: Records, which: slice, guided: Array, given: Array, leaf: NDArray[np.int64], depth: int) -> Array:
    """(places,) the one of SHARES that leaves least variance. Of the records `which`, guided: density that a guide
    would draw their directions with; given: what they gave, f·cosθ·radiance/pdf."""
    served = records.is_served[which]
    pdf, blind, at = records.pdf[which][served], records.blind[which][served], leaf[served]
    given, guided = given[served], guided[served]
    counts = np.bincount(at, minlength=1 << depth)
    mean = _smoothed(np.bincount(at, given, 1 << depth)[:, None], counts, SHARE_WEIGHT)[:, 0]
    best, shares = np.full(1 << depth, np.inf), np.ones(1 << depth)
    for share in SHARES:
        second = np.square(given) * pdf / (share * blind + (1 - share) * guided)
        sums = np.bincount(at, second, 1 << depth)[:, None]
        variance = _smoothed(sums, counts, SHARE_WEIGHT)[:, 0] - np.square(mean)
        shares = np.where(variance < best, share, shares)
        best = np.minimum(variance, best)
    return shares


def features_of(p: Array, n: Array, centre: Array, size: float) -> NDArray[np.float32]:
    """(m, FEATURES) that places are told apart by."""
    return np.concatenate([(p - centre) / size, n * NORMAL_SCALE], axis=1).astype(np.float32)


def plant(features: NDArray[np.float32], depth: int) -> NDArray[np.float32]:
    """(2^depth − 1, 2) feature and threshold of each node of a tree whose places hold equally many points: each is
    halved at the median of the feature that is spread widest in it. Points up to the threshold go to child 2i + 1."""
    nodes = np.zeros((2**depth - 1, 2), np.float32)
    at = np.zeros(len(features), np.int64)
    rows = np.arange(len(features))
    for level in range(depth):
        n = 2**level
        counts = np.bincount(at, minlength=n)
        spread = np.empty((FEATURES, n))
        for i in range(FEATURES):
            x = features[:, i].astype(np.float64)
            mean = np.bincount(at, x, n) / np.maximum(counts, 1)
            spread[i] = np.bincount(at, np.square(x - mean[at]), n)
        feature = spread.argmax(axis=0)
        x = features[rows, feature[at]]
        ordered = x[np.lexsort((x, at))]
        middle = np.minimum(np.cumsum(counts) - counts + counts // 2, len(ordered) - 1)
        threshold = np.float32(0.5) * (ordered[np.maximum(middle - 1, 0)] + ordered[middle])
        nodes[n - 1 : 2 * n - 1, 0] = feature
        nodes[n - 1 : 2 * n - 1, 1] = np.where(counts > 1, threshold, ordered[middle])
        at = 2 * at + (x > nodes[n - 1 + at, 1])
    return nodes


def leaves(nodes: NDArray[np.float32], features: NDArray[np.float32]) -> NDArray[np.int64]:
    """(m,) place of each point."""
    at = np.zeros(len(features), np.int64)
    rows = np.arange(len(features))
    for _ in range(len(nodes).bit_length()):
        at = 2 * at + 1 + (features[rows, nodes[at, 0].astype(np.int64)] > nodes[at, 1])
    return at - len(nodes)


def cells_of(d: Array) -> NDArray[np.int64]:
    """(m,) cell of each unit direction."""
    row = np.clip(((d[:, 2] + 1) * (ROWS / 2)).astype(np.int64), 0, ROWS - 1)
    turn = np.arctan2(d[:, 1], d[:, 0]) / (2 * np.pi) % 1
    return row * COLUMNS + np.minimum((turn * COLUMNS).astype(np.int64), COLUMNS - 1)


def _smoothed(sums: NDArray, counts: NDArray, weight: float) -> Array:
    """(places, n) means per place, drawn towards those of the larger places around it."""
    if len(sums) == 1:
        return sums / max(int(counts[0]), 1)
    around = _smoothed(sums[0::2] + sums[1::2], counts[0::2] + counts[1::2], weight)
    return (sums + weight * np.repeat(around, 2, axis=0)) / (counts + weight)[:, None]
