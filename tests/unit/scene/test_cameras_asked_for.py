"""A camera that is set from outside the scene: the picture of the scene that was edited so, and named refusals."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import renderer
from renderer.backend import mitsuba
from renderer.camera import Camera, to_world
from renderer.errors import CheckpointError, SettingsError
from renderer.replay import differences, replay, settings_of
from service.command.main import app

mi = mitsuba()
T = mi.ScalarTransform4f
TARGET = renderer.Target(spp=16)
SIZE = renderer.Settings(width=24, height=16)
FILM = {"type": "hdrfilm", "width": 24, "height": 16, "rfilter": {"type": "box"}}


def scene(origin: Any, target: Any, up: Any, fov: float, scale: float = 1.0, **sensor: Any) -> dict[str, Any]:
    """A ball, a floor and a lamp; everything grows by the scale."""
    at = T().look_at([scale * x for x in origin], [scale * x for x in target], up)
    lamp = {"type": "rectangle", "to_world": T().translate([0, 4 * scale, 0]).rotate([1, 0, 0], 90).scale(scale)}
    floor = {"type": "rectangle", "to_world": T().translate([0, -scale, 0]).rotate([1, 0, 0], -90).scale(5 * scale)}
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 3},
        "eye": {"type": "perspective", "to_world": at, "fov": fov, "film": FILM, **sensor},
        "ball": {"type": "sphere", "radius": scale, "bsdf": {"type": "diffuse", "reflectance": 0.4}},
        "floor": floor | {"bsdf": {"type": "diffuse", "reflectance": 0.8}},
        "lamp": lamp | {"emitter": {"type": "area", "radiance": {"type": "rgb", "value": 5.0}}},
    }


PLAIN: tuple[Any, ...] = ([0, 1, 6], [0, 0, 0], [0, 1, 0], 40.0)
OTHER: tuple[Any, ...] = ([3, 2, -4], [0.5, 0, 0], [0, 1, 0.2], 55.0)


@pytest.mark.parametrize("scale", [1.0, 2.0**-14, 3e4])
@pytest.mark.parametrize("kind", [{}, {"type": "thinlens", "aperture_radius": 0.02, "focus_distance": 5.0}])
def test_a_camera_that_is_set_makes_the_picture_of_the_edited_scene(scale: float, kind: dict[str, Any]) -> None:
    """Also in scenes that are rescaled before they are rendered: a camera is said in the scene's own units."""
    clips = {"near_clip": 0.01 * scale, "far_clip": 1e3 * scale}
    lens = {key: value * scale if isinstance(value, float) else value for key, value in kind.items()}
    plain, edited = (scene(*view, scale=scale, **clips, **lens) for view in (PLAIN, OTHER))
    origin, target, up, fov = OTHER
    camera = Camera([scale * x for x in origin], [scale * x for x in target], up, fov)  # type: ignore[arg-type]
    found = renderer.render(plain, TARGET, replace(SIZE, camera=camera))
    wanted = renderer.render(edited, TARGET, SIZE)
    assert np.mean(np.isclose(found.mean, wanted.mean, rtol=1e-3, atol=1e-4)) > 0.98
    assert not np.allclose(renderer.render(plain, TARGET, SIZE).mean, wanted.mean, rtol=0.05)


def test_an_origin_alone_leaves_the_view_and_an_angle_alone_the_place() -> None:
    straight, moved = scene([0, 1, 6], [0, 1, 0], [0, 1, 0], 40), scene([1, 2, 6], [1, 2, 0], [0, 1, 0], 40)
    loaded = renderer.load_scene(straight)
    shifted = renderer.render(loaded, TARGET, replace(SIZE, camera=Camera(origin=(1, 2, 6))))
    assert (shifted.mean == renderer.render(moved, TARGET, SIZE).mean).all()
    wide = renderer.render(loaded, TARGET, replace(SIZE, camera=Camera(fov=70)))
    edited = scene([0, 1, 6], [0, 1, 0], [0, 1, 0], 70)
    assert (wide.mean == renderer.render(edited, TARGET, SIZE).mean).all()
    lens = scene([0, 1, 6], [0, 1, 0], [0, 1, 0], 40, focal_length="50mm")
    del lens["eye"]["fov"]
    assert (renderer.render(lens, TARGET, replace(SIZE, camera=Camera(fov=70))).mean == wide.mean).all()


