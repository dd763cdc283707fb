"""Closed scenes have analytic answers: radiance is the truncated series Le · Σ ρ^k, compared in standard errors."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from conftest import z_limit

import renderer
from renderer.scene.gallery.furnace import expected_radiance
from renderer.settings import TECHNIQUES


def furnace(albedo: float, radiance: float = 1.0) -> dict[str, Any]:
    """A closed sphere of diffuse albedo that emits everywhere, seen from inside, off its centre."""
    from renderer.backend import mitsuba

    transform = mitsuba().ScalarTransform4f
    return {
        "type": "scene",
        "sensor": {
            "type": "perspective",
            "fov": 60,
            "to_world": transform().look_at(origin=[0.3, 0.1, 0], target=[1, 0, 0.2], up=[0, 0, 1]),
            "film": {"type": "hdrfilm", "width": 12, "height": 12, "rfilter": {"type": "box"}},
        },
        "shell": {
            "type": "sphere",
            "flip_normals": True,
            "bsdf": {"type": "diffuse", "reflectance": albedo},
            "emitter": {"type": "area", "radiance": radiance},
        },
    }


@pytest.mark.parametrize("technique", TECHNIQUES)
@pytest.mark.parametrize(("albedo", "depth"), [(0.5, 1), (0.5, 2), (0.8, 8), (0.2, 4), (1e-6, 30), (0.999, 64)])
def test_furnace_is_the_truncated_series(albedo: float, depth: int, technique: str, seed: int) -> None:
    if technique == "uniform" and depth > 30:
        pytest.skip("uniform directions have a variance of (4/3)^depth: no finite run says anything here")
    settings = renderer.Settings(seed=seed, max_depth=depth, technique=technique)
    estimate = renderer.render(furnace(albedo), renderer.Target(spp=512), settings)
    exact = sum(albedo**k for k in range(depth))
    error = float(np.sqrt(estimate.moments.variance_of_mean()[:, 3].sum())) / estimate.count.size
    difference = float(estimate.moments.luminance().mean()) - exact
    # float32 inside a replicate: a few units in the last place per bounce
    assert abs(difference) < z_limit(30) * error + 2e-6 * depth * exact
    assert estimate.invalid.sum() == 0


@pytest.mark.parametrize("depth", [1, 3, 8])
def test_gallery_furnace_is_its_formula(depth: int, seed: int) -> None:
    settings = renderer.Settings(width=24, height=24, seed=seed, max_depth=depth)
    estimate = renderer.render("furnace", renderer.Target(spp=512), settings)
    variance = estimate.moments.variance_of_mean()[:, :3].sum(axis=0)
    error = np.sqrt(variance) / estimate.count.size
    exact = np.array(expected_radiance(depth))
    difference = np.abs(estimate.moments.mean.mean(axis=0) - exact)
    assert np.all(difference < z_limit(9) * error + 2e-6 * depth * exact), (
        difference / np.maximum(error, 1e-12),
        exact,
    )
