"""Facts about which technique finds which light."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import renderer
from renderer import Settings
from renderer.backend import mitsuba, using
from renderer.equation.reach import is_specular


def scene(emitters: dict[str, Any], *, glass: bool = False) -> renderer.Scene:
    """A floor and lights."""
    parts: dict[str, Any] = {
        "type": "scene",
        "sensor": {"type": "perspective", "film": {"type": "hdrfilm", "width": 4, "height": 4}},
        "floor": {"type": "rectangle"},
    }
    if glass:
        parts["ball"] = {"type": "sphere", "center": [0, 0, 4], "bsdf": {"type": "dielectric"}}
    return renderer.load_scene(parts | emitters)


POINT = {"lamp": {"type": "point", "position": [0, 0, 2]}}
SKY = {"sky": {"type": "constant"}}


def lost(made: renderer.Scene, technique: str, max_depth: int = 6) -> tuple[str, ...]:
    """What the technique cannot see."""
    return made.cannot_see(Settings(technique=technique, max_depth=max_depth))


@pytest.mark.parametrize("technique", ["uniform", "cosine", "bsdf"])
def test_a_point_light_is_not_seen_by_directions(technique: str) -> None:
    assert lost(scene(POINT | SKY), technique) == ("point light 'lamp'",)


@pytest.mark.parametrize("technique", ["emitter", "mis"])
def test_emitter_sampling_sees_every_kind_of_sampleable_light(technique: str) -> None:
    assert lost(scene(POINT | SKY), technique) == ()


def test_no_technique_sees_a_point_light_through_glass() -> None:
    assert lost(scene(POINT, glass=True), "mis") == ("point light 'lamp' by way of a mirror or clear glass",)
    assert lost(scene(POINT, glass=True), "mis", max_depth=2) == ()  # such a path is longer
    assert lost(scene(SKY, glass=True), "mis") == ()


def test_a_light_on_a_shape_that_cannot_be_sampled_is_not_seen_by_emitter_sampling() -> None:
    signed_distance = np.stack([np.full((2, 2, 1), -0.1), np.full((2, 2, 1), 0.1)]).astype(np.float32)
    glow = {
        "glow": {
            "type": "sdfgrid",
            "grid": mitsuba().TensorXf(signed_distance),
            "emitter": {"type": "area", "radiance": 1.0},
        }
    }
    assert lost(scene(glow), "emitter") == ("area light on a SDFGrid 'glow'",)
    assert lost(scene(glow), "mis") == ()


def test_many_lights_are_counted_by_kind() -> None:
    lamps = {f"lamp{i}": {"type": "point", "position": [i, 0, 2]} for i in range(9)}
    assert lost(scene(lamps), "bsdf") == ("9 × point light",)


@pytest.mark.parametrize(
    ("bsdf", "is_narrow"),
    [
        ({"type": "principled", "roughness": 0.1}, True),  # its α is the square
        ({"type": "principled", "roughness": 0.2}, False),
        ({"type": "principled", "roughness": 0.5, "clearcoat": 1.0, "clearcoat_gloss": 0.95}, True),
        ({"type": "principled", "roughness": 0.5, "clearcoat": 1.0, "clearcoat_gloss": 0.0}, False),
        ({"type": "roughconductor", "alpha": 0.01}, True),
        ({"type": "roughconductor", "alpha": 0.05}, False),
        ({"type": "twosided", "inner": {"type": "principled", "roughness": 0.1}}, True),
        ({"type": "diffuse"}, False),
        ({"type": "dielectric"}, True),
    ],
)
def test_lobes_that_are_as_narrow_as_a_mirrors_count_as_mirrors(bsdf: dict[str, Any], is_narrow: bool) -> None:
    with using("llvm_ad_rgb"):
        assert is_specular(mitsuba().load_dict(bsdf)) == is_narrow
