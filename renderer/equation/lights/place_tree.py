"""Which light to choose where: places of a scene, and for each the probabilities of its lights. NumPy only.

Enters: points on surfaces with the side they are seen from, and what one sample of each light gave them. Leaves: a
tree that finds the place of any point, and a row of cumulative probabilities per place.

The best probability of a light is proportional to the root mean square of what one sample of it gives: then variance
is least (Kahn & Marshall 1953). What a light gives is measured, with everything that decides it: distance, orientation,
size, texture, and whether anything stands between. A share goes to the lights by their power alone, so that no light
is ever out of reach: the table decides how noisy an image is, never what it converges to.
Sources: Veach 1997, section 9.2; Donikian et al. 2006 (probabilities by region); Vévoda et al. 2018 (learned choice).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FEATURES = 6  # position relative to the scene's size, and the normal
GRID = 2.0**24  # random numbers are multiples of its inverse: probabilities, too, are then met exactly
BLIND_SHARE = 0.1  # of the choice that ignores the place
PARENT_WEIGHT = 2.0  # points that the larger place counts for, where a small one has seen little


def plant(features: NDArray[np.floating], squares: Array, depth: int) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """A complete binary tree over (n, FEATURES) points, each place halved where that lowers the variance most.

    squares: (n, m), see `relative_squares`. With the best probabilities of a place, the second moments of its points
    add up to (Σ over lights √(Σ over points of squares))². Returns (2^depth − 1, 2): the feature and the threshold of
    each node, children of node i at 2i + 1 (up to the threshold) and 2i + 2 (beyond), and (n,) the leaf of each point.
    """
    nodes = np.zeros((2**depth - 1, 2), np.float32)
    nodes[:, 1] = np.inf
    at = features.astype(np.float32)
    members = [np.arange(len(at))]
    for level in range(depth):
        split = []
        for place, inside in enumerate(members):
            nodes[2**level - 1 + place] = _best_split(at[inside], squares[inside])
            dimension, threshold = nodes[2**level - 1 + place]
            left = at[inside, int(dimension)] <= threshold
            split += [inside[left], inside[~left]]
        members = split
    leaf = np.zeros(len(at), np.int64)
    for place, inside in enumerate(members):
        leaf[inside] = place
    return nodes, leaf


def _best_split(features: NDArray[np.float32], squares: Array) -> tuple[int, float]:
    """Feature and threshold; everything is on one side where there is nothing to part."""
    best, found = np.inf, (0, np.inf)
    total = squares.sum(axis=0)
    for dimension in range(FEATURES):
        values = features[:, dimension]
        if len(values) < 2 or values.min() == values.max():
            continue
        ordered = np.sort(values)
        middle = len(ordered) // 2
        threshold = np.float32(0.5) * (ordered[middle - 1] + ordered[middle])
        is_left = values <= threshold
        left = is_left.astype(np.float64) @ squares
        moment = np.sqrt(left).sum() ** 2 + np.sqrt(np.maximum(total - left, 0)).sum() ** 2
        if moment < best and not is_left.all():
            best, found = moment, (dimension, float(threshold))
    return found


def relative_squares(given: NDArray) -> Array:
    """(n, m) squares of what each light gives a point, relative to what all give it: points count alike, however
    brightly they are lit, for errors are relative. given: (n, m) ≥ 0; what is not finite counts as nothing."""
    given = np.where(np.isfinite(given), given, 0).astype(np.float64)
    total = given.sum(axis=1, keepdims=True)
    return np.square(given / np.where(total > 0, total, 1))


def rows_of(squares: Array, leaf: NDArray[np.int64], depth: int, blind: Array) -> Array:
    """(2^depth, m) probabilities of m lights at each place.

    squares: (n, m), see `relative_squares`. blind: (m,) probabilities without a place.
    """
    sums, counts = np.zeros((2**depth, squares.shape[1])), np.zeros(2**depth)
    np.add.at(sums, leaf, squares)
    np.add.at(counts, leaf, squares.any(axis=1))
    second = _smoothed(sums, counts)
    wanted = np.sqrt(second)
    norm = wanted.sum(axis=1, keepdims=True)
    wanted = np.where(norm > 0, wanted / np.where(norm > 0, norm, 1), blind)
    return (1 - BLIND_SHARE) * wanted + BLIND_SHARE * blind


def _smoothed(sums: Array, counts: Array) -> Array:
    """Means per leaf, drawn towards those of the larger places around it."""
    if len(sums) == 1:
        return sums / max(counts[0], 1)
    around = _smoothed(sums[0::2] + sums[1::2], counts[0::2] + counts[1::2])
    return (sums + PARENT_WEIGHT * np.repeat(around, 2, axis=0)) / (counts + PARENT_WEIGHT)[:, None]


def cumulative(rows: Array) -> NDArray[np.float32]:
    """(n, m) probabilities → (n, m + 1) sums from 0 to 1, multiples of 1/GRID. Each step is at least one of those, so
    that no light is lost to rounding; what is really chosen, and with which probability, is what the steps say.
    """
    m = rows.shape[1]
    sums = np.cumsum(rows / rows.sum(axis=1, keepdims=True), axis=1)
    sums[:, -1] = 1
    on_grid = np.round(np.minimum(sums, 1) * (GRID - m)) + np.arange(1, m + 1)
    return (np.pad(on_grid, ((0, 0), (1, 0))) / GRID).astype(np.float32)
