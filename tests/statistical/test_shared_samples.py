"""Shared samples leave the picture what it is: the filtered radiance, with error bars that hold and less variance."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from conftest import shared_scene, variance_map, z_limit
from numpy.typing import NDArray

import renderer
from renderer import Settings, Target
from renderer.backend import mitsuba
from renderer.equation.film import SharedFilm

mi = mitsuba()
WIDTH, HEIGHT = 24, 18
REPLICATES = 64


def edge(rfilter: str) -> dict[str, Any]:
    """A bright half plane that fills the right of the picture from 0.37 pixels right of column 11 on."""
    T = mi.ScalarTransform4f
    right, left = 10.0, 11.37 / WIDTH * 2 - 1
    return {
        "type": "scene",
        "sensor": {
            "type": "orthographic",
            "to_world": T().look_at([0, 0, 5], [0, 0, 0], [0, 1, 0]),
            "film": {"type": "hdrfilm", "width": WIDTH, "height": HEIGHT, "rfilter": {"type": rfilter}},
        },
        "half": {
            "type": "rectangle",
            "to_world": T().translate([(left + right) / 2, 0, 0]).scale([(right - left) / 2, 10, 1]),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": 1.0}},
        },
    }


@pytest.mark.parametrize("rfilter", ["tent", "gaussian", "mitchell", "catmullrom", "lanczos"])
def test_an_edge_is_the_integral_of_the_filter(rfilter: str, seed: int) -> None:
    """Closed form: what of the filter lies on the bright side."""
    estimate = renderer.render(edge(rfilter), Target(spp=16 * REPLICATES), Settings(WIDTH, HEIGHT, seed))
    plugin = mi.load_dict({"type": rfilter})
    x = np.linspace(-4, 4, 2**16, dtype=np.float32)
    f = np.array(plugin.eval(mi.Float(x)), np.float64)
    share = np.cumsum(f[::-1])[::-1] / f.sum()
    truth = np.interp(11.37 - (np.arange(WIDTH) + 0.5), x, share, left=1, right=0)
    # All rows have the same offsets in their squares, so they are one measurement.
    ours, error = estimate.mean[HEIGHT // 2, :, 0], np.sqrt(variance_map(estimate)[HEIGHT // 2, :, 0])
    np.testing.assert_allclose(estimate.mean[..., 0], np.broadcast_to(ours, (HEIGHT, WIDTH)), atol=1e-6)
    assert (np.abs(ours - truth) <= z_limit(WIDTH) * error + 2e-4).all(), (ours - truth) / np.maximum(error, 1e-9)
    assert np.abs(ours - truth).max() < 0.01


def replicates(scene: renderer.Scene, settings: Settings, n: int) -> NDArray[np.float64]:
    """(n, pixels, 3) values of replicates."""
    resolved = scene.resolved(settings, 16)
    pixels = np.arange(scene.width * scene.height, dtype=np.uint32)
    found = []
    for r in range(n):
        lanes = scene.kernel(resolved).launch(pixels, np.full_like(pixels, r), settings.seed)
        found.append(np.array(lanes[0], np.float64).T)
    return np.array(found)


@pytest.mark.parametrize(("name", "least_gain"), [("veach-mis", 1.5), ("matpreview", 2.5), ("caustic-ring", 1.0)])
def test_shared_and_independent_samples_have_one_mean(name: str, least_gain: float, seed: int) -> None:
    scene = renderer.load_scene(shared_scene(name), settings=Settings(WIDTH, HEIGHT))
    shared = replicates(scene, Settings(seed=seed), REPLICATES)
    apart = replicates(scene, Settings(seed=seed + 1, independent_pixels=True), REPLICATES)
    # The image's mean, by replicates of the whole image, which are independent.
    a, b = shared.mean(axis=(1, 2)), apart.mean(axis=(1, 2))
    z = (a.mean() - b.mean()) / math.hypot(a.std(ddof=1), b.std(ddof=1)) * math.sqrt(REPLICATES)
    assert abs(z) < z_limit()
    variance, variance_apart = (x.var(axis=0, ddof=1) for x in (shared, apart))
    each = (shared.mean(0) - apart.mean(0)) / np.sqrt((variance + variance_apart) / REPLICATES + 1e-30)
    is_calm = np.median(np.abs(each))
    # All squares have their samples at the same places: errors of pixels have a part in common, and so has this median.
    assert 0.5 < is_calm < 0.95, f"median |z| of the pixels is {is_calm:.2f}; of a normal distribution it is 0.67"
    scale = apart.mean(0) ** 2 + 0.01 * apart.mean() ** 2
    gain = np.median(variance_apart / scale) / np.median(variance / scale)
    assert gain > least_gain, f"{gain:.2f} times less variance of the median pixel"


def test_neighbours_are_as_alike_as_said(seed: int) -> None:
    """Under noise that is white before the filter: every sample finds a small light by chance."""
    T = mi.ScalarTransform4f
    contents = edge("gaussian") | {
        "half": {"type": "rectangle", "to_world": T().scale(20)},
        "lamp": {
            "type": "sphere",
            "center": [0, 0, 12.0],
            "radius": 4.0,
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": 1.0}},
        },
    }
    scene = renderer.load_scene(contents, settings=Settings(WIDTH, HEIGHT))
    found = replicates(scene, Settings(seed=seed, technique="cosine", max_depth=2), 400)[..., 0]
    noise = (found - found.mean(0)).reshape(len(found), HEIGHT, WIDTH)
    variance = (noise**2).mean()
    rho = [float((noise[:, :, d:] * noise[:, :, : WIDTH - d]).mean() / variance) for d in (1, 2, 3, 4)]
    spread = (1 + 2 * sum(r * r for r in rho)) ** 2
    said = SharedFilm(mi.load_dict({"type": "gaussian"})).correlation
    assert spread == pytest.approx(said.spread, rel=0.1)
