"""The relative error of an image, from its own moments, and what it is not above.

    error² = mean over pixels and channels of (picture − truth)² / (truth² + (0.1 · image mean)²)

Scale-free; the floor keeps black pixels from dominating. `rel_mse` is this measure against a reference, for tests and
benchmarks; `image_error` estimates it for *this picture*, and is the one place that decides whether it can be said. By
the state of its pixels:

- *no sample*: the picture shows a neighbour there. How far off that is nobody knows: the error is not said.
- *one replicate*: no variance of its own; it is taken to vary as the pixels around it do that have two, per replicate.
  Said once three quarters of the pixels have two.
- *two or more*: variance of the mean over (mean² + floor). A pixel that found one bright value early has a large mean
  for the same reason as a large variance, and their ratio hides both. So the fewer a pixel's replicates, and the
  noisier its surroundings, the more its mean is taken from its neighbours, or, at the edge of a lamp, from what it
  would be without its brightest replicate.
- *lost*: rendered, but its samples were not finite. Left out while there are few of them; health counts them.

Replicates that are skewed have not shown all of their tail: what is missing of it grows with their skewness (UNSEEN).
Where a few bright values decide, the estimate is as rare as they are, and is not said: where its own spread is large,
where doubting means changes it much, or where such values, measured by what is around them, would make another error.
What is not said is None, with a sentence that says why (`unknown`). `python -m tests.coverage_study partial` measures
what is said against the truth.

`upper` is the upper confidence bound of the true error, where every pixel has two replicates. It doubts means more
than the estimate does, and knows that:
- The mean over pixels is one of finitely many independent terms, and the truth is another: both spread. A term that is
  estimated from n replicates of skewness γ has the relative variance 2/(n − 1) + 3γ²/n of an estimated variance (its
  kurtosis taken as that of a gamma distribution, 1.5 γ²), and the true squared error spreads by 2 + 3γ²/n around it.
  Of fewer than MIN_MEASURED pixels, a meter's one among them, the quotient of the two has Fisher's distribution; what
  one pixel's error is not above is then the half width of its interval by Student's.
- Looking often finds a favourable moment: the quantile is that of a bolder confidence (`LOOKS`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtri, ndtr, ndtri

from renderer.estimate.correlation import INDEPENDENT, Correlation
from renderer.estimate.interval import FLOOR
from renderer.estimate.moments import Moments
from renderer.estimate.neighbours import box_sum, pixels_within

# The image's error is said once so many pixels (or all, of a smaller image) and this share of them have a variance.
MIN_MEASURED, MIN_SHARE = 256, 0.75
MOST_LOST = 0.01  # share of the pixels that may have no two finite replicates
MOST_SPREAD = 0.3  # relative standard deviation of the squared error, above which it is not said
MOST_DOUBTED = 2.0  # error by doubted means over that by the pixels' own, above which it is not said
AT_FACE = 8.0  # replicates, at which one by rare values at their face may be twice as large; of fewer, less
UNSEEN = 0.25  # of the error, that is not seen yet where single values make all of the variance
CONFIDENCE = 0.95
LOOKS = 2.0  # the chance of a false stop is shared among this many looks that differ
WINDOW = 7
AROUND = 15  # pixels on a side, from which one without a variance takes it
SINGLE = 2.0  # a share of 1/SINGLE of the variance in one value is taken as all of it
FEW = 4.0  # replicates, of which a pixel's mean is doubted in any case; of n it is by FEW/n
SETTLED = 0.03  # relative variance of the means around, at which a mean is doubted half as much for the estimate
WITHOUT = 0.2  # how far a doubted mean is taken to be that without its brightest replicate, where neighbours are bright
MOST_DOUBT = 8.0  # times what the pixel says itself: the edge of a light is no rare value. For the bound,
MOST_SURPRISE = 32.0  # and for the estimate


@dataclass(frozen=True, slots=True)
class ImageError:
    """error: relative error of the picture, None where it cannot be said; unknown: a sentence why.

    upper: bound that the true error is below with the confidence asked for. share_within: share of pixels whose own
    relative error is known and below the target, None where the error is; share_lower: what it is not below.
    """

    error: float | None
    share_within: float | None
    upper: float | None = None
    share_lower: float | None = None
    unknown: str | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Missing:
    """Radiance that no sample has met, as another estimator found it (an audit).

    squared: the relative squared error that it makes, mean over all pixels that count; it is added to that of the image
    and of its bound. doubted: (n,) pixels in which it may lie, None for none: they are neither trusted nor within a
    target. at_most: the same for the bound, where it is more: what finds of hardly any sample may yet make of it.
    """

    squared: float = 0.0
    doubted: NDArray[np.bool_] | None = None
    at_most: float = 0.0


NOTHING_MISSING = Missing()


def floor_of(mean: NDArray[np.float64]) -> float:
    """The squared floor (0.1 · image mean)², never zero."""
    average = float(np.mean(mean)) if mean.size else 0.0
    if not math.isfinite(average) or average == 0:
        average = float(np.mean(np.abs(mean)))
    return max((FLOOR * average) ** 2, np.finfo(np.float64).tiny)


def pixel_rel_mse(moments: Moments, floor: float | None = None) -> NDArray[np.float64]:
    """(n,) estimated relative squared error of each pixel by itself, mean over R, G, B; NaN where count < 2."""
    floor = floor_of(moments.mean) if floor is None else floor
    return np.mean(moments.variance_of_mean()[:, :3] / (moments.mean**2 + floor), axis=1)


def image_error(
    moments: Moments,
    width: int,
    target: float | None = None,
    *,
    confidence: float = CONFIDENCE,
    scope: NDArray[np.bool_] | None = None,
    missing: Missing = NOTHING_MISSING,
    correlation: Correlation = INDEPENDENT,
) -> ImageError:
    """The error of the whole image, or of the pixels in `scope` (n,). missing: see `Missing`."""
    counts = np.ones(len(moments.count), bool) if scope is None else scope
    doubted = np.zeros(1, bool) if missing.doubted is None else missing.doubted
    lost = (moments.tried >= 2) & (moments.count < 2)
    if unknown := _why_unknown(moments, counts, lost):
        return ImageError(None, None, unknown=unknown)
    kept = counts & ~lost
    measured = kept & (moments.count >= 2)
    floor = floor_of(moments.mean[counts & (moments.count > 0)])
    terms = _terms(moments, width, floor, correlation)
    squared = _with_single(terms.squared, moments, width, measured)[kept]
    is_whole = bool(measured[kept].all())
    if _do_few_decide(terms, moments, measured, floor, correlation):
        unknown = "not yet known: a few bright values decide it, and how many there are of them has not shown yet"
    total = int(counts.sum())
    within = None
    if target is not None and unknown is None:
        within = float((measured & (terms.squared <= target * target) & ~doubted).sum() / total)
    upper = lower = None
    if is_whole:
        z = float(ndtri(1 - (1 - confidence) / LOOKS))
        careful = np.maximum(terms.careful, terms.squared)
        bound = float(careful[kept].mean())
        of_truth, of_estimate = _spreads(careful, terms.single, moments, measured, correlation)
        if total < MIN_MEASURED:
            growth = float(fdtri(2 / of_truth**2, 2 / of_estimate**2, ndtr(z))) if of_truth > 0 else 1.0
        else:
            growth = math.exp(min(z * math.hypot(of_truth, of_estimate), 50.0))
        upper = math.sqrt(bound * growth + max(missing.squared, missing.at_most))
        if target is not None:
            lower = float((measured & (careful <= target * target) & ~doubted).sum() / total)
            lower = max(0.0, lower - z * math.sqrt(lower * (1 - lower) / total))
    return ImageError(
        error=None if unknown else math.sqrt(float(squared.mean()) + missing.squared),
        share_within=within,
        upper=upper,
        share_lower=lower,
        unknown=unknown,
    )


def _why_unknown(moments: Moments, counts: NDArray[np.bool_], lost: NDArray[np.bool_]) -> str | None:
    """Why nothing can be said of the pixels that count, by their states; None where something can."""
    n = int(counts.sum())
    n_unsampled, n_lost = (int(np.count_nonzero(state & counts)) for state in (moments.tried == 0, lost))
    n_measured = int(np.count_nonzero(counts & (moments.count >= 2)))
    if n_unsampled or n_measured < max(MIN_SHARE * n, min(MIN_MEASURED, n)) - n_lost:
        nothing = f", {_percent(n_unsampled / n)} no sample" if n_unsampled else ""
        return f"not yet known: {_percent(n_measured / max(n, 1))} of the pixels have two replicates{nothing}"
    if n_lost > MOST_LOST * n or n_measured == 0:
        return f"not known: {_percent(n_lost / max(n, 1))} of the pixels have no two replicates of finite samples"
    if not moments.mean[counts].any():  # nothing found yet is no estimate, and not a perfect one
        return "not yet known: no light was found so far"
    return None


def _percent(share: float) -> str:
    """A share as people read it; never 0 or 100 % where it is not."""
    percent = 100 * share
    digits = 0 if percent in (0.0, 100.0) or 1 <= percent <= 99 else 1
    return f"{min(max(percent, 0.1 if share > 0 else 0.0), 99.9 if share < 1 else 100.0):.{digits}f} %"


@dataclass(frozen=True, slots=True, eq=False)
class _Terms:
    """(n,) relative squared error of each pixel; 0 where it has no variance. squared: as estimated; careful: for the
    bound; at_face: with rare bright values taken for what they are beside their neighbours. single: share of the
    variance that is one value's, γ²/n (0 … 1).
    """

    squared: NDArray[np.float64]
    careful: NDArray[np.float64]
    at_face: NDArray[np.float64]
    single: NDArray[np.float64]


def _terms(moments: Moments, width: int, floor: float, correlation: Correlation = INDEPENDENT) -> _Terms:
    count = np.maximum(moments.count, 1)
    shape = (len(count) // width, width)
    single = np.minimum(moments.skewness() ** 2 / count, 1.0)
    doubt = np.minimum(np.maximum(SINGLE * single, FEW / count), 1.0)
    without = 1 - WITHOUT * (1 - _share_without_brightest(moments))
    # Those around a pixel are those that have no sample in common with it.
    window, same = WINDOW + 2 * correlation.touched, 1 + 2 * correlation.touched
    around_of = lambda values: box_sum(np.ascontiguousarray(values, np.float64).reshape(shape), window).ravel()  # noqa: E731
    same_of = lambda values: values if same == 1 else box_sum(values.reshape(shape).copy(), same).ravel()  # noqa: E731
    others = np.maximum(pixels_within(shape, window) - pixels_within(shape, same), 1.0).ravel()
    with_variance = np.maximum(around_of(moments.count >= 2), 1.0)
    variance = np.nan_to_num(moments.variance_of_mean()[:, :3], nan=0.0)
    squared, careful, at_face = (np.zeros(len(count)) for _ in range(3))
    for c in range(3):
        mean, own = moments.mean[:, c], variance[:, c]
        around = np.maximum((around_of(mean) - same_of(mean)) / others, 0.0)
        noise = around_of(own) / with_variance / (around**2 + floor)
        doubted = np.minimum(without * np.abs(mean), around) - mean
        itself = mean**2 + floor
        believed = mean + doubt * doubted
        careful += own / np.maximum(believed**2 + floor, itself / MOST_DOUBT)
        believed = mean + doubt * noise / (noise + SETTLED) * doubted
        at_face += own / (believed**2 + floor)
        squared += own / np.maximum(believed**2 + floor, itself / MOST_SURPRISE)
    return _Terms(squared / 3 * (1 + UNSEEN * single) ** 2, careful / 3, at_face / 3, single)


def _do_few_decide(
    terms: _Terms, moments: Moments, measured: NDArray[np.bool_], floor: float, correlation: Correlation
) -> bool:
    """Whether a few bright values make the error, so that it may as well be quite another one."""
    squared, by_itself = float(terms.squared[measured].mean()), float(pixel_rel_mse(moments, floor)[measured].mean())
    most = 1 + float(moments.count[measured].mean()) / AT_FACE
    spreads = _spreads(terms.squared, terms.single, moments, measured, correlation)
    # Of a few pixels the true error spreads however well it is estimated: it is the standard error that is said.
    spread = spreads[1] if int(measured.sum()) < MIN_MEASURED else math.hypot(*spreads)
    return (
        spread > MOST_SPREAD
        or squared > MOST_DOUBTED**2 * by_itself
        or float(terms.at_face[measured].mean()) > most**2 * squared
    )


def _with_single(
    squared: NDArray[np.float64], moments: Moments, width: int, measured: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """(n,) the same, with what pixels of one replicate have according to those around them."""
    if measured.all():
        return squared
    shape = (len(squared) // width, width)
    each = np.where(measured, squared * moments.count, 0.0)  # of one replicate
    around, among = (box_sum(values.reshape(shape), AROUND).ravel() for values in (each, measured.astype(np.float64)))
    everywhere = float(each.sum()) / max(int(measured.sum()), 1)
    local = np.where(among >= 0.5, around / np.maximum(among, 1.0), everywhere)
    return np.where(measured, squared, local)


def _spreads(
    squared: NDArray[np.float64],
    single: NDArray[np.float64],
    moments: Moments,
    measured: NDArray[np.bool_],
    correlation: Correlation,
) -> tuple[float, float]:
    """Relative standard deviations of the image's squared error: of the true one, and of its estimate."""
    terms, count = squared[measured], moments.count[measured]
    total = float(terms.sum())
    if total <= 0:
        return 0.0, 0.0
    estimated = 2.0 / np.maximum(count - 1, 1) + 3.0 * single[measured]
    true = 2.0 + 3.0 * single[measured]
    of_truth, of_estimate = (math.sqrt(correlation.spread * float(np.sum(terms**2 * of))) for of in (true, estimated))
    return of_truth / total, of_estimate / total


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
