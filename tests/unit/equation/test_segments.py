"""What a pixel costs: path segments, counted by the kernel and kept with the estimate."""

from __future__ import annotations

import numpy as np
import pytest

import renderer
from renderer.settings import Settings, Target

SPP, SIDE = 32, 8
SKY = {"type": "constant"}


def segments_of(scene: dict, max_depth: int) -> np.ndarray:
    """(pixels,) segments of a sample, in the mean."""
    settings = Settings(SIDE, SIDE, max_depth=max_depth, replicate_size=16, adaptive=False)
    return renderer.render(scene, Target(spp=SPP), settings).moments.segments / SPP


def scene(**shapes: dict) -> dict:
    return {"type": "scene", "sensor": {"type": "perspective"}, **shapes}


def test_a_path_into_the_sky_is_one_segment() -> None:
    assert (segments_of(scene(sky=SKY), 6) == 1).all()


@pytest.mark.parametrize("max_depth", [1, 2, 5])
def test_a_path_that_cannot_leave_is_as_long_as_its_depth(max_depth: int) -> None:
    # A white furnace: no light is lost, so that roulette ends nothing.
    bsdf = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 1.0}}
    walls = {"type": "sphere", "radius": 10.0, "flip_normals": True, "bsdf": bsdf, "lamp": {"type": "area"}}
    assert (segments_of(scene(walls=walls), max_depth) == max_depth).all()
