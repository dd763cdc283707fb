"""Facts about MIS weights: two techniques share a sample wholly, however unequal their densities are."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.backend import mitsuba
from renderer.equation.mis import power_heuristic

mi = mitsuba()


def weight(a: float | np.ndarray, b: float | np.ndarray) -> np.ndarray:
    return np.array(power_heuristic(mi.Float(a), mi.Float(b)), np.float64).ravel()


@pytest.mark.parametrize("magnitude", [1e-25, 1e-10, 1.0, 1e10, 1e25])
def test_the_weights_of_two_techniques_sum_to_one(magnitude: float) -> None:
    exponents = np.linspace(-12, 12, 4001)
    a, b = np.full(4001, magnitude), magnitude * 10.0**exponents
    first, second = weight(a, b), weight(b, a)
    assert np.isfinite(first).all()
    assert (first >= 0).all()
    assert np.abs(first + second - 1).max() <= 1e-6


@pytest.mark.parametrize("ratio", [1e15, 1e19, 1e20, 1e30, 1e38])
def test_weights_stay_right_where_squares_would_overflow(ratio: float) -> None:
    # The textbook form a² / (a² + b²) is inf / inf here: a small light far away came out black.
    low = 1 / np.sqrt(ratio)
    high = np.sqrt(ratio)
    assert weight(high, low).tolist() == [1]
    assert weight(low, high).item() <= 1e-6
    assert np.abs(weight(high, low) + weight(low, high) - 1).item() <= 1e-6


@pytest.mark.parametrize("pdf", [1e-25, 1e25])
def test_equal_densities_share_evenly_however_large_or_small(pdf: float) -> None:
    assert weight(pdf, pdf).item() == pytest.approx(0.5, abs=1e-6)
    assert weight(pdf, 2 * pdf).item() == pytest.approx(0.2, abs=1e-6)


def test_the_extremes_of_both_densities_give_finite_weights() -> None:
    pdfs = np.array([1e-25, 1e-10, 1, 1e10, 1e25], np.float32)
    a, b = (m.ravel() for m in np.meshgrid(pdfs, pdfs))
    assert np.isfinite(weight(a, b)).all()
    assert np.abs(weight(a, b) + weight(b, a) - 1).max() <= 1e-6


def test_moderate_weights_are_the_textbook_ones() -> None:
    rng = np.random.default_rng(0)
    a, b = rng.lognormal(0, 2, (2, 1000)).astype(np.float32).astype(np.float64)
    np.testing.assert_allclose(weight(a, b), a**2 / (a**2 + b**2), rtol=1e-5)


def test_a_sample_that_could_not_be_drawn_has_no_weight() -> None:
    assert weight(0.0, 1.0).tolist() == [0]
    assert weight(0.0, 0.0).tolist() == [0]


def test_a_sample_that_only_one_technique_could_draw_is_its_own() -> None:
    assert weight(3.0, 0.0).tolist() == [1]
