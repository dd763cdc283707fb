"""A guide decides how noisy a picture is, never what it converges to: however little it was learned from."""

from __future__ import annotations

import math

import numpy as np
import pytest
from conftest import z_limit
from numpy.typing import NDArray

import renderer
from renderer import Settings, Target
from renderer.equation import guide_training
from renderer.scene.gallery.furnace import expected_radiance

WIDTH, HEIGHT, REPLICATES = 24, 18, 96


def image_means(scene: renderer.Scene, settings: Settings) -> NDArray[np.float64]:
    """(REPLICATES,) means of whole images of one replicate each, which are independent."""
    resolved = scene.resolved(settings, 16)
    assert resolved.guide == settings.guide
    pixels = np.arange(WIDTH * HEIGHT, dtype=np.uint32)
    lanes = np.repeat(pixels, REPLICATES), np.tile(np.arange(REPLICATES, dtype=np.uint32), len(pixels))
    radiance = np.array(scene.kernel(resolved).launch(*lanes, settings.seed)[0], np.float64)
    return radiance.reshape(3, -1, REPLICATES).mean(axis=(0, 1))


@pytest.mark.parametrize("paths", [2**4, 2**11], ids=["hardly anything", "a little"])
@pytest.mark.parametrize("name", ["gap", "materials"])
def test_pictures_with_and_without_a_guide_have_one_mean(
    name: str, paths: int, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(guide_training, "PATHS", paths)
    settings = Settings(WIDTH, HEIGHT, seed, independent_pixels=True)
    scene = renderer.load_scene(name, settings=settings)
    without = image_means(scene, settings)
    with_it = image_means(scene, Settings(WIDTH, HEIGHT, seed + 1, independent_pixels=True, guide="on"))
    spread = math.hypot(without.std(ddof=1), with_it.std(ddof=1)) / math.sqrt(REPLICATES)
    assert abs(with_it.mean() - without.mean()) < z_limit(4) * spread


def test_a_furnace_with_a_guide_is_its_formula(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guide_training, "PATHS", 2**10)
    settings = Settings(WIDTH, HEIGHT, seed, max_depth=8, guide="on", independent_pixels=True)
    estimate = renderer.render("furnace", Target(spp=512), settings)
    error = np.sqrt(estimate.moments.variance_of_mean()[:, :3].sum(axis=0)) / estimate.count.size
    exact = np.array(expected_radiance(8))
    difference = np.abs(estimate.moments.mean.mean(axis=0) - exact)
    assert np.all(difference < z_limit(3) * error + 2e-6 * 8 * exact)
