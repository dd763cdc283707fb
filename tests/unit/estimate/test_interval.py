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


def alone(values: NDArray | list[float]) -> NDArray[np.bool_]:
    """Trust of one pixel that is the whole image."""
    return trust(grey(values), 1)


def image(values: NDArray, side: int) -> NDArray[np.bool_]:
    """Trust of a side × side image, from replicates (n, pixels)."""
    return trust(grey(values), side).reshape(side, side)


def test_a_constant_pixel_is_trusted_and_has_no_width() -> None:
    values = [0.7] * MIN_REPLICATES
    assert alone(values).tolist() == [True]
    assert (half_width(grey(values)) == 0).all()


@pytest.mark.parametrize("scale", [1e-20, 1.0, 1e20])
def test_ordinary_noise_is_trusted_at_any_brightness(scale: float) -> None:
    assert image(scale * np.random.default_rng(1).uniform(0.5, 1.5, (16, 400)), 20).all()


def test_too_few_replicates_are_not_trusted() -> None:
    assert not trust(Moments.empty(3), 3).any()
    assert not alone([0.7] * (MIN_REPLICATES - 1)).any()


@pytest.mark.parametrize("n_replicates", [MIN_REPLICATES, 1000])
def test_a_black_pixel_is_not_trusted_however_often_it_was_black(n_replicates: int) -> None:
    assert not alone([0.0] * n_replicates).any()


def test_too_few_replicates_that_found_light_are_not_trusted() -> None:
    assert not alone([1.0] * (MIN_NONZERO - 1) + [0.0] * 100).any()


def test_one_bright_value_among_equal_ones_is_not_trusted_and_many_are() -> None:
    assert not alone([1.0] * 40 + [5.0]).any()
    assert not alone([1.0] * 20 + [21.0]).any()
    assert alone([1.0] * 40 + [5.0] * 20).all()
    assert MAX_SHARE == 0.5


@pytest.mark.parametrize(("probability", "n_replicates"), [(1e-3, 16), (1e-3, 64), (1e-4, 64), (1e-4, 256)])
def test_a_light_hardly_found_is_not_trusted_where_it_was_not_found_either(
    probability: float, n_replicates: int
) -> None:
    # Replicates of 16 samples over a steady background. Most pixels have not met the light and look perfect.
    rng = np.random.default_rng(5)
    hits = rng.binomial(16, probability, (n_replicates, 4096)) / (16 * probability)
    settled = image(1.0 + 0.1 * rng.standard_normal(hits.shape) + hits, 64)
    assert (hits.sum(axis=0) == 0).mean() > 0.1
    assert settled.mean() < 0.01


def test_a_rare_light_in_one_half_leaves_the_other_half_untrusted_until_enough_was_seen() -> None:
    rng = np.random.default_rng(6)
    lit = np.tile(np.arange(64) < 32, 64)

    def settled(n_replicates: int) -> NDArray[np.bool_]:
        hits = rng.binomial(16, 1e-3, (n_replicates, 4096)) / (16 * 1e-3)
        return image(1.0 + 0.1 * rng.standard_normal(hits.shape) + hits * lit, 64)

    assert settled(16)[:, :34].mean() < 0.01, "nor where the lit half is near"
    late = settled(512)
    assert late[:, 48:].mean() > 0.9, "the dark half has had its chances"
    assert late[:, :32].mean() < 0.5, "8 hits a pixel are not enough"


def test_a_bright_noisy_corner_does_not_take_the_trust_of_a_far_quiet_one() -> None:
    rng = np.random.default_rng(7)
    rows, columns = np.divmod(np.arange(4096), 64)
    noisy = (rows < 8) & (columns < 8)
    values = np.where(noisy, rng.gamma(0.02, 50.0, (256, 4096)), rng.uniform(0.9, 1.1, (256, 4096)))
    settled = image(values, 64)
    assert not settled[:8, :8].any()
    assert settled[32:, 32:].all()


def test_trust_of_merged_parts_is_that_of_the_whole() -> None:
    values = np.random.default_rng(2).lognormal(0, 0.2 + 1.5 * (np.arange(1600) > 1200), (64, 1600))
    whole, parts = grey(values), grey(values[:32]).merge(grey(values[32:]))
    np.testing.assert_array_equal(trust(whole, 40), trust(parts, 40))
    assert 0 < trust(whole, 40).mean() < 1
