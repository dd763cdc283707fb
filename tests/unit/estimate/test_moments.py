"""Facts about moments: they equal NumPy's, they merge by law, and they stay exact where floating point is cruel."""

from __future__ import annotations

from dataclasses import fields
from functools import reduce
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.stats import skew

import renderer.estimate.moments
from renderer.estimate.moments import LUMINANCE, Moments

REPLICATE_SIZE = 4
LAWS = settings(max_examples=60, deadline=None, derandomize=True)
seeds = st.integers(0, 2**32 - 1)
counts = st.integers(0, 12)
magnitudes = st.integers(-20, 20)


def series(seed: int, n_replicates: int, n_pixels: int = 3, magnitude: int = 0) -> NDArray[np.float32]:
    """(replicates, pixels, 3) float32 radiance around 10^magnitude, with some black."""
    rng = np.random.default_rng(seed)
    values = rng.lognormal(0, 1.5, (n_replicates, n_pixels, 3)) * (rng.random((n_replicates, n_pixels, 1)) < 0.8)
    return (values * 10.0**magnitude).astype(np.float32)


def accumulate(values: NDArray[np.float32], into: Moments | None = None) -> Moments:
    """Adds the replicates one by one."""
    moments = into or Moments.empty(values.shape[1])
    for replicate in values:
        segments = np.arange(len(replicate)) + REPLICATE_SIZE
        moments.add(slice(None), replicate, np.zeros(len(replicate), np.uint32), REPLICATE_SIZE, segments)
    return moments


def assert_same_bits(a: Moments, b: Moments) -> None:
    for field in fields(Moments):
        left, right = getattr(a, field.name), getattr(b, field.name)
        assert left.dtype == right.dtype
        assert left.tobytes() == right.tobytes(), field.name


def assert_close(a: Moments, b: Moments) -> None:
    """Equal counts; mean and m2 to 1e-12 of what they are sums of."""
    for name in ("count", "nonzero", "largest", "invalid", "tried", "segments"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)
    squares = np.maximum(a.m2[:, :3] + a.count[:, None] * a.mean**2, np.finfo(float).tiny)
    scale = np.sqrt(squares / np.maximum(a.count, 1)[:, None])
    assert (np.abs(a.mean - b.mean) <= 1e-12 * scale).all()
    assert (np.abs(a.m2 - b.m2) <= 1e-12 * squares.sum(axis=1, keepdims=True)).all()
    cubes = squares.sum(axis=1) * scale.sum(axis=1) * np.sqrt(np.maximum(a.count, 1))
    assert (np.abs(a.m3 - b.m3) <= 1e-11 * cubes).all()


@LAWS
@given(seed=seeds, n=st.integers(2, 40), magnitude=magnitudes)
def test_adding_gives_the_mean_and_variance_that_numpy_gives(seed: int, n: int, magnitude: int) -> None:
    values = series(seed, n, magnitude=magnitude)
    moments, exact = accumulate(values), values.astype(np.float64)
    np.testing.assert_array_equal(moments.count, n)
    np.testing.assert_allclose(moments.mean, exact.mean(axis=0), rtol=1e-12)
    np.testing.assert_allclose(moments.variance()[:, :3], exact.var(axis=0, ddof=1), rtol=1e-10)
    np.testing.assert_allclose(moments.variance_of_mean()[:, :3], exact.var(axis=0, ddof=1) / n, rtol=1e-10)


@LAWS
@given(seed=seeds, n=st.integers(2, 40), magnitude=magnitudes)
def test_the_variance_of_luminance_is_that_of_the_luminance_series(seed: int, n: int, magnitude: int) -> None:
    values = series(seed, n, magnitude=magnitude)
    luminance = values.astype(np.float64) @ LUMINANCE
    moments = accumulate(values)
    np.testing.assert_allclose(moments.variance()[:, 3], luminance.var(axis=0, ddof=1), rtol=1e-10)
    np.testing.assert_allclose(moments.luminance(), luminance.mean(axis=0), rtol=1e-12)


@LAWS
@given(seed=seeds, n=st.integers(2, 40), magnitude=magnitudes)
def test_skewness_is_that_of_the_luminance_series(seed: int, n: int, magnitude: int) -> None:
    values = series(seed, n, magnitude=magnitude)
    luminance = values.astype(np.float64) @ LUMINANCE
    np.testing.assert_allclose(accumulate(values).skewness(), np.nan_to_num(skew(luminance, axis=0)), atol=1e-9)


def test_luminance_has_less_variance_than_its_channels_say_where_they_cancel() -> None:
    values = np.array([[[1, 0, 0]], [[0, 0.2126 / 0.7152, 0]]], np.float32)
    moments = accumulate(values)
    assert moments.m2[0, 3] < 1e-12 < (LUMINANCE**2 * moments.m2[0, :3]).sum()


@LAWS
@given(seed=seeds, n=counts, magnitude=magnitudes)
def test_merging_empty_moments_changes_nothing(seed: int, n: int, magnitude: int) -> None:
    moments = accumulate(series(seed, n, magnitude=magnitude))
    assert_same_bits(moments.merge(Moments.empty(3)), moments)
    assert_same_bits(Moments.empty(3).merge(moments), moments)


