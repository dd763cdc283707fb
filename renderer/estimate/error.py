"""The relative error of an image, from its own moments.

    error = sqrt( mean over pixels and channels of Var[mean] / (mean² + (0.1 · image mean)²) )

Scale-free; the floor keeps black pixels from dominating. `estimated_rel_mse` is its square. `rel_mse` is the same
measure against a reference, for tests and benchmarks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from renderer.estimate.interval import trust
from renderer.estimate.moments import Moments

FLOOR = 0.1
MIN_MEASURED = 256  # pixels with a variance, before the error of the image is said


@dataclass(frozen=True, slots=True)
class ImageError:
    """error: relative error of the image, None while fewer than 256 pixels have two replicates.

    share_within: share of pixels whose own relative error is below the target. share_trusted: see `interval.trust`.
    """

    error: float | None
    share_within: float | None
    share_trusted: float


def floor_of(mean: NDArray[np.float64]) -> float:
    """The squared floor (0.1 · image mean)², never zero."""
    average = float(np.mean(mean)) if mean.size else 0.0
    if not math.isfinite(average) or average == 0:
        average = float(np.mean(np.abs(mean)))
    return max((FLOOR * average) ** 2, np.finfo(np.float64).tiny)


def pixel_rel_mse(moments: Moments) -> NDArray[np.float64]:
    """(n,) estimated relative squared error of each pixel, mean over R, G, B; NaN where count < 2."""
    return np.mean(moments.variance_of_mean()[:, :3] / (moments.mean**2 + floor_of(moments.mean)), axis=1)


def image_error(moments: Moments, target: float | None = None) -> ImageError:
    """The error of the whole image.

    Early on only a grid of pixels has two replicates. A pixel without a variance of its own is then taken to vary like
    the mean of the others, per replicate.
    """
    trusted = float(trust(moments).mean()) if moments.count.size else 0.0
    measured = moments.count >= 2
    n_measured = int(measured.sum())
    is_black = not moments.mean.any()  # nothing found yet is no estimate, and not a perfect one
    if is_black or n_measured == 0 or n_measured < min(MIN_MEASURED, moments.count.size):
        return ImageError(None, None, trusted)
    squared = pixel_rel_mse(moments)
    if n_measured < moments.count.size:
        per_replicate = float(np.mean(squared[measured] * moments.count[measured]))
        squared = np.where(measured, squared, per_replicate / np.maximum(moments.count, 1))
    within = None if target is None else float(np.mean(squared <= target * target))
    return ImageError(math.sqrt(float(np.mean(squared))), within, trusted)


def rel_mse(image: NDArray, reference: NDArray) -> float:
    """Relative squared error of an image against a reference, both (..., 3)."""
    reference = np.asarray(reference, np.float64)
    difference = np.asarray(image, np.float64) - reference
    return float(np.mean(difference**2 / (reference**2 + floor_of(reference))))
