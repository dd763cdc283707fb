"""Facts about the plan: nobody is forgotten, nobody is served twice, and stopping in between changes nothing."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from renderer.plan import (
    FIRST_REPLICATES,
    FIRST_SAMPLES,
    LEAST_LANES,
    MAX_PASS_SAMPLES,
    MIN_PASS_SAMPLES,
    MOST_TOGETHER,
    PASS_SECONDS,
    PASS_SEGMENTS,
    Pass,
    coarse_stride,
    next_round,
    pass_samples_for,
    sample_of,
)
from renderer.stopping import is_checkpoint, next_checkpoint

LAWS = settings(max_examples=40, deadline=None, derandomize=True)
sizes = st.one_of(
    st.tuples(st.integers(1, 90), st.integers(1, 90)),
    st.tuples(st.just(1), st.integers(1, 5000)),
    st.tuples(st.integers(1, 5000), st.just(1)),
)
replicate_sizes = st.sampled_from([1, 4, 16, 64])
wanted_counts = st.one_of(st.none(), st.integers(1, 9))


def apply(work: Pass, count: NDArray[np.int64]) -> None:
    """What rendering the pass does to the counts, if every lane is the next replicate of its pixel."""
    assert len(set(work.pixels.tolist())) == len(work.pixels)
    assert (count[work.pixels] == work.first).all()
    count[work.pixels] += work.n_replicates


def budgets(*samples: int) -> Callable[[], int]:
    """Samples that each pass in turn may have, over and over."""
    return itertools.cycle(samples or (2**20,)).__next__


def plan_round(
    count: NDArray[np.int64], size: tuple[int, int], b: int, wanted: int | None = None, samples: tuple[int, ...] = ()
) -> list[Pass]:
    return list(next_round(count, *size, b, wanted, budgets(*samples)))


@LAWS
@given(size=sizes, b=replicate_sizes, wanted=wanted_counts)
@example(size=(1, 1), b=64, wanted=None)
@example(size=(257, 255), b=64, wanted=None)
@example(size=(1023, 3), b=64, wanted=1)
def test_the_first_round_gives_every_pixel_its_first_replicates_once(
    size: tuple[int, int], b: int, wanted: int | None
) -> None:
    count = np.zeros(size[0] * size[1], np.int64)
    for work in plan_round(count.copy(), size, b, wanted):
        apply(work, count)
    assert count.min() >= 1
    assert count.max() <= (1 if wanted == 1 else FIRST_REPLICATES)


@pytest.mark.parametrize(
    ("low", "is_checked", "left", "together"),
    [
        (1, False, math.inf, 3),  # until adaptive rounds may begin
        (10, False, math.inf, 10),
        (10, False, 3.2, 3),  # all pixels have their share before the time is over
        (10, False, 0.1, 1),
        (100, False, math.inf, MOST_TOGETHER),
        (20, True, math.inf, 3),  # no checkpoint is passed over
        (2, True, math.inf, 1),
    ],
)
def test_replicates_of_a_pixel_run_together_even_if_a_pass_has_no_room_for_all_pixels(
    low: int, is_checked: bool, left: float, together: int
) -> None:
    """left: replicates of all pixels that there is time for."""
    count, b = np.full(128 * 128, low, np.int64), 16
    passes = list(next_round(count.copy(), 128, 128, b, None, lambda: 2**17, is_checked, left * b * len(count)))
    assert all(work.n_replicates == together for work in passes)
    assert len(passes) == max(1, round(len(count) * b * together / 2**17))
    for work in passes:
        apply(work, count)
    assert (count == low + together).all()


def test_a_round_that_was_stopped_is_finished_as_it_was_begun() -> None:
    count = np.full(128 * 128, 10, np.int64)
    begun = next(next_round(count.copy(), 128, 128, 16, None, lambda: 2**17, False))
    apply(begun, count)
    for work in next_round(count.copy(), 128, 128, 16, None, lambda: 2**17, False):
        assert work.n_replicates == begun.n_replicates
        apply(work, count)
    assert (count == 10 + begun.n_replicates).all()


@LAWS
@given(size=sizes, b=replicate_sizes, low=st.integers(1, 40), seed=st.integers(0, 99), share=st.floats(0, 1))
def test_a_later_round_serves_exactly_the_pixels_of_lowest_count(
    size: tuple[int, int], b: int, low: int, seed: int, share: float
) -> None:
    n = size[0] * size[1]
    count = low + (np.random.default_rng(seed).random(n) < share).astype(np.int64)
    low = int(count.min())
    passes = plan_round(count.copy(), size, b)
    served = np.concatenate([work.pixels for work in passes])
    assert sorted(served.tolist()) == np.flatnonzero(count == low).tolist()
    for work in passes:
        apply(work, count)
    assert count.min() > low


@LAWS
@given(size=sizes, b=replicate_sizes)
def test_several_replicates_at_once_never_skip_a_checkpoint(size: tuple[int, int], b: int) -> None:
    count = np.zeros(size[0] * size[1], np.int64)
    seen = []
    while (low := int(count.min())) < 30:
        for work in plan_round(count.copy(), size, b):
            apply(work, count)
        assert int(count.min()) <= next_checkpoint(low)
        seen += [low] if is_checkpoint(low) else []
    assert seen == [c for c in range(30) if is_checkpoint(c)]


@LAWS
@given(size=sizes, b=replicate_sizes, wanted=st.integers(1, 9))
@example(size=(300, 300), b=64, wanted=3)
def test_no_pixel_gets_more_replicates_than_wanted(size: tuple[int, int], b: int, wanted: int) -> None:
    count = np.zeros(size[0] * size[1], np.int64)
    while count.min() < wanted:
        for work in plan_round(count.copy(), size, b, wanted):
            apply(work, count)
        assert count.max() <= wanted
    assert (count == wanted).all()


@settings(max_examples=30, deadline=None, derandomize=True)
@given(size=st.tuples(st.integers(1, 400), st.integers(1, 300)), stops=st.lists(st.integers(0, 7), max_size=4))
@example(size=(400, 300), stops=[1, 1, 1])
@example(size=(399, 1), stops=[0, 2])
def test_a_render_stopped_after_any_passes_goes_on_with_the_same_lanes(size: tuple[int, int], stops: list[int]) -> None:
    # `apply` sees to it that each lane is its pixel's next replicate: the final counts say which lanes there were.
    count = np.zeros(size[0] * size[1], np.int64)
    for stop in [*stops, *itertools.repeat(None, 50)]:
        for work in itertools.islice(next_round(count.copy(), *size, 64, 3, budgets(2**20, 2**18)), stop):
            apply(work, count)
        if count.min() == 3:
            break
    assert (count == 3).all()


@LAWS
@given(width=st.integers(1, 3000), height=st.integers(1, 3000), b=replicate_sizes)
@example(width=16384, height=16384, b=64)
@example(width=16384, height=1, b=64)
@example(width=1, height=1, b=1)
def test_the_first_pass_is_a_regular_grid_that_fits_its_samples(width: int, height: int, b: int) -> None:
    if width * height > 2**24:  # the plan of such an image takes long; its stride says the same
        stride = coarse_stride(width, height, b)
        assert -(-width // stride) * -(-height // stride) * b * FIRST_REPLICATES <= FIRST_SAMPLES
        return
    count = np.zeros(width * height, np.int64)
    first = next(next_round(count, width, height, b, None, budgets(FIRST_SAMPLES)))
    assert first.n_lanes * b <= FIRST_SAMPLES
    rows, columns = np.divmod(first.pixels.astype(np.int64), width)
    stride = coarse_stride(width, height, b)
    assert stride & (stride - 1) == 0
    expected = [(r, c) for r in range(0, height, stride) for c in range(0, width, stride)]
    assert sorted(zip(rows.tolist(), columns.tolist(), strict=True)) == expected


@pytest.mark.parametrize(("pass_samples", "finer"), [(2**17, 2), (2**16, 1)])
def test_the_first_whole_picture_has_two_replicates_everywhere_where_that_is_soon_done(
    pass_samples: int, finer: int
) -> None:
    """128 × 128 pixels with two replicates of 16 are four passes of 2^17 samples."""
    passes = list(next_round(np.zeros(128 * 128, np.int64), 128, 128, 16, None, lambda: pass_samples))
    assert passes[0].n_replicates == FIRST_REPLICATES
    assert passes[-1].n_replicates == finer
    alone = list(next_round(np.zeros(128 * 128, np.int64), 128, 128, 16, 1, lambda: pass_samples))
    assert all(work.n_replicates == 1 for work in alone)


def test_where_time_is_short_every_pixel_has_one_replicate_before_any_has_two_but_the_first_grid() -> None:
    n, b = 128 * 128, 1
    for left, most in ((1.5, 1), (8.0, FIRST_REPLICATES)):
        count = np.zeros(n, np.int64)
        passes = list(next_round(count.copy(), 128, 128, b, None, lambda: 2**13, samples_left=left * b * n))
        for work in passes:
            apply(work, count)
        assert passes[0].n_lanes * b <= 2**13, "the first picture is no later than any pass"
        assert [work.n_replicates for work in passes[1:]] == [most] * (len(passes) - 1)
        assert count.min() == most


def test_passes_of_a_short_time_are_a_fraction_of_it() -> None:
    assert pass_samples_for(2e6, seconds=0.4) == pytest.approx(2e6 * 0.05)
    assert pass_samples_for(2e6, seconds=1e3) == pass_samples_for(2e6) == pytest.approx(2e6 * PASS_SECONDS)
    assert pass_samples_for(1e3, seconds=0.3) < MIN_PASS_SAMPLES


@pytest.mark.parametrize(("size", "n"), [((1, 1), 64), ((3, 5), 4), ((640, 360), 4096), ((1920, 1080), 2**16)])
def test_a_sample_of_the_pixels_comes_from_all_over_the_image(size: tuple[int, int], n: int) -> None:
    pixels = sample_of(*size, n)
    assert len(np.unique(pixels)) == len(pixels) <= max(n, 16)
    rows = pixels // size[0]
    if size[1] > 100:
        assert len(pixels) == n
        assert np.histogram(rows, 4, (0, size[1]))[0].min() > 0.15 * n


def test_a_small_image_is_whole_at_once() -> None:
    passes = plan_round(np.zeros(64 * 64, np.int64), (64, 64), 16)
    assert [(len(p.pixels), p.first, p.n_replicates) for p in passes] == [(64 * 64, 0, FIRST_REPLICATES)]


@LAWS
@given(size=sizes, b=replicate_sizes, low=st.integers(0, 30), budget=st.integers(MIN_PASS_SAMPLES, MAX_PASS_SAMPLES))
@example(size=(700, 500), b=16, low=3, budget=2**20)
@example(size=(700, 500), b=16, low=0, budget=2**17)
@example(size=(9000, 9), b=64, low=0, budget=2**17)
def test_no_pass_is_more_than_half_as_large_again_as_asked_for(
    size: tuple[int, int], b: int, low: int, budget: int
) -> None:
    count = np.full(size[0] * size[1], low, np.int64)
    for work in plan_round(count, size, b, samples=(budget,)):
        # Equal parts, no small remainder: hence not exactly the budget.
        assert 0 < work.n_lanes * b <= 1.5 * budget + work.n_replicates * b
        assert work.pixels.dtype == np.uint32


@LAWS
@given(
    size=sizes,
    b=replicate_sizes,
    low=st.integers(0, 9),
    samples=st.lists(st.integers(2**10, 2**22), min_size=2, max_size=5),
)
def test_passes_that_shrink_and_grow_within_a_round_serve_everyone_once(
    size: tuple[int, int], b: int, low: int, samples: list[int]
) -> None:
    count = np.full(size[0] * size[1], low, np.int64)
    for work in plan_round(count.copy(), size, b, samples=tuple(samples)):
        apply(work, count)
    assert count.min() > low


def test_the_size_of_a_pass_follows_the_speed_within_its_limits() -> None:
    assert pass_samples_for(0) == MIN_PASS_SAMPLES
    assert pass_samples_for(1e12) == MAX_PASS_SAMPLES
    assert pass_samples_for(2e6) == pytest.approx(2e6 * PASS_SECONDS)


def test_planning_does_not_change_the_counts() -> None:
    count = np.arange(12) % 3
    before = count.copy()
    plan_round(count, (4, 3), 16)
    np.testing.assert_array_equal(count, before)


def test_passes_are_smaller_where_paths_are_long() -> None:
    assert pass_samples_for(1.0, 5.0, 16) == MIN_PASS_SAMPLES
    assert pass_samples_for(1.0, 1e3, 16) == int(PASS_SEGMENTS / 1e3) < MIN_PASS_SAMPLES
    assert pass_samples_for(1.0, 1e9, 16) == 16 * LEAST_LANES, "a processor's vectors are filled"
    assert pass_samples_for(1e9, 5.0, 16) == MAX_PASS_SAMPLES