@LAWS
@given(seed=seeds, n=st.tuples(counts, counts), magnitude=magnitudes)
def test_merging_is_commutative(seed: int, n: tuple[int, int], magnitude: int) -> None:
    a, b = (accumulate(series(seed + i, k, magnitude=magnitude)) for i, k in enumerate(n))
    assert_close(a.merge(b), b.merge(a))


@LAWS
@given(seed=seeds, n=st.tuples(counts, counts, counts), magnitude=magnitudes)
def test_merging_is_associative(seed: int, n: tuple[int, int, int], magnitude: int) -> None:
    a, b, c = (accumulate(series(seed + i, k, magnitude=magnitude)) for i, k in enumerate(n))
    assert_close(a.merge(b).merge(c), a.merge(b.merge(c)))


@LAWS
@given(seed=seeds, cuts=st.lists(st.integers(0, 24), max_size=5), magnitude=magnitudes)
def test_however_a_series_is_split_its_parts_merge_to_the_whole(seed: int, cuts: list[int], magnitude: int) -> None:
    values = series(seed, 24, magnitude=magnitude)
    parts = np.split(values, sorted(cuts))
    merged = reduce(Moments.merge, (accumulate(part) for part in parts), Moments.empty(3))
    assert_close(merged, accumulate(values))


def test_merging_leaves_both_operands_as_they_were() -> None:
    a, b = accumulate(series(1, 5)), accumulate(series(2, 5))
    before = a.copy(), b.copy()
    a.merge(b)
    assert_same_bits(a, before[0])
    assert_same_bits(b, before[1])


def test_a_copy_does_not_follow_its_original() -> None:
    original = accumulate(series(1, 3))
    copied, kept = original.copy(), original.copy()
    accumulate(series(2, 3), into=original)
    assert_same_bits(copied, kept)


@LAWS
@given(seed=seeds, stop=st.integers(0, 10))
def test_the_same_replicates_in_the_same_order_give_the_same_bits(seed: int, stop: int) -> None:
    values = series(seed, 10)
    resumed = accumulate(values[stop:], into=accumulate(values[:stop]).copy())
    assert_same_bits(resumed, accumulate(values))


@LAWS
@given(seed=seeds, invalid=st.lists(st.integers(0, REPLICATE_SIZE), min_size=6, max_size=6))
def test_a_slice_and_an_index_array_give_the_same_bits(seed: int, invalid: list[int]) -> None:
    by_slice, by_index = Moments.empty(6), Moments.empty(6)
    bad = np.array(invalid, np.uint32)
    for replicate in series(seed, 3, n_pixels=6):
        by_slice.add(slice(None), replicate, bad, REPLICATE_SIZE)
        by_index.add(np.arange(6, dtype=np.uint32), replicate, bad, REPLICATE_SIZE)
    assert_same_bits(by_slice, by_index)


@LAWS
@given(
    seed=seeds,
    each=st.lists(st.integers(0, 5), min_size=5, max_size=5) | st.integers(1, 5),
    invalid=st.lists(st.integers(0, REPLICATE_SIZE), min_size=25, max_size=25),
    chunk=st.integers(1, 6),
)
def test_runs_of_replicates_give_the_same_bits_as_one_after_the_other(
    seed: int, each: list[int] | int, invalid: list[int], chunk: int
) -> None:
    pixels = np.array([6, 0, 3, 1, 4], np.uint32)
    n = np.broadcast_to(each, 5)
    radiance, bad = series(seed, int(n.sum()), 1)[:, 0], np.array(invalid[: int(n.sum())], np.uint32)
    segments = np.arange(len(bad), dtype=np.uint32)
    by_run, single = accumulate(series(seed + 1, 2, 7)), accumulate(series(seed + 1, 2, 7))
    with patch.object(renderer.estimate.moments, "CHUNK", chunk):
        by_run.add_runs(pixels, each if isinstance(each, int) else n, radiance, bad, REPLICATE_SIZE, segments)
    for lane, pixel in enumerate(np.repeat(pixels, n)):
        one = slice(lane, lane + 1)
        single.add(np.array([pixel]), radiance[one], bad[one], REPLICATE_SIZE, segments[one])
    assert_same_bits(by_run, single)


def test_the_order_of_pixels_within_a_pass_does_not_matter() -> None:
    straight, shuffled = Moments.empty(6), Moments.empty(6)
    order = np.array([3, 0, 5, 1, 4, 2])
    none = np.zeros(6, np.uint32)
    for replicate in series(7, 4, n_pixels=6):
        straight.add(slice(None), replicate, none, REPLICATE_SIZE)
        shuffled.add(order, replicate[order], none, REPLICATE_SIZE)
    assert_same_bits(straight, shuffled)


