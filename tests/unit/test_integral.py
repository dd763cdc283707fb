"""Facts about the one-dimensional estimator: unbiased, honest about its error, exact where p = f/I, mergeable."""

from __future__ import annotations

import doctest
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2, norm

import renderer
from renderer import integral
from renderer.errors import MergeError, SettingsError

FALSE_ALARM = 1e-6  # of each assertion, were its seed drawn afresh
Array = NDArray[np.float64]

CASES: list[tuple[str, Callable[[Array], Array], float, float, float]] = [
    ("constant", lambda x: np.full_like(x, 0.7), -1, 3, 2.8),
    ("square", lambda x: x**2, 0, 1, 1 / 3),
    ("sine", np.sin, 0, math.pi, 2),
    ("changes sign", np.sin, 0, 2 * math.pi, 0),
    ("step", lambda x: (x > 0.999).astype(float), 0, 1, 0.001),
    ("far away", lambda x: x - 1e6, 1e6, 1e6 + 1, 0.5),
]
cases = pytest.mark.parametrize(("f", "a", "b", "truth"), [c[1:] for c in CASES], ids=[c[0] for c in CASES])


@cases
def test_the_estimate_lies_within_its_error_of_the_truth(f: Callable, a: float, b: float, truth: float) -> None:
    found = renderer.integrate(f, a, b, 100_000, seed=3)
    assert abs(found.value - truth) <= norm.isf(FALSE_ALARM / 2) * found.standard_error + 1e-10


@cases
def test_value_and_variance_are_the_textbook_ones(f: Callable, a: float, b: float, truth: float) -> None:
    del truth
    x = a + (b - a) * np.random.default_rng(5).random(1000)
    ratios = f(x) * (b - a)
    found = renderer.integrate(f, a, b, 1000, seed=5)
    assert found.value == pytest.approx(ratios.mean(), rel=1e-12, abs=1e-12)
    assert found.variance == pytest.approx(ratios.var(ddof=1), rel=1e-9, abs=1e-20)
    assert found.standard_error == pytest.approx(ratios.std(ddof=1) / math.sqrt(1000), rel=1e-9, abs=1e-12)


def test_a_density_proportional_to_f_has_no_variance() -> None:
    found = renderer.integrate(np.exp, 0, 2, 50, pdf=lambda x: np.exp(x) / (math.e**2 - 1), sample=_inverse_of_exp)
    assert found.value == pytest.approx(math.e**2 - 1, rel=1e-14)
    assert 0 <= found.standard_error < 1e-14


def _inverse_of_exp(u: Array) -> Array:
    return np.log1p(u * (math.e**2 - 1))


def test_a_better_density_has_a_smaller_error_and_the_same_value() -> None:
    # f falls from 1 to 0; p = 2(1 − x) falls with it.
    f = lambda x: (1 - x) ** 2  # noqa: E731
    plain = renderer.integrate(f, 0, 1, 20_000)
    better = renderer.integrate(f, 0, 1, 20_000, pdf=lambda x: 2 * (1 - x), sample=lambda u: 1 - np.sqrt(1 - u))
    assert abs(plain.value - better.value) < 5 * math.hypot(plain.standard_error, better.standard_error)
    assert better.variance < plain.variance / 3  # 1/72 against 4/45 in theory


def test_the_reported_error_is_the_spread_of_independent_runs() -> None:
    runs = [renderer.integrate(np.sin, 0, math.pi, 400, seed=seed) for seed in range(400)]
    reported = np.mean([run.variance / run.n for run in runs])
    ratio = float(np.var([run.value for run in runs], ddof=1) / reported) * 399
    assert chi2.ppf(FALSE_ALARM / 2, 399) < ratio < chi2.isf(FALSE_ALARM / 2, 399)


def test_intervals_cover_the_truth_as_often_as_they_say() -> None:
    runs = [renderer.integrate(np.sin, 0, math.pi, 64, seed=seed).interval(0.9) for seed in range(1000)]
    covered = sum(low <= 2 <= high for low, high in runs)
    assert abs(covered - 900) < norm.isf(FALSE_ALARM / 2) * math.sqrt(1000 * 0.9 * 0.1)


def test_four_times_the_points_halve_the_error() -> None:
    few, many = (renderer.integrate(np.sin, 0, math.pi, n).standard_error for n in (10_000, 40_000))
    assert few / many == pytest.approx(2, rel=0.05)


def test_merging_is_associative_and_equals_the_pooled_points() -> None:
    a, b, c = (renderer.integrate(np.exp, 0, 1, n, seed=seed) for n, seed in ((10, 1), (1000, 2), (37, 3)))
    left, right = a.merge(b).merge(c), a.merge(b.merge(c))
    assert left.n == right.n == 1047
    assert left.value == pytest.approx(right.value, rel=1e-14)
    assert left.m2 == pytest.approx(right.m2, rel=1e-12)
    x = np.concatenate([np.random.default_rng(seed).random(n) for n, seed in ((10, 1), (1000, 2), (37, 3))])
    assert left.variance == pytest.approx(np.exp(x).var(ddof=1), rel=1e-12)


def test_merging_the_same_points_twice_is_refused() -> None:
    once = renderer.integrate(np.exp, 0, 1, 10, seed=4)
    with pytest.raises(MergeError, match="both hold seed 4"):
        once.merge(once)


def test_many_points_are_drawn_in_parts_without_changing_the_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = renderer.integrate(np.exp, 0, 1, 5000)
    monkeypatch.setattr(integral, "AT_ONCE", 512)
    parts = renderer.integrate(np.exp, 0, 1, 5000)
    assert parts.value == pytest.approx(whole.value, rel=1e-13)
    assert parts.m2 == pytest.approx(whole.m2, rel=1e-12)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"a": 1, "b": 1}, "limits are 1 and 1"),
        ({"a": 0, "b": math.inf}, "limits are 0 and inf"),
        ({"n": 0}, "n is 0"),
        ({"n": 2.5}, "n is 2.5"),
        ({"pdf": lambda x: x}, "pdf is given without sample"),
        ({"sample": lambda u: u}, "sample is given without pdf"),
        ({"pdf": np.ones_like, "sample": lambda u: u + 2}, "must lie in"),
        ({"pdf": np.zeros_like, "sample": lambda u: u}, "must be positive"),
        ({"pdf": np.ones_like, "sample": lambda u: u[:1]}, "points"),
        ({"f": lambda x: x / 0 * 0}, "must be finite"),
    ],
)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_bad_input_is_refused_by_name(arguments: dict, message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        renderer.integrate(**({"f": np.sin, "a": 0, "b": 1, "n": 10} | arguments))


def test_the_examples_in_the_documents_hold() -> None:
    assert doctest.testmod(integral).failed == 0
    readme = Path(renderer.__file__).with_name("README.md")
    assert doctest.testfile(str(readme), module_relative=False).failed == 0
