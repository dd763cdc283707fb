"""Facts about blends of smooth and delta lobes: their albedo is the blend of their albedos.

Mitsuba 3.9.1 draws a blend's delta lobe with the weight of a mixture of a probability and a density; a blend of white
paint and mirror then reflects 8 % too little. Our kernel draws the two kinds of lobes apart.
"""

from __future__ import annotations

from typing import Any

import pytest

import renderer
from renderer import Settings, Target
from renderer.backend import mitsuba
from tests.statistical.conftest import mean_and_error, z_limit

PAINT, MIRROR, SHARE = 0.5, 1.0, 0.3


def blend_under_a_white_sky() -> dict[str, Any]:
    """A plate that fills the picture: its radiance is its albedo."""
    transform = mitsuba().ScalarTransform4f
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 2},
        "sensor": {
            "type": "orthographic",
            "to_world": transform().look_at(origin=[0, 0, 2], target=[0, 0, 0], up=[0, 1, 0]).scale(0.5),
            "film": {"type": "hdrfilm", "width": 16, "height": 16, "filter": {"type": "box"}},
        },
        "plate": {
            "type": "rectangle",
            "bsdf": {
                "type": "blendbsdf",
                "weight": SHARE,
                "paint": {"type": "diffuse", "reflectance": PAINT},
                "mirror": {"type": "conductor", "material": "none"},
            },
        },
        "sky": {"type": "constant", "radiance": 1.0},
    }


@pytest.mark.parametrize("technique", ["mis", "bsdf", "emitter", "cosine", "uniform"])
def test_a_blend_of_paint_and_mirror_has_the_blend_of_their_albedos(technique: str, seed: int) -> None:
    settings = Settings(seed=seed, technique=technique)
    mean, error = mean_and_error(renderer.render(blend_under_a_white_sky(), Target(spp=1024), settings))
    expected = (1 - SHARE) * PAINT + SHARE * MIRROR
    assert abs(mean - expected) < z_limit() * error + 1e-5, f"{mean} ± {error}, expected {expected}"