def test_only_the_pixels_named_receive_a_replicate() -> None:
    moments = Moments.empty(4)
    moments.add(np.array([2]), np.array([[1, 2, 3]], np.float32), np.zeros(1, np.uint32), REPLICATE_SIZE)
    assert moments.count.tolist() == [0, 0, 1, 0]
    assert moments.mean[2].tolist() == [1, 2, 3]
    assert not moments.mean[[0, 1, 3]].any()


def test_samples_that_are_not_finite_are_counted_beside_the_replicate() -> None:
    moments = Moments.empty(2)
    moments.add(slice(None), np.array([[1, 1, 1], [2, 2, 2]], np.float32), np.array([3, 0], np.uint32), REPLICATE_SIZE)
    assert moments.invalid.tolist() == [3, 0]
    assert moments.count.tolist() == [1, 1]
    assert moments.mean[:, 0].tolist() == [1, 2]


@pytest.mark.parametrize("pixels", [slice(None), np.arange(3)], ids=["slice", "indices"])
def test_a_replicate_without_a_finite_sample_is_not_counted(pixels: slice | NDArray[np.int64]) -> None:
    moments = accumulate(series(3, 2))
    before = moments.copy()
    replicate = np.array([[0, 0, 0], [5, 5, 5], [0, 0, 0]], np.float32)
    moments.add(pixels, replicate, np.array([REPLICATE_SIZE, 1, REPLICATE_SIZE], np.uint32), REPLICATE_SIZE)
    assert moments.count.tolist() == [2, 3, 2]
    assert moments.invalid.tolist() == [REPLICATE_SIZE, 1, REPLICATE_SIZE]
    for name in ("mean", "m2", "m3", "nonzero", "largest"):
        np.testing.assert_array_equal(getattr(moments, name)[[0, 2]], getattr(before, name)[[0, 2]])


@pytest.mark.parametrize("value", [0.0, 0.7, 1e-20, 1e20, 3.3e38, 1.4e-45])
def test_a_constant_series_has_no_variance_at_all(value: float) -> None:
    moments = accumulate(np.full((200, 1, 3), value, np.float32))
    assert (moments.m2 == 0).all()
    assert (moments.mean == np.float64(np.float32(value))).all()
    halves = accumulate(np.full((7, 1, 3), value, np.float32)).merge(accumulate(np.full((5, 1, 3), value, np.float32)))
    assert (halves.m2 == 0).all()


def test_many_replicates_of_a_constant_keep_its_mean() -> None:
    # In float32 the sum of 1e7 times 0.7 is 9 % off.
    half = Moments.empty(1)
    half.add(slice(None), np.full((1, 3), 0.7, np.float32), np.zeros(1, np.uint32), 1)
    for _ in range(27):  # 2^27 > 1e8
        half = half.merge(half)
    assert int(half.count[0]) == 2**27
    assert half.mean[0, 0] == pytest.approx(np.float32(0.7), rel=1e-12)
    assert (half.m2 == 0).all()


@LAWS
@given(seed=seeds, n=st.integers(1, 20), magnitude=magnitudes)
def test_a_sum_of_squared_deviations_is_never_negative(seed: int, n: int, magnitude: int) -> None:
    rng = np.random.default_rng(seed)
    centre = rng.random((1, 64, 3)) * 10.0**magnitude
    nearly_constant = (centre * (1 + 1e-7 * rng.standard_normal((n, 64, 3)))).astype(np.float32)
    moments = accumulate(nearly_constant)
    assert (moments.m2 >= 0).all()
    assert (moments.merge(accumulate(nearly_constant[::-1])).m2 >= 0).all()


def test_luminance_m2_is_not_negative_where_only_the_hue_varies() -> None:
    # Steps along (361, 0, −1063) leave the luminance as it is: what is left of it is rounding, of either sign.
    rng = np.random.default_rng(0)
    centre = rng.integers(0, 100_000, (1, 2000, 3)) + np.array([0, 0, 200_000])
    steps = rng.integers(0, 100, (6, 2000, 1)) * np.array([361, 0, -1063])
    moments = accumulate((centre + steps).astype(np.float32))
    assert (moments.m2 >= 0).all()


def test_variance_is_unknown_below_two_replicates() -> None:
    assert np.isnan(Moments.empty(2).variance()).all()
    assert np.isnan(accumulate(series(0, 1)).variance_of_mean()).all()


def test_black_replicates_are_not_among_the_nonzero() -> None:
    values = np.array([[[0, 0, 0]], [[1, 0, 0]], [[0, 0, 0]], [[0, 2, 0]]], np.float32)
    moments = accumulate(values)
    assert moments.nonzero.tolist() == [2]
    assert moments.largest[0] == pytest.approx(2 * 0.7152)


def test_merging_keeps_the_brightest_replicate_and_adds_the_counts() -> None:
    a, b = accumulate(series(1, 4)), accumulate(series(2, 5))
    merged = a.merge(b)
    np.testing.assert_array_equal(merged.largest, np.maximum(a.largest, b.largest))
    np.testing.assert_array_equal(merged.nonzero, a.nonzero + b.nonzero)
    np.testing.assert_array_equal(merged.count, 9)
