"""Facts about plain diffuse surfaces: they reflect as their plugins say, wherever a scene keeps them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import renderer
from renderer import Settings, Target
from renderer.backend import mitsuba, using
from renderer.equation.matte import _reflectances

LIGHTS: dict[str, dict[str, Any]] = {
    "point": {"type": "point", "position": [0, -6, 0], "intensity": 300.0},
    "sky": {"type": "constant"},
}


def ball_before_the_camera(light: str, is_instance: bool) -> dict[str, Any]:
    transform = mitsuba().ScalarTransform4f
    ball = {"type": "sphere", "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.5, 0.4, 0.3]}}}
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 2},
        "sensor": {
            "type": "perspective",
            "to_world": transform().look_at([0, -6, 0], [0, 0, 0], [0, 0, 1]),
            "film": {"type": "hdrfilm", "width": 8, "height": 8, "rfilter": {"type": "box"}},
        },
        "light": LIGHTS[light],
    }
    if not is_instance:
        return scene | {"ball": ball}
    return scene | {
        "group": {"type": "shapegroup", "ball": ball},
        "instance": {"type": "instance", "group": {"type": "ref", "id": "group"}},
    }


@pytest.mark.parametrize("light", LIGHTS)
def test_a_surface_in_an_instance_reflects_like_one_outside(light: str) -> None:
    """Instances do not list the surfaces of their parts: those are asked themselves."""
    settings = Settings(seed=3, adaptive=False)
    outside, inside = (
        renderer.render(ball_before_the_camera(light, is_instance), Target(spp=64), settings).mean
        for is_instance in (False, True)
    )
    assert outside.max() > 0.1
    np.testing.assert_allclose(inside, outside, atol=0.02 * float(outside.max()))


def test_what_is_known_of_a_surface_does_not_depend_on_the_others() -> None:
    """Mitsuba loads plugins side by side, in any order: equal seeds would give other last bits."""
    with using("llvm_ad_rgb"):
        mi = mitsuba()
        rng = np.random.default_rng(7)
        colours = [{"type": "rgb", "value": rng.uniform(0.1, 0.9, 3).tolist()} for _ in range(12)]
        bsdfs = [mi.load_dict({"type": "diffuse", "reflectance": colour}) for colour in colours]
        forth, back = (_reflectances(some) for some in (bsdfs, bsdfs[::-1]))
    assert all(sides is not None for sides in forth.values())
    for registry, sides in forth.items():
        np.testing.assert_array_equal(sides, back[registry])
