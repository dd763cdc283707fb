"""Sphere lights down to a micro-radian, where float32 formulas fail, against the analytic irradiance."""

from __future__ import annotations

import math

import pytest

import renderer
from renderer.backend import mitsuba


@pytest.mark.parametrize("technique", ["mis", "emitter"])
@pytest.mark.parametrize("angle", [1e-1, 1e-2, 4.65e-3, 1e-3, 2e-4, 1e-4, 1e-5, 1e-6])
def test_small_sphere_light_gives_the_analytic_irradiance(angle: float, technique: str, seed: int) -> None:
    """A floor of albedo 1/2 below a sphere of radius `angle` at distance 1: radiance is 1/2π · Lₑ π sin²."""
    transform = mitsuba().ScalarTransform4f
    scene = {
        "type": "scene",
        "sensor": {
            "type": "orthographic",
            "to_world": transform().look_at([0, 0, 0.5], [0, 0, 0], [0, 1, 0]).scale([1e-3, 1e-3, 1]),
            "film": {"type": "hdrfilm", "width": 8, "height": 8, "rfilter": {"type": "box"}},
        },
        "floor": {"type": "rectangle", "bsdf": {"type": "diffuse", "reflectance": 0.5}},
        "lamp": {
            "type": "sphere",
            "center": [0, 0, 1],
            "radius": angle,
            "emitter": {"type": "area", "radiance": 1 / (math.pi * angle**2)},
        },
    }
    settings = renderer.Settings(seed=seed, technique=technique, max_depth=2)
    estimate = renderer.render(scene, renderer.Target(spp=256), settings)
    assert float(estimate.mean.mean()) == pytest.approx(0.5 / math.pi, rel=1e-3)
