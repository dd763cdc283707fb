"""How many replicates each pixel shall have next: more where they lower the image error most. Pure, NumPy only.

Enters: the moments at the end of a round. Leaves: for every pixel the number of replicates at the end of the next one.

The image error is Σ v/(n·d) with v the variance of a replicate and d = mean² + floor; with c the cost of a replicate,
it is least for a given time Σ c·n where n ∝ √(v/(d·c)). Cost is counted in path segments, not in seconds: the same
counts come out on every machine. A pixel's own values must not decide how often it is sampled: one that found its
light early would be sampled on and diluted, one that did not would be left dark, and the mean would be biased. So v/d
and c come from the pixel's neighbours alone; given their values its count is a constant, and its mean unbiased. A
floor keeps every pixel going, so that light which nobody has found yet is still looked for; a limit on growth bounds
what one odd value can do.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from renderer.estimate.error import floor_of
from renderer.estimate.interval import MIN_REPLICATES
from renderer.estimate.moments import Moments
from renderer.estimate.neighbours import box_sum, doubled, event_rate, halved
from renderer.stopping import CHECKPOINT_GROWTH

MOST_GROWTH = 1.5  # of a round whose planning would otherwise take a notable part of the time
EVEN_GROWTH = 2.0  # of one that nothing is to be gained by
EVEN = 0.93  # of the error of equal numbers: what the aimed ones must leave for equal ones to be preferred
MAX_GROWTH = 2.0  # of one pixel's replicates, per round
FLOOR_SHARE = 0.1  # of the replicates that go to all pixels alike
EARLY_SHARE = 0.75  # of the mean count that every pixel has at least, until its interval can be trusted
WINDOW = 3
EVENTS = 5.0  # expected rare bright values after which a neighbourhood is taken at its own word
IMAGE_EVENTS = 150.0  # the same for the whole image: fewer say nothing about where they are to be expected,
STEEPNESS = 3.0  # many more say all
OWN_LEVELS = 3  # of the coarser windows, from which a pixel is left out one by one; it is a 576th of the next
GOLDEN = 0.6180339887498949
STEPS, CLOSE = 60, 1e-9  # of the search for the level that a budget fills, and how near to the budget it comes


def next_counts(
    moments: Moments, width: int, height: int, focus: NDArray[np.bool_] | None = None, least: float = 0.0
) -> NDArray[np.int64]:
    """(n,) replicates of each pixel at the end of the next round; in all, CHECKPOINT_GROWTH times what there is.

    focus: (n,) pixels whose error counts; the others get the floor alone. least: replicates per pixel, in the mean,
    that a round shall have, within MOST_GROWTH: planning is not free. For the same reason, where the counts that would
    be aimed at would hardly do better, equal ones stay equal for a round of EVEN_GROWTH, and others may have as long a
    round.
    """
    own = _relative_variance(moments)
    wanting, certainty = _wanting(moments, own, width, height)
    wanting, cost = np.fmax(wanting, 0.0), _cost(moments, width, height)  # differences may round below zero
    weight = np.sqrt(wanting / cost)
    if focus is not None:
        weight, certainty = np.where(focus, weight, 0.0), 1.0
    n, tried = len(weight), moments.tried.astype(np.float64)
    share, total = np.full(n, 1.0 / n), float(weight.sum())
    if np.isfinite(total) and total > 0:
        led = (1 - FLOOR_SHARE) * certainty
        share = (1 - led) / n + led * weight / total
    now = float(tried.mean())
    limit = MOST_GROWTH
    if focus is None and _is_even(share, own, np.maximum(moments.segments, 1) / tried):
        limit = EVEN_GROWTH
        if int(moments.tried.min()) == int(moments.tried.max()):
            return np.full_like(moments.tried, math.ceil(limit * now))
    mean = min(max(CHECKPOINT_GROWTH * now, now + least), limit * now)
    everywhere = min(MIN_REPLICATES, EARLY_SHARE * mean)
    more = _poured(share, tried, everywhere, max(1.0, (mean - now) * n))
    # Fractions are rounded up or down by a fixed pattern that differs from round to round.
    pattern = (np.arange(n) * GOLDEN + float(tried.sum()) * (GOLDEN / 7)) % 1.0
    whole = np.floor(more + pattern).astype(np.int64)
    if not whole.any():
        whole[int(np.argmax(more))] = 1
    return moments.tried + whole


def _is_even(share: NDArray[np.float64], own: NDArray[np.float64], cost: NDArray[np.float64]) -> bool:
    """Whether replicates in proportion to `share` leave nearly as much error, at equal cost, as equal numbers.

    own, cost: (n,) each pixel's variance and cost, of which its share knows nothing: what the shares were made of would
    flatter them.
    """
    return float((own / share).mean() * (share * cost).mean()) >= EVEN * float(own.mean() * cost.mean())


def _relative_variance(moments: Moments) -> NDArray[np.float64]:
    """(n,) relative variance of one replicate of each pixel; 0 where there are less than two."""
    variance = moments.m2[:, :3] / np.maximum(moments.count - 1, 1)[:, None]
    relative = np.mean(variance / (moments.mean**2 + floor_of(moments.mean)), axis=1)
    return np.where(moments.count >= 2, relative, 0.0)


def _wanting(moments: Moments, own: NDArray[np.float64], width: int, height: int) -> tuple[NDArray[np.float64], float]:
    """(n,) relative variance of one replicate, from the neighbours of each pixel and without itself; and how far
    (0 … 1) the image tells where its variance is.

    Where the tail is heavy, a quiet neighbourhood may just not have had its share of rare bright values yet. How many
    of those it ought to have had, were it like its wider surroundings, says how far it is taken at its own word.
    """
    shape = (height, width)
    measured = moments.count >= 2
    third = np.abs(moments.skewness()) * own**1.5
    sums = own_sums = np.stack([a.reshape(shape) for a in (own, third, measured, moments.count)]).astype(np.float64)
    shapes, levels = [shape], [box_sum(sums, WINDOW)]
    while max(shapes[-1]) > WINDOW:
        sums = halved(sums)
        shapes.append((sums.shape[-2], sums.shape[-1]))
        levels.append(box_sum(sums, WINDOW))
    whole = sums.sum(axis=(-2, -1), keepdims=True)

    wanting = whole[0] / np.maximum(whole[2], 1.0)
    events = event_rate(whole[0], whole[1], whole[2])
    seen = float(events[0, 0] * whole[3][0, 0])
    certainty = 1.0 if np.isnan(seen) else 1 / (1 + (IMAGE_EVENTS / max(seen, 1e-9)) ** STEEPNESS)
    for k in reversed(range(len(levels))):
        window = levels[k]
        if k <= OWN_LEVELS:
            # From here on per pixel, without the pixel itself.
            window = np.maximum(_spread(window, shapes[:k]) - own_sums, 0.0)
        total, cubed, among, replicates = window
        if wanting.shape != total.shape:
            between = shapes[: k + 1] if k == OWN_LEVELS else [total.shape]
            wanting, events = _spread(np.stack((wanting, events)), between)
        # Of a single pixel nothing is left without itself, and events may be without end.
        expected = np.minimum(replicates * np.minimum(events, 1e12), 1e12)
        here = total / np.maximum(among, 1.0)
        wanting = (expected * here + EVENTS * wanting) / (expected + EVENTS)
        events = event_rate(total, cubed, among)
    return wanting.ravel(), certainty


def _spread(values: NDArray[np.float64], shapes: list[tuple[int, int]]) -> NDArray[np.float64]:
    """Values of a coarse level on the finest of `shapes`, each of which is about twice the next."""
    for shape in reversed(shapes):
        values = doubled(values, shape)
    return values


def _cost(moments: Moments, width: int, height: int) -> NDArray[np.float64]:
    """(n,) path segments that a replicate takes, from the neighbours of each pixel and without itself; 1 if unknown."""
    segments, tried = (a.reshape(height, width).astype(np.float64) for a in (moments.segments, moments.tried))
    both = np.stack((segments, tried))
    around, among = np.maximum(box_sum(both, WINDOW) - both, 0.0)
    known = (around >= 1) & (among >= 1)
    return np.where(known, around / np.maximum(among, 1.0), max(1.0, float(segments.sum() / tried.sum()))).ravel()


def _poured(share: NDArray[np.float64], level: NDArray[np.float64], least: float, budget: float) -> NDArray[np.float64]:
    """(n,) replicates to add, `budget` in all: up to a common multiple of `share` or to `least`, like water poured over
    an uneven ground; none taken away, none beyond MAX_GROWTH."""
    most = np.maximum((MAX_GROWTH - 1) * level, 1.0)
    if most.sum() <= budget:
        return most

    def added(multiple: float) -> NDArray[np.float64]:
        return np.clip(np.maximum(multiple * share, least) - level, 0.0, most)

    low, high = 0.0, (float(level.sum()) + budget) / float(share.sum())
    while added(high).sum() < budget:
        high *= 2.0
    # Newton's steps on what is piecewise linear and never falls; halves where a step leads out of the bounds.
    middle = high
    for _ in range(STEPS):
        found = added(middle)
        missing = budget - float(found.sum())
        if abs(missing) <= CLOSE * budget:
            return found
        low, high = (middle, high) if missing > 0 else (low, middle)
        rising = (middle * share > least) & (found > 0) & (found < most)
        slope = float(share[rising].sum())
        middle += missing / slope if slope > 0 else 0.0
        if not low < middle < high:
            middle = 0.5 * (low + high)
    return added(high)
