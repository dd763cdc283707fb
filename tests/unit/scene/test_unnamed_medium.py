"""A camera or meter inside a medium that the scene does not give it: it is rendered as written, and told."""

from __future__ import annotations

from typing import Any

import pytest

import renderer
from renderer.backend import mitsuba

SMALL = renderer.Settings(width=8, height=8)
SAYS = "inside the medium 'fog'"


def foggy(at: float = 0.5, **parts: Any) -> dict[str, Any]:
    """A ball of fog of radius 3 around the origin, with a small ball in it, and a camera at z = `at`."""
    look = mitsuba().ScalarTransform4f().look_at([0, 0, at], [0, 0, at - 1], [0, 1, 0])
    fog = {"type": "ref", "id": "fog"}
    return {
        "type": "scene",
        "integrator": {"type": "volpath"},
        "fog": {"type": "homogeneous", "id": "fog", "sigma_t": 0.5, "albedo": 0.8},
        "sensor": {"type": "perspective", "to_world": look},
        "cloud": {"type": "sphere", "radius": 3.0, "bsdf": {"type": "null"}, "interior": fog},
        "ball": {"type": "sphere", "center": [0, 0, -2], "radius": 0.2, "exterior": fog},
        "sky": {"type": "constant"},
        **parts,
    }


def named(at: float = 0.5, **parts: Any) -> dict[str, Any]:
    scene = foggy(at, **parts)
    scene["sensor"]["medium"] = {"type": "ref", "id": "fog"}
    return scene


def warned(scene: dict[str, Any]) -> list[str]:
    return [one for one in renderer.load_scene(scene, settings=SMALL).warnings if SAYS in one]


def test_a_camera_in_a_medium_that_is_not_its_own_is_told() -> None:
    (said,) = warned(foggy())
    assert said.startswith("camera inside a medium: ")
    assert 'name="medium"' in said


@pytest.mark.parametrize("scene", [lambda: foggy(6.0), named, lambda: foggy(-4.0)])
def test_a_camera_outside_or_with_its_medium_is_not(scene: Any) -> None:
    assert warned(scene()) == []


def test_a_camera_that_is_moved_into_a_medium_is_told() -> None:
    scene = renderer.load_scene(foggy(6.0), settings=SMALL)
    assert not any(SAYS in one for one in scene.warnings)
    moved = scene.sized(renderer.Settings(width=8, height=8, camera=renderer.Camera(origin=(0, 0, 1))))
    assert any(SAYS in one for one in moved.warnings)
    back = moved.sized(renderer.Settings(width=8, height=8, camera=renderer.Camera(origin=(0, 0, 6))))
    assert not any(SAYS in one for one in back.warnings)


def test_a_meter_in_a_medium_that_is_not_its_own_is_told() -> None:
    meter = {"type": "irradiancemeter", "film": {"type": "hdrfilm", "width": 1, "height": 1}}
    square = {"type": "rectangle", "to_world": mitsuba().ScalarTransform4f().scale(0.1), "meter": meter}
    scene = foggy(square=square)
    del scene["sensor"]
    (said,) = warned(scene)
    assert said.startswith("meter inside a medium: ")
    square["exterior"] = {"type": "ref", "id": "fog"}
    assert warned(scene) == []


@pytest.mark.parametrize("name", ["fog", "smoke", "cloudy-glass"])
def test_built_in_scenes_name_their_media(name: str) -> None:
    assert not any("inside a medium" in one for one in renderer.load_scene(name, settings=SMALL).warnings)
