"""Facts about collimated light: a floor straight below the rectangle is lit as the analytic value says."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import renderer
from renderer import Settings, Target
from renderer.backend import mitsuba
from tests.statistical.conftest import z_limit

RADIANCE, ALBEDO = 5.0, 0.5


def lamp_above_a_floor(extra: dict[str, Any] | None = None, shape: str = "rectangle") -> dict[str, Any]:
    """A floor seen from above, 4 wide, with a lamp of 2 × 2 hidden behind the camera that shines straight down."""
    transform = mitsuba().ScalarTransform4f
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 2},
        "sensor": {
            "type": "orthographic",
            "to_world": transform().look_at(origin=[0, 0, 2], target=[0, 0, 0], up=[0, 1, 0]).scale([2, 2, 1]),
            "film": {"type": "hdrfilm", "width": 16, "height": 16, "filter": {"type": "box"}},
        },
        "floor": {
            "type": "rectangle",
            "to_world": transform().scale(2),
            "bsdf": {"type": "diffuse", "reflectance": ALBEDO},
        },
        "lamp": {
            "type": shape,
            "to_world": transform().translate([0, 0, 3]).rotate([1, 0, 0], 180),
            "emitter": {"type": "directionalarea", "radiance": RADIANCE},
        },
    } | (extra or {})


@pytest.mark.parametrize("technique", ["mis", "emitter"])
def test_the_floor_below_a_collimated_lamp_is_lit_and_the_rest_is_black(technique: str) -> None:
    estimate = renderer.render(lamp_above_a_floor(), Target(spp=16), Settings(technique=technique))
    lit = np.zeros((16, 16), bool)
    lit[4:12, 4:12] = True
    assert np.allclose(estimate.mean[lit], RADIANCE * ALBEDO / np.pi, rtol=1e-5)
    assert (estimate.mean[~lit] == 0).all()


def test_a_collimated_lamp_beside_a_sky_agrees_with_the_sum_of_both(seed: int) -> None:
    sky = {"sky": {"type": "constant", "radiance": 0.3}}
    estimate = renderer.render(lamp_above_a_floor(sky), Target(spp=256), Settings(seed=seed))
    # The lamp hides a part of the sky from the floor; what it hides follows from an unlit lamp of the same size.
    dark = lamp_above_a_floor(sky)
    dark["lamp"] = {k: v for k, v in dark["lamp"].items() if k != "emitter"}
    under_sky = renderer.render(dark, Target(spp=256), Settings(seed=seed + 1, max_depth=2))
    added = (estimate.mean - under_sky.mean)[4:12, 4:12, 1]
    variances = (estimate.moments.variance_of_mean() + under_sky.moments.variance_of_mean())[:, 1].reshape(16, 16)
    error = np.sqrt(variances[4:12, 4:12].sum()) / 64
    assert abs(added.mean() - RADIANCE * ALBEDO / np.pi) < z_limit() * error


def test_a_collimated_light_that_is_no_rectangle_is_named_as_unseen() -> None:
    scene = renderer.load_scene(lamp_above_a_floor(shape="disk"))
    assert scene.cannot_see(Settings(max_depth=2)) == ("directional area light on a Disk 'lamp'",)
