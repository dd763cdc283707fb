"""Sums over the neighbourhood of each pixel, for what one pixel alone cannot tell.

Several maps may be stacked, (…, H, W): one call then serves them all.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

Map = NDArray[np.float64]


def box_sum(values: Map, size: int) -> Map:
    """(…, H, W) sum of what is not negative over the size × size pixels around each one; outside the image is nothing.

    The filter's running sums leave rounding behind them, of either sign.
    """
    down = uniform_filter1d(values, size, axis=-2, mode="constant")
    across = uniform_filter1d(down, size, axis=-1, mode="constant", output=down)
    across *= float(size * size)
    return np.maximum(across, 0.0, out=across)


def box_mean(values: Map, size: int) -> Map:
    """(H, W) mean over the size × size pixels around each one that lie in the image."""
    return box_sum(values, size) / pixels_within(values.shape, size)


@lru_cache(maxsize=4)
def pixels_within(shape: tuple[int, int], size: int) -> Map:
    """(H, W) how many of the size × size pixels around each one lie in the image."""
    return box_sum(np.ones(shape), size)


def halved(values: Map) -> Map:
    """(…, ⌈H/2⌉, ⌈W/2⌉) sums of 2 × 2 pixels."""
    rows = values[..., 0::2, :].copy()
    rows[..., : values.shape[-2] // 2, :] += values[..., 1::2, :]
    both = rows[..., 0::2].copy()
    both[..., : values.shape[-1] // 2] += rows[..., 1::2]
    return both


def doubled(values: Map, shape: tuple[int, int]) -> Map:
    """(…, H, W) of the given shape: each value repeated 2 × 2; a single value everywhere."""
    if values.shape[-2:] == (1, 1):
        return np.broadcast_to(values, (*values.shape[:-2], *shape))
    return np.repeat(np.repeat(values, 2, axis=-2), 2, axis=-1)[..., : shape[0], : shape[1]]


def event_rate(variance: Map, third: Map, among: Map) -> Map:
    """How many of the values that make up the variance come in one replicate: 1 / skewness².

    A Poisson number of equal flashes with rate λ has variance λA² and third moment λA³, hence variance³ / third² = λ.
    variance, third: sums over `among` pixels. Infinite where nothing is skewed.
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        rate = variance * (variance / third) ** 2 / np.maximum(among, 1.0)
    return np.where((third > 0) & np.isfinite(rate), rate, np.inf)
