"""Facts about the image error: it is its formula, it has no unit, and it is not said before it is known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from renderer.estimate.error import MIN_MEASURED, _careful, floor_of, image_error, pixel_rel_mse, rel_mse
from renderer.estimate.moments import Moments


def noise(n_pixels: int, n_replicates: int, scale: float = 1.0, seed: int = 0) -> NDArray[np.float64]:
    """(replicates, pixels, 3) positive values, some pixels black."""
    rng = np.random.default_rng(seed)
    values = rng.gamma(2.0, 1.0, (n_replicates, n_pixels, 3)) * rng.random((1, n_pixels, 1))
    values[:, 3::10] = 0
    return values * scale


def moments_of(values: NDArray[np.float64]) -> Moments:
    moments = Moments.empty(values.shape[1])
    for replicate in values:
        moments.add(slice(None), replicate, np.zeros(values.shape[1], np.uint32), 1)
    return moments


def error_of(moments: Moments) -> float:
    found = image_error(moments, len(moments.count)).error
    assert found is not None
    return found


def plain_error(values: NDArray[np.float64]) -> float:
    """The formula, term by term."""
    n_replicates, n_pixels, _ = values.shape
    image = [
        [sum(values[r, p, c] for r in range(n_replicates)) / n_replicates for c in range(3)] for p in range(n_pixels)
    ]
    image_mean = sum(map(sum, image)) / (3 * n_pixels)
    total = 0.0
    for p in range(n_pixels):
        for c in range(3):
            mean = image[p][c]
            variance = sum((values[r, p, c] - mean) ** 2 for r in range(n_replicates)) / (n_replicates - 1)
            total += variance / n_replicates / (mean**2 + (0.1 * image_mean) ** 2)
    return math.sqrt(total / (3 * n_pixels))


@pytest.mark.parametrize("n_pixels", [1, 7, 300])
def test_the_error_is_its_formula(n_pixels: int) -> None:
    values = noise(n_pixels, 5)
    assert error_of(moments_of(values)) == pytest.approx(plain_error(values), rel=1e-12)


def test_a_sliver_of_a_lamp_seen_once_is_doubted_though_its_neighbours_are_bright() -> None:
    values = np.random.default_rng(2).uniform(0.9, 1.1, (20, 400, 3))
    sliver = 210
    values[:, :, :] *= np.where(np.abs(np.arange(400) % 20 - 13) < 3, 30.0, 1.0)[:, None]
    values[7, sliver] = 60.0
    flashed = moments_of(values)
    careful, _ = _careful(flashed, 20, floor_of(flashed.mean))
    assert careful[sliver] > 1.1 * pixel_rel_mse(flashed)[sliver], "more than the pixel says itself"
    assert np.median(careful / pixel_rel_mse(flashed)) < 1.02, "the others are believed"


@pytest.mark.parametrize("scale", [1e-20, 1e-3, 1e3, 1e20])
def test_the_error_does_not_depend_on_exposure(scale: float) -> None:
    assert error_of(moments_of(noise(300, 5, scale))) == pytest.approx(error_of(moments_of(noise(300, 5))), rel=1e-9)


def test_the_error_falls_with_the_root_of_the_replicates() -> None:
    few, many = (error_of(moments_of(noise(4000, n, seed=n))) for n in (16, 64))
    assert few / many == pytest.approx(2, rel=0.1)


def test_the_estimated_error_is_the_true_one_of_normal_noise() -> None:
    # 30 000 terms: the standard error of the ratio is below 1 %; the seed is fixed.
    values = 2 + 0.4 * np.random.default_rng(3).standard_normal((8, 10_000, 3))
    moments = moments_of(values)
    assert rel_mse(moments.mean, np.full_like(moments.mean, 2)) == pytest.approx(error_of(moments) ** 2, rel=0.05)


def test_the_error_is_unknown_without_two_replicates() -> None:
    assert image_error(Moments.empty(400), 20).error is None
    assert image_error(moments_of(noise(400, 1)), 20).error is None
    assert image_error(Moments.empty(400), 20).share_trusted == 0


def test_the_error_is_said_once_a_small_grid_has_two_replicates() -> None:
    n = 1024
    early = Moments.empty(n)
    grid = np.arange(0, n, n // MIN_MEASURED)
    none = np.zeros(len(grid), np.uint32)
    values = 1 + 0.1 * np.random.default_rng(0).standard_normal((2, n, 3))
    for replicate in values:
        early.add(grid[:-1], replicate[grid[:-1]], none[:-1], 1)
    assert image_error(early, 32).error is None
    for replicate in values:
        early.add(grid[-1:], replicate[grid[-1:]], none[-1:], 1)
    assert image_error(early, 32).error is not None


def test_a_pixel_without_a_variance_is_taken_to_vary_like_the_others_per_replicate() -> None:
    # Half the pixels have two replicates, the others one: with equal noise these have twice the squared error.
    n = 4096
    values = 1 + 0.1 * np.random.default_rng(0).standard_normal((2, n, 3))
    moments = moments_of(values[:1])
    grid = np.arange(0, n, 2)
    moments.add(grid, values[1, grid], np.zeros(len(grid), np.uint32), 1)
    two, one = 0.1**2 / 2, 0.1**2
    assert error_of(moments) == pytest.approx(math.sqrt((two + one) / 2 / 1.01), rel=0.05)


def test_the_share_within_the_target_counts_pixels() -> None:
    values = noise(400, 6)
    moments = moments_of(values)
    within = image_error(moments, 20, 0.3).share_within
    assert within == pytest.approx(float((np.sqrt(pixel_rel_mse(moments)) <= 0.3).mean()))
    assert within is not None
    assert 0 < within < 1
    assert image_error(moments, len(moments.count)).share_within is None


def test_an_image_that_does_not_vary_has_no_error() -> None:
    assert image_error(moments_of(np.full((4, 300, 3), 0.7)), 20).error == 0


def test_equal_images_have_no_rel_mse() -> None:
    image = np.random.default_rng(0).random((5, 4, 3))
    assert rel_mse(image, image) == 0
    assert rel_mse(np.zeros((2, 2, 3)), np.zeros((2, 2, 3))) == 0


def test_rel_mse_is_its_formula_and_scale_free() -> None:
    rng = np.random.default_rng(1)
    image, reference = rng.random((6, 3)), rng.random((6, 3))
    expected = np.mean((image - reference) ** 2 / (reference**2 + (0.1 * reference.mean()) ** 2))
    assert rel_mse(image, reference) == pytest.approx(expected, rel=1e-12)
    assert rel_mse(1e6 * image, 1e6 * reference) == pytest.approx(expected, rel=1e-9)
    assert rel_mse(image.astype(np.float32), reference) == pytest.approx(expected, rel=1e-5)


def test_the_bound_holds_for_few_replicates_of_skewed_noise() -> None:
    """A pixel whose few replicates were all dark claims a small variance, one with a bright one a large mean."""
    width, n_replicates, runs = 40, 5, 40
    is_below = []
    for seed in range(runs):
        grey = np.random.default_rng(seed).gamma(0.5, 2.0, (n_replicates, width * width, 1))
        moments = moments_of(np.repeat(grey, 3, axis=2))
        upper = image_error(moments, width, 0.1).upper
        assert upper is not None
        is_below.append(rel_mse(moments.mean, np.ones_like(moments.mean)) <= upper**2)
    assert sum(is_below) >= 0.95 * runs
