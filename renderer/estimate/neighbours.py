"""Sums over the neighbourhood of each pixel, for what one pixel alone cannot tell."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

Map = NDArray[np.float64]


def box_sum(values: Map, size: int) -> Map:
    """(H, W) sum of what is not negative over the size × size pixels around each one; outside the image is nothing.

    The filter's running sums leave rounding behind them, of either sign.
    """
    down = uniform_filter1d(values, size, axis=0, mode="constant")
    return np.maximum(uniform_filter1d(down, size, axis=1, mode="constant") * float(size * size), 0.0)


def box_mean(values: Map, size: int) -> Map:
    """(H, W) mean over the size × size pixels around each one that lie in the image."""
    return box_sum(values, size) / pixels_within(values.shape, size)


@lru_cache(maxsize=4)
def pixels_within(shape: tuple[int, int], size: int) -> Map:
    """(H, W) how many of the size × size pixels around each one lie in the image."""
    return box_sum(np.ones(shape), size)


def halved(values: Map) -> Map:
    """(⌈H/2⌉, ⌈W/2⌉) sums of 2 × 2 pixels."""
    height, width = values.shape
    padded = np.pad(values, ((0, height % 2), (0, width % 2)))
    rows = padded[0::2] + padded[1::2]
    return rows[:, 0::2] + rows[:, 1::2]


def doubled(values: Map, shape: tuple[int, int]) -> Map:
    """(H, W) of the given shape: each value repeated 2 × 2; a single value everywhere."""
    if values.shape == (1, 1):
        return np.full(shape, values[0, 0])
    return np.repeat(np.repeat(values, 2, axis=0), 2, axis=1)[: shape[0], : shape[1]]


def event_rate(variance: Map, third: Map, among: Map) -> Map:
    """How many of the values that make up the variance come in one replicate: 1 / skewness².

    A Poisson number of equal flashes with rate λ has variance λA² and third moment λA³, hence variance³ / third² = λ.
    variance, third: sums over `among` pixels. Infinite where nothing is skewed.
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        rate = variance * (variance / third) ** 2 / np.maximum(among, 1.0)
    return np.where((third > 0) & np.isfinite(rate), rate, np.inf)
