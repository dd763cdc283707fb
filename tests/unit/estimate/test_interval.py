"""Facts about intervals: they cover what they promise, and what should not be believed is not trusted."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import binom, t

from renderer.estimate.interval import MAX_SHARE, MIN_NONZERO, MIN_REPLICATES, half_width, t_quantile, trust
from renderer.estimate.moments import LUMINANCE, Moments

FALSE_ALARM = 1e-6  # of each statistical test here, were its seed drawn afresh


def grey(values: NDArray | list[float]) -> Moments:
    """Moments of replicates (n,) of one pixel or (n, pixels) of several, the same in R, G and B."""
    array = np.asarray(values, np.float64)
    array = array[:, None] if array.ndim == 1 else array
    moments = Moments.empty(array.shape[1])
    for replicate in array:
        radiance = np.repeat(replicate[:, None], 3, axis=1)
        moments.add(slice(None), radiance, np.zeros(len(replicate), np.uint32), 1)
    return moments


@pytest.mark.parametrize("n_replicates", [2, 3, 5, 10, 40])
@pytest.mark.parametrize("confidence", [0.5, 0.95, 0.99])
def test_intervals_of_normal_data_cover_the_true_mean_as_often_as_promised(
    n_replicates: int, confidence: float
) -> None:
    pixels, true = 20_000, 3.0
    rng = np.random.default_rng(20_000 + n_replicates)
    values = true + 0.5 * rng.standard_normal((n_replicates, pixels, 3))
    moments = Moments.empty(pixels)
    for replicate in values:
        moments.add(slice(None), replicate, np.zeros(pixels, np.uint32), 1)
    widths = half_width(moments, confidence)
    centres = np.concatenate([moments.mean, moments.luminance()[:, None]], axis=1)
    low, high = binom.ppf([FALSE_ALARM / 8, 1 - FALSE_ALARM / 8], pixels, confidence)
    truth = np.array([true, true, true, true * LUMINANCE.sum()])
    for channel in range(4):
        covered = int((np.abs(centres - truth)[:, channel] <= widths[:, channel]).sum())
        assert low <= covered <= high


def test_the_half_width_is_students_quantile_times_the_standard_error() -> None:
    values = [1.0, 2.0, 4.0]
    expected = t.ppf(0.975, 2) * np.std(values, ddof=1) / np.sqrt(3)
    np.testing.assert_allclose(half_width(grey(values)), expected)


@pytest.mark.parametrize(("degrees", "table"), [(1, 12.706), (4, 2.776), (30, 2.042), (1000, 1.962)])
def test_quantiles_are_those_of_the_printed_table(degrees: int, table: float) -> None:
    assert float(t_quantile(0.975, degrees)) == pytest.approx(table, abs=5e-4)


def test_there_is_no_interval_below_two_replicates() -> None:
    assert np.isnan(half_width(Moments.empty(1))).all()
    assert np.isnan(half_width(grey([1.0]))).all()
    assert np.isfinite(half_width(grey([1.0, 2.0]))).all()


def test_higher_confidence_gives_wider_intervals() -> None:
    moments = grey([1.0, 2.0, 4.0, 3.0])
    assert half_width(moments, 0.99)[0, 3] > half_width(moments, 0.95)[0, 3] > half_width(moments, 0.5)[0, 3] > 0


def test_a_constant_pixel_is_trusted_and_has_no_width() -> None:
    moments = grey([0.7] * MIN_REPLICATES)
    assert trust(moments).tolist() == [True]
    assert (half_width(moments) == 0).all()


@pytest.mark.parametrize("scale", [1e-20, 1.0, 1e20])
def test_ordinary_noise_is_trusted_at_any_brightness(scale: float) -> None:
    values = scale * np.random.default_rng(1).uniform(0.5, 1.5, (16, 100))
    assert trust(grey(values)).all()


def test_too_few_replicates_are_not_trusted() -> None:
    assert not trust(Moments.empty(3)).any()
    assert not trust(grey([0.7] * (MIN_REPLICATES - 1))).any()


@pytest.mark.parametrize("n_replicates", [MIN_REPLICATES, 1000])
def test_a_black_pixel_is_not_trusted_however_often_it_was_black(n_replicates: int) -> None:
    assert not trust(grey([0.0] * n_replicates)).any()


def test_too_few_replicates_that_found_light_are_not_trusted() -> None:
    few, enough = [1.0] * (MIN_NONZERO - 1), [1.0] * MIN_NONZERO
    assert not trust(grey(few + [0.0] * 100)).any()
    assert trust(grey(enough + [0.0] * 100)).all()


def test_a_pixel_of_which_one_replicate_carries_the_sum_is_not_trusted() -> None:
    assert not trust(grey([1.0] * 20 + [21.0])).any()
    assert trust(grey([1.0] * 20 + [19.0])).all()
    assert MAX_SHARE == 0.5


def test_a_light_found_once_in_a_thousand_is_hardly_ever_trusted() -> None:
    # 64 replicates of p = 1e-3 each: six hits or more are a matter of 1e-9.
    hits = np.random.default_rng(5).random((64, 50_000)) < 1e-3
    assert not trust(grey(1000.0 * hits)).any()


def test_trust_of_merged_parts_is_that_of_the_whole() -> None:
    values = np.random.default_rng(2).lognormal(0, 2, (16, 400))
    whole, parts = grey(values), grey(values[:8]).merge(grey(values[8:]))
    np.testing.assert_array_equal(trust(whole), trust(parts))
    assert 0 < trust(whole).mean() < 1
