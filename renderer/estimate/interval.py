"""Confidence intervals of pixels, and which of them can be believed.

Enters: moments. Leaves: Student t intervals with count − 1 degrees of freedom, and a trust flag per pixel.

A pixel whose light has hardly been found yet has a small or zero variance for the wrong reason: it is untrusted, never
"perfect". Its own few replicates cannot tell, so its neighbourhood is asked, in windows that double: how skewed are
replicates there, that is, of how few bright values is the variance made up? A pixel is believed where it would have had
enough of them (EVENTS) to show, were it like the window around it; that window where it would have had enough, were it
like the next, and so on up to the image; or where what it may be missing is small against its interval. Neighbours
decide together: a pixel alone among doubtful ones has been lucky, and is doubtful too. `tests/coverage_study` measures
what these limits are worth.

Whether a *standard error* is known at all is decided here, too, for files, readings and the page (`standard_error`):
not below two replicates, nor where a value was 0 in every replicate of a pixel that is not trusted. What was never
found has no spread for the wrong reason; where n replicates held nothing, one in n/3 of them may hold any amount. A
pixel that is trusted has met what its light is made of, often enough: that no blue, or no circular light, was in it, is
then told by the same samples, and is 0 ± 0. The error of the whole picture is another question (`error.py`): to it a
black pixel adds nothing but what its neighbours and the audit say.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from renderer.estimate.correlation import INDEPENDENT, Correlation
from renderer.estimate.moments import Moments
from renderer.estimate.neighbours import Map, box_mean, box_sum, doubled, event_rate, halved

MIN_REPLICATES = 12
MIN_NONZERO = 6
MAX_SHARE = 0.5  # of the sum that one replicate may carry
EVENTS = 10.0  # below, skewness takes more than 2 % off the coverage of a 95 % interval
MISSING = 0.25  # of the half width that unseen bright values may make up
WINDOW = 7
AGREEMENT = 0.9  # share of the window that must pass
FLOOR = 0.1  # of the image mean: what keeps dark pixels from dominating anything relative
ROUNDING = 1e-6  # relative standard deviation that float32 alone makes


def t_quantile(probability: float, degrees: NDArray | float) -> NDArray:
    """Quantile of Student's t distribution."""
    degrees = np.asarray(degrees)
    # A quantile takes a microsecond, and the pixels of an image share a few hundred counts.
    if degrees.dtype.kind in "iu" and degrees.min(initial=0) >= 0 and degrees.max(initial=0) < degrees.size:
        return stdtrit(np.arange(int(degrees.max(initial=0)) + 1), probability)[degrees]
    return stdtrit(degrees, probability)


def half_width(moments: Moments, confidence: float = 0.95) -> NDArray[np.float64]:
    """(n, 4) half width of the two-sided interval of R, G, B, Y; NaN where count < 2."""
    quantile = t_quantile(0.5 + confidence / 2, np.maximum(moments.count - 1, 1))
    return quantile[:, None] * np.sqrt(moments.variance_of_mean())


def standard_error(moments: Moments, trusted: NDArray[np.bool_]) -> NDArray[np.float64]:
    """(n, 4) standard error of the mean of R, G, B, Y; NaN where it is not known. trusted: (n,) by `trust`."""
    largest = np.abs(moments.mean).max(axis=1, initial=0.0)
    values = np.concatenate([moments.mean, largest[:, None]], axis=1)
    return _where_known(moments.variance_of_mean(), values, trusted)


def stokes_standard_error(moments: Moments, trusted: NDArray[np.bool_]) -> NDArray[np.float64]:
    """(n, 9) the same of S1 to S3; (n, 0) where light is not polarised."""
    return _where_known(moments.stokes_variance_of_mean(), moments.stokes, trusted)


def _where_known(
    variance: NDArray[np.float64], mean: NDArray[np.float64], trusted: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """(n, k) roots of variances of means; NaN where nothing but 0 was found, and that is not trusted."""
    never_found = (variance == 0) & (mean == 0) & ~trusted[:, None]
    return np.where(never_found, np.nan, np.sqrt(variance))


def trust(moments: Moments, width: int, correlation: Correlation = INDEPENDENT) -> NDArray[np.bool_]:
    """(n,) whether each pixel's interval can be believed. width: of the image that the pixels form, row by row.
    correlation: of neighbouring pixels.
    """
    if moments.count.max(initial=0) < MIN_REPLICATES:
        return np.zeros(len(moments.count), bool)
    total = np.abs(moments.luminance()) * moments.count
    alone = (
        (moments.count >= MIN_REPLICATES) & (moments.nonzero >= MIN_NONZERO) & (moments.largest <= MAX_SHARE * total)
    )
    return alone & _is_settled(moments, width, correlation.events) if alone.any() else alone


def _is_settled(moments: Moments, width: int, repeated: float) -> NDArray[np.bool_]:
    """(n,) whether enough bright values have been seen, here and around. repeated: times that each is counted there."""
    shape = (len(moments.count) // width, width)
    measured = moments.count >= 2
    own = np.abs(moments.luminance())
    floor = max(FLOOR * float(own.mean()), np.finfo(np.float64).tiny)
    around = box_mean(own.reshape(shape), WINDOW).ravel()
    # Relative to something between the pixel and its surroundings: neither an edge nor a bright value decides alone.
    scale = (own + floor) * (around + floor)
    with np.errstate(invalid="ignore", over="ignore"):
        variance = moments.m2[:, 3] / np.maximum(moments.count - 1, 1) / scale
    variance = np.where(measured & (variance > ROUNDING**2), variance, 0.0)
    third = np.abs(moments.skewness()) * variance**1.5
    quantile = t_quantile(0.975, np.maximum(moments.count - 1, 1))
    tolerated = (MISSING * quantile * np.sqrt(variance / np.maximum(moments.count, 1))).reshape(shape)

    sums = tuple(a.reshape(shape).astype(np.float64) for a in (variance, third, measured, moments.count))
    around = tuple(box_sum(a, WINDOW) for a in sums)
    passed = sums[3] * event_rate(*around[:3]) >= EVENTS
    doubts: list[Map] = []  # what may be missing, per level, where too few bright values were to be expected
    while max(sums[0].shape) > WINDOW:
        sums = tuple(halved(a) for a in sums)
        around = tuple(box_sum(a, WINDOW) for a in sums)
        # The window before has a quarter of the replicates.
        doubts.append(_doubt(around[3] / (4 * repeated), *around[:3]))
    whole = tuple(np.full((1, 1), a.sum()) for a in sums)
    doubt = _doubt(np.full((1, 1), around[3].max() / repeated), *whole[:3])
    for narrower in reversed(doubts):
        doubt = np.maximum(doubled(doubt, narrower.shape), narrower)
    passed &= doubled(doubt, shape) <= tolerated
    return (box_mean(passed.astype(np.float64), WINDOW) >= AGREEMENT).ravel() & passed.ravel()


def _doubt(replicates: Map, variance: Map, third: Map, among: Map) -> Map:
    """Relative radiance that rare bright values contribute on average; 0 where `replicates` were enough to see them."""
    is_enough = replicates * event_rate(variance, third, among) >= EVENTS
    with np.errstate(divide="ignore", invalid="ignore"):
        contribution = variance**2 / (third * np.maximum(among, 1.0))
    return np.where(is_enough, 0.0, np.nan_to_num(contribution))
