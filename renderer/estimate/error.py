"""The relative error of an image, from its own moments, and what it is not above.

    error = sqrt( mean over pixels and channels of Var[mean] / (mean² + (0.1 · image mean)²) )

Scale-free; the floor keeps black pixels from dominating. `estimated_rel_mse` is its square. `rel_mse` is the same
measure against a reference, for tests and benchmarks.

`upper` is the upper confidence bound of the true error. It differs from `error` in three ways:
- A pixel that found one bright value early has a large mean for the same reason as a large variance, and their ratio
  hides it. The more its variance is that of one value, and the fewer its replicates, the more its mean is taken from
  its neighbours, or, at the edge of a lamp, from what it would be without its brightest replicate.
- The mean over pixels is one of finitely many independent terms, and the truth is another: both spread. A term that is
  estimated from n replicates of skewness γ has the relative variance 2/(n − 1) + 3γ²/n of an estimated variance (its
  kurtosis taken as that of a gamma distribution, 1.5 γ²), and the true squared error spreads by 2 + 3γ²/n around it.
- Looking often finds a favourable moment: the quantile is that of a bolder confidence (`LOOKS`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from renderer.estimate.interval import FLOOR, trust
from renderer.estimate.moments import Moments
from renderer.estimate.neighbours import box_sum, pixels_within

MIN_MEASURED = 256  # pixels with a variance, before the error of the image is said
CONFIDENCE = 0.95
LOOKS = 2.0  # the chance of a false stop is shared among this many looks that differ
WINDOW = 7
SINGLE = 2.0  # a share of 1/SINGLE of the variance in one value is taken as all of it
FEW = 4.0  # replicates, of which a pixel's mean is doubted in any case; of n it is by FEW/n
WITHOUT = 0.2  # how far a doubted mean is taken to be that without its brightest replicate, where neighbours are bright
MOST_DOUBT = 8.0  # times what the pixel says itself: the edge of a light is no rare value


@dataclass(frozen=True, slots=True)
class ImageError:
    """error: relative error of the image, None while fewer than 256 pixels have two replicates.

    upper: bound that the true error is below with the confidence asked for. share_within: share of pixels whose own
    relative error is below the target; share_lower: what it is not below. share_trusted: see `interval.trust`.
    """

    error: float | None
    share_within: float | None
    share_trusted: float
    upper: float | None = None
    share_lower: float | None = None


def floor_of(mean: NDArray[np.float64]) -> float:
    """The squared floor (0.1 · image mean)², never zero."""
    average = float(np.mean(mean)) if mean.size else 0.0
    if not math.isfinite(average) or average == 0:
        average = float(np.mean(np.abs(mean)))
    return max((FLOOR * average) ** 2, np.finfo(np.float64).tiny)


def pixel_rel_mse(moments: Moments, floor: float | None = None) -> NDArray[np.float64]:
    """(n,) estimated relative squared error of each pixel, mean over R, G, B; NaN where count < 2."""
    floor = floor_of(moments.mean) if floor is None else floor
    return np.mean(moments.variance_of_mean()[:, :3] / (moments.mean**2 + floor), axis=1)


def image_error(
    moments: Moments,
    width: int,
    target: float | None = None,
    *,
    confidence: float = CONFIDENCE,
    scope: NDArray[np.bool_] | None = None,
    is_trust_wanted: bool = True,
) -> ImageError:
    """The error of the whole image, or of the pixels in `scope` (n,).

    Early on only a grid of pixels has two replicates. A pixel without a variance of its own is then taken to vary like
    the mean of the others, per replicate.
    """
    inside = slice(None) if scope is None else scope
    is_trusted = trust(moments, width)[inside] if is_trust_wanted else np.zeros(1, bool)
    trusted = float(is_trusted.mean()) if is_trusted.size else 0.0
    counted = moments.at(inside)
    count, mean = counted.count, counted.mean
    n_measured = int(np.count_nonzero(count >= 2))
    is_black = not mean.any()  # nothing found yet is no estimate, and not a perfect one
    if is_black or n_measured == 0 or n_measured < min(MIN_MEASURED, len(count)):
        return ImageError(None, None, trusted)
    if n_measured < len(count):
        return ImageError(*_early(counted, target), trusted)
    floor = floor_of(mean)
    squared = pixel_rel_mse(counted, floor)
    error = math.sqrt(float(np.mean(squared)))
    careful, single = _careful(moments, width, floor)
    careful, single = np.maximum(careful[inside], squared), single[inside]
    z = float(ndtri(1 - (1 - confidence) / LOOKS))
    within = _share(squared, target)
    lower = _share(careful, target)
    if lower is not None:
        lower = max(0.0, lower - z * math.sqrt(lower * (1 - lower) / len(count)))
    spread = 2.0 + 2.0 / np.maximum(count - 1, 1) + 6.0 * single
    total = float(careful.sum())
    relative = math.sqrt(float(np.sum(careful**2 * spread))) / total if total > 0 else 0.0
    return ImageError(
        error=error,
        share_within=within,
        share_trusted=trusted,
        upper=math.sqrt(total / len(count) * math.exp(min(z * relative, 50.0))),
        share_lower=lower,
    )


def _early(moments: Moments, target: float | None) -> tuple[float, float | None]:
    """Error and share within the target, where some pixels have no variance of their own yet."""
    measured = moments.at(np.flatnonzero(moments.count >= 2))
    sampled = np.flatnonzero(moments.count)
    squared = pixel_rel_mse(measured, floor_of(moments.mean[sampled]))
    each = float(np.mean(squared * measured.count))  # of the others, which have a replicate at most
    n, others = len(moments.count), len(moments.count) - len(squared)
    error = math.sqrt((float(squared.sum()) + others * each) / n)
    if target is None:
        return error, None
    within = np.count_nonzero(squared <= target * target) + others * (each <= target * target)
    return error, float(within / n)


def _share(squared: NDArray[np.float64], target: float | None) -> float | None:
    return None if target is None else float(np.mean(squared <= target * target))


def _careful(moments: Moments, width: int, floor: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(n,) relative squared error of each pixel, its mean doubted where one value makes it; and that value's share of
    the variance, γ²/n (0 … 1)."""
    shape = (len(moments.count) // width, width)
    single = np.minimum(moments.skewness() ** 2 / np.maximum(moments.count, 1), 1.0)
    doubt = np.minimum(np.maximum(SINGLE * single, FEW / np.maximum(moments.count, 1)), 1.0)
    without = 1 - WITHOUT * (1 - _share_without_brightest(moments))
    others = np.maximum(pixels_within(shape, WINDOW) - 1.0, 1.0).ravel()
    result = np.zeros(len(single))
    variance = moments.variance_of_mean()
    for c in range(3):
        mean = moments.mean[:, c]
        around = (box_sum(np.ascontiguousarray(mean).reshape(shape), WINDOW).ravel() - mean) / others
        believed = mean + doubt * (np.minimum(without * np.abs(mean), np.maximum(around, 0.0)) - mean)
        result += variance[:, c] / np.maximum(believed**2 + floor, (mean**2 + floor) / MOST_DOUBT)
    return result / 3.0, single


def _share_without_brightest(moments: Moments) -> NDArray[np.float64]:
    """(n,) mean luminance without the brightest replicate over that with it, at most 1."""
    total = np.abs(moments.luminance()) * moments.count
    rest = np.maximum(total - moments.largest, 0.0) * moments.count
    all_of_them = total * np.maximum(moments.count - 1, 1)
    return np.minimum(np.divide(rest, all_of_them, out=np.ones_like(rest), where=all_of_them > 0), 1.0)


def rel_mse(image: NDArray, reference: NDArray) -> float:
    """Relative squared error of an image against a reference, both (..., 3)."""
    reference = np.asarray(reference, np.float64)
    difference = np.asarray(image, np.float64) - reference
    return float(np.mean(difference**2 / (reference**2 + floor_of(reference))))
