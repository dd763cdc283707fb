"""Facts about filter importance sampling: offsets follow the filter, and signed weights keep its integral."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2, norm

from renderer.backend import mitsuba
from renderer.equation.filter import CELLS, PixelFilter

FALSE_ALARM = 1e-6
SAMPLES = 2**18
BINS = 64
FINE = 2**16  # midpoints over the support, to integrate the profile
mi = mitsuba()

every_filter = pytest.mark.parametrize(
    "plugin",
    [
        {"type": "box"},
        {"type": "tent"},
        {"type": "tent", "radius": 2.5},
        {"type": "gaussian"},
        {"type": "gaussian", "stddev": 1.0},
        {"type": "mitchell"},
        {"type": "catmullrom"},
        {"type": "lanczos"},
    ],
    ids=lambda plugin: "-".join(str(v) for v in plugin.values()),
)


def draw(plugin: dict[str, Any], seed: int = 1) -> tuple[NDArray[np.float64], NDArray[np.float64], float, Any]:
    """Offsets from the pixel's centre (n, 2), weights (n,), the radius and the profile as a function."""
    rfilter = mi.load_dict(dict(plugin))
    u = np.random.default_rng(seed).random((2, SAMPLES), np.float32)
    offset, weight = PixelFilter(mi, rfilter).sample(mi.Point2f(u))
    weights = np.broadcast_to(np.array(weight, np.float64), SAMPLES)

    def profile(x: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.array(rfilter.eval(mi.Float(x.astype(np.float32))), np.float64)

    return np.array(offset, np.float64).T - 0.5, weights, float(rfilter.radius()), profile


def midpoints(radius: float) -> NDArray[np.float64]:
    return ((np.arange(FINE) + 0.5) / FINE * 2 - 1) * radius


@every_filter
def test_offsets_are_distributed_as_the_size_of_the_filter(plugin: dict[str, Any]) -> None:
    offsets, _, radius, profile = draw(plugin)
    mass = np.abs(profile(midpoints(radius))).reshape(BINS, -1).sum(axis=1)
    expected = SAMPLES * mass / mass.sum()
    assert (np.abs(offsets) <= radius * (1 + 1e-6)).all()
    limit = chi2.ppf(1 - FALSE_ALARM, BINS - 1)
    for axis in range(2):
        cells = np.clip(((offsets[:, axis] / radius + 1) / 2 * BINS).astype(int), 0, BINS - 1)
        observed = np.bincount(cells, minlength=BINS)
        is_rare = expected < 5
        assert observed[is_rare].sum() < 5 * BINS
        assert ((observed - expected) ** 2 / np.maximum(expected, 5))[~is_rare].sum() < limit


@every_filter
def test_both_axes_are_drawn_independently(plugin: dict[str, Any]) -> None:
    offsets, *_ = draw(plugin, seed=2)
    correlation = np.corrcoef(offsets[:, 0], offsets[:, 1])[0, 1]
    assert abs(correlation) * np.sqrt(SAMPLES) < norm.ppf(1 - FALSE_ALARM / 2)


@every_filter
@pytest.mark.parametrize("power", [0, 1, 2, 4])
def test_weighted_samples_have_the_mean_of_the_filtered_function(plugin: dict[str, Any], power: int) -> None:
    offsets, weights, radius, profile = draw(plugin, seed=3)
    x = midpoints(radius)
    f = profile(x)
    truth = float((f * x**power).sum() / f.sum()) ** 2  # of (x y)^power under the normalised filter
    values = weights * (offsets[:, 0] * offsets[:, 1]) ** power
    sigma = values.std() / np.sqrt(SAMPLES)
    assert abs(values.mean() - truth) <= norm.ppf(1 - FALSE_ALARM / 2) * sigma + 1e-5 * np.abs(values).mean()


@every_filter
def test_weights_are_one_except_where_the_filter_has_negative_lobes(plugin: dict[str, Any]) -> None:
    _, weights, radius, profile = draw(plugin)
    f = profile(midpoints(radius))
    if (f >= 0).all():
        assert (weights == 1).all()
    else:
        size = (np.abs(f).sum() / f.sum()) ** 2
        np.testing.assert_allclose(np.abs(weights), size, rtol=1e-4)
        assert (weights < 0).any()


@pytest.mark.parametrize("plugin", [{"type": "tent", "radius": 2.5}, {"type": "gaussian"}], ids=["tent", "gaussian"])
def test_offsets_are_spread_evenly_within_a_cell_of_the_table(plugin: dict[str, Any]) -> None:
    """Else the camera would sample a thousand lines of a pixel and see none of what lies between them."""
    offsets, _, radius, _ = draw(plugin, seed=4)
    bins = 8
    within = (offsets[:, 0] + radius) * (CELLS / (2 * radius)) % 1
    observed = np.bincount((within * bins).astype(int), minlength=bins)
    assert ((observed - SAMPLES / bins) ** 2 / (SAMPLES / bins)).sum() < chi2.ppf(1 - FALSE_ALARM, bins - 1)


def test_a_box_keeps_every_sample_in_its_pixel() -> None:
    offsets, *_ = draw({"type": "box"})
    assert offsets.min() >= -0.5
    assert offsets.max() < 0.5


@every_filter
@pytest.mark.parametrize("u", [0.0, 1 - 2**-24])
def test_the_ends_of_the_unit_interval_give_finite_offsets_within_the_radius(plugin: dict[str, Any], u: float) -> None:
    rfilter = mi.load_dict(dict(plugin))
    offset, weight = PixelFilter(mi, rfilter).sample(mi.Point2f(u, u))
    distance = np.abs(np.array(offset, np.float64) - 0.5)
    assert (distance <= float(rfilter.radius()) * (1 + 1e-6)).all()
    assert np.isfinite(np.array(weight)).all()