def test_a_mirrored_camera_stays_mirrored() -> None:
    own = np.diag([-1.0, 1.0, 1.0, 1.0])
    made = to_world(own, (0, 0, -3), (0, 0, 0), (0, 1, 0))
    assert np.linalg.det(made[:3, :3]) == pytest.approx(-1)
    assert np.linalg.det(to_world(np.eye(4), (0, 0, -3), (0, 0, 0), (0, 1, 0))[:3, :3]) == pytest.approx(1)


def test_the_camera_is_part_of_what_an_estimate_is_of(tmp_path: Path) -> None:
    contents = scene(*PLAIN)
    settings = replace(SIZE, camera=Camera(fov=50))
    estimate = renderer.render(contents, TARGET, settings)
    estimate.write(tmp_path / "wide.exr")
    again = renderer.Estimate.read(tmp_path / "wide.exr")
    assert settings_of(again).camera == Camera(fov=50)
    assert differences(again, (3, 4), replay(contents, settings_of(again), (3, 4), range(again.count[4, 3]))) == []
    further = renderer.render(contents, renderer.Target(spp=32), settings, start=again)
    straight = renderer.render(contents, renderer.Target(spp=32), replace(settings, replicate_size=4))
    assert (further.mean == straight.mean).all()
    with pytest.raises(CheckpointError, match="camera"):
        renderer.render(contents, renderer.Target(spp=32), SIZE, start=again)
    plain = renderer.render(contents, TARGET, replace(SIZE, camera=Camera()))
    assert "camera" not in plain.identity.settings


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"fov": 180}, r"camera fov is 180; it must be above 0 and below 180"),
        ({"fov": float("nan")}, "camera fov is nan"),
        ({"up": (0, 0, 0)}, "camera up is 0, 0, 0"),
        ({"origin": (1, 2, 3), "target": (1, 2, 3)}, "both 1, 2, 3"),
        ({"origin": (1, 2)}, "three numbers"),
        ({"origin": (1, 2, float("inf"))}, "must be from"),
        ({"place": (1, 2, 3)}, "camera has no 'place'; its parts are origin, target, up, fov"),
        ("here", "give a Camera"),
    ],
)
def test_cameras_that_cannot_be_are_refused_by_name_and_range(given: Any, says: str) -> None:
    with pytest.raises(SettingsError, match=says):
        renderer.Settings(camera=given)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"up": (0, 0, 2), "target": (0, 1, 0), "origin": (0, 1, 6)}, "up is 0, 0, 2, which is along"),
        ({"target": (0, 9, 6), "origin": (0, 1, 6)}, "own up is along"),
        ({"target": (0, 1, 6)}, "where it stands"),
    ],
)
def test_views_that_do_not_follow_are_refused(given: Any, says: str) -> None:
    straight = scene([0, 1, 6], [0, 1, 0], [0, 1, 0], 40)
    with pytest.raises(SettingsError, match=says):
        renderer.load_scene(straight, settings=renderer.Settings(camera=given))


def test_other_sensors_say_that_they_are_no_cameras() -> None:
    contents = scene(*PLAIN) | {"beam": {"type": "radiancemeter", "origin": [0, 0, 5], "direction": [0, 0, -1]}}
    contents["beam"]["film"] = FILM | {"width": 1, "height": 1}
    settings = renderer.Settings(camera=Camera(fov=30), sensor="beam")
    with pytest.raises(
        SettingsError, match="sensor 'beam' is of the type radiancemeter; only perspective and thinlens"
    ):
        renderer.load_scene(contents, settings=settings)
    assert renderer.load_scene(contents).sized(renderer.Settings(camera=Camera(fov=30))).camera == Camera(fov=30)


def test_the_command_line_takes_a_camera(tmp_path: Path) -> None:
    out, size = str(tmp_path / "a.exr"), ("--size", "12x8", "--spp", "4", "--json")
    given = ("--camera", "origin=-1,0.5,4.5 fov=30", "--camera", "up=0,1,0")
    done = CliRunner().invoke(app, ["render", "cornell-box", "-o", out, *size, *given])
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout.splitlines()[-1])["width"] == 12
    camera = settings_of(renderer.Estimate.read(tmp_path / "a.checkpoint.exr")).camera
    assert camera == Camera((-1, 0.5, 4.5), None, (0, 1, 0), 30)
    for bad in ("origin=1,2", "fov=wide", "roll=3", "origin 1,2,3"):
        refused = CliRunner().invoke(app, ["render", "cornell-box", "-o", out, *size, "--camera", bad])
        assert isinstance(refused.exception, SettingsError), bad
