"""Scenes at the edge of float32 keep their light. `make extremes` prints the whole table, with Mitsuba's beside it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from extreme_scenes import SCENES, written

import renderer
from renderer.backend import mitsuba
from renderer.errors import SceneError, SettingsError
from renderer.scene.compile import load_scene
from renderer.scene.rewrite import check_memory, passes
from renderer.scene.rewrite.faces import kept_faces

SETTINGS = renderer.Settings(seed=1, adaptive=False)


def mean_of(source: Any, spp: int = 64, **options: Any) -> float:
    loaded = load_scene(source, **options)
    return float(renderer.render(loaded, renderer.Target(spp=spp), SETTINGS).mean.mean())


@pytest.mark.parametrize("name", SCENES)
def test_no_light_is_lost_at_any_scale(name: str, tmp_path: Path) -> None:
    whole = mean_of(written(tmp_path, name))
    for k in (1e-6, 1e-3, 1e6):
        assert mean_of(written(tmp_path, name, k)) == pytest.approx(whole, rel=1e-3)


@pytest.mark.parametrize("name", SCENES)
def test_no_light_is_lost_far_from_the_origin(name: str, tmp_path: Path) -> None:
    whole = mean_of(written(tmp_path, name))
    for offset in (1e3, 1e5):
        path = written(tmp_path, name, offset=offset)
        assert mean_of(path) == pytest.approx(whole, rel=5e-3)
        assert load_scene(path).requirements.notes[0].startswith("moved to the origin from ")


def test_it_is_the_rewrite_that_keeps_the_light(tmp_path: Path) -> None:
    others = [name for name in passes.ALL if name != passes.SIMILARITY]
    for k, offset in ((1e-5, 0.0), (1.0, 1e5)):
        assert mean_of(written(tmp_path, "cornell-box", k, offset), rewrites=others) < 0.05


def view(**more: Any) -> dict[str, Any]:
    look = mitsuba().ScalarTransform4f().look_at([0, 2, 5], [0, 0, 0], [0, 1, 0])
    film = {"type": "hdrfilm", "width": 16, "height": 12, "filter": {"type": "box"}}
    ball = {"type": "sphere", "bsdf": {"type": "diffuse"}}
    sensor = {"type": "perspective", "fov": 45.0, "to_world": look, "film": film}
    made = {"type": "scene", "integrator": {"type": "path", "max_depth": 4}, "sensor": sensor, "ball": ball, **more}
    return {key: value for key, value in made.items() if value is not None}


def sky(radiance: float) -> dict[str, Any]:
    return {"type": "constant", "radiance": {"type": "rgb", "value": radiance}}


@pytest.mark.parametrize("exponent", [-20, -10, 10, 20])
def test_forty_decades_of_radiance_survive_estimate_and_file(exponent: int, tmp_path: Path) -> None:
    unit = renderer.render(view(sky=sky(1.0)), renderer.Target(spp=64), SETTINGS)
    found = renderer.render(view(sky=sky(10.0**exponent)), renderer.Target(spp=64), SETTINGS)
    found.write(tmp_path / "x.exr")
    read = renderer.Estimate.read(tmp_path / "x.exr")
    for estimate in (found, read):
        assert np.allclose(estimate.mean / 10.0**exponent, unit.mean, rtol=1e-4)
        assert estimate.invalid.sum() == 0
    assert np.array_equal(read.mean, found.mean)


def point_light(intensity: float) -> dict[str, Any]:
    return {"type": "point", "position": mitsuba().ScalarPoint3f(0, 3, 0), "intensity": intensity}


def test_a_point_light_of_forty_decades_is_rescaled_with_its_scene() -> None:
    unit = mean_of(view(lamp=point_light(1.0)))
    for exponent in (-20, 20):
        assert mean_of(view(lamp=point_light(10.0**exponent))) / 10.0**exponent == pytest.approx(unit, rel=1e-4)


def mesh(path: Path, faces: list[tuple[int, int, int]]) -> str:
    corners = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nv 0.5 0.5 0\n"
    path.write_text(corners + "".join(f"f {a} {b} {c}\n" for a, b, c in faces))
    return str(path)


def test_a_mesh_with_half_its_faces_flat_is_the_mesh_without_them(tmp_path: Path) -> None:
    good, flat = [(1, 2, 3), (1, 3, 4)], [(1, 1, 2), (3, 3, 3), (1, 5, 3)]
    place = mitsuba().ScalarTransform4f().translate([0, 3, 0]).rotate([1, 0, 0], 90)
    pictures = []
    for name, faces in (("good", good), ("half", [good[0], *flat[:2], good[1]])):
        light = {"type": "obj", "filename": mesh(tmp_path / f"{name}.obj", faces), "to_world": place}
        loaded = load_scene(view(lamp={**light, "emitter": {"type": "area"}}))
        pictures.append(renderer.render(loaded, renderer.Target(spp=64), SETTINGS))
    assert pictures[0].mean.mean() > 0
    assert np.allclose(pictures[0].mean, pictures[1].mean, rtol=1e-6)
    assert loaded.requirements.notes == ("dropped 2 triangles of zero area",)
    assert not pictures[1].invalid.any()


def test_faces_on_a_line_or_a_point_have_no_area() -> None:
    positions = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0]], np.float32)
    faces = np.array([[0, 1, 3], [0, 1, 2], [1, 1, 3], [2, 2, 2]], np.uint32)
    assert kept_faces(positions, faces).tolist() == [True, False, False, False]


SCALE = {"rectangle": [1, 0, 1], "disk": [0, 0, 0], "sphere": [0, 0, 0], "cube": [1, 0, 0], "cylinder": [0, 0, 0]}


@pytest.mark.parametrize("kind", SCALE)
def test_a_shape_without_area_is_dropped_with_a_note_and_refused_as_a_light(kind: str) -> None:
    shape = {"type": kind, "to_world": mitsuba().ScalarTransform4f().scale(SCALE[kind])}
    loaded = load_scene(view(sky=sky(1.0), flat=shape))
    assert loaded.requirements.notes == ("dropped scene.flat: has no area",)
    assert np.isfinite(mean_of(view(sky=sky(1.0), flat=shape), spp=4))
    with pytest.raises(SceneError, match=rf"scene\.flat: the {kind} is a light without area.*give it some size"):
        load_scene(view(flat={**shape, "emitter": {"type": "area"}}))


def test_a_mesh_light_without_area_is_refused(tmp_path: Path) -> None:
    light = {"type": "obj", "filename": mesh(tmp_path / "z.obj", [(1, 1, 2), (5, 5, 5)]), "emitter": {"type": "area"}}
    with pytest.raises(SceneError, match="light without area"):
        load_scene(view(lamp=light))


@pytest.mark.parametrize(
    "dark",
    [
        {"type": "constant", "radiance": 0.0},
        sky(0.0),
        {"type": "point", "intensity": {"type": "spectrum", "value": [(400, 0), (700, 0)]}},
        {"type": "spot", "intensity": 0.0},
        {"type": "directional", "irradiance": {"type": "d65", "scale": 0.0}},
    ],
    ids=lambda dark: dark["type"],
)
def test_a_light_of_zero_power_is_dropped_with_a_note_and_changes_nothing(dark: dict[str, Any]) -> None:
    lit = {"lamp": point_light(5.0)}
    loaded = load_scene(view(**lit, dark=dark))
    assert loaded.requirements.notes == ("dropped scene.dark: emits nothing",)
    assert len(loaded.mitsuba_scene.emitters()) == 1
    assert mean_of(view(**lit, dark=dark)) == mean_of(view(**lit)) > 0


def test_a_scene_with_dark_lights_alone_is_black_and_says_so() -> None:
    loaded = load_scene(view(dark=sky(0.0)))
    assert loaded.warnings == ("no emitters: the image will be black",)
    assert mean_of(view(dark=sky(0.0)), spp=4) == 0


def test_a_hidden_dark_light_stays_hidden() -> None:
    integrator = {"type": "path", "max_depth": 3, "hide_emitters": True}
    panel = {"type": "sphere", "radius": 2.0, "emitter": {"type": "area", "radiance": 0.0}}
    shown, hidden = view(sky=sky(1.0), integrator=integrator), view(sky=sky(1.0), integrator=integrator, panel=panel)
    assert load_scene(hidden).requirements.notes == ()
    assert len(load_scene(hidden).mitsuba_scene.emitters()) == 2
    assert load_scene(shown).requirements.notes == ()


def test_the_smallest_picture_is_rendered_and_the_largest_accepted_or_refused_with_its_memory() -> None:
    one = renderer.render(view(sky=sky(1.0)), renderer.Target(spp=64), renderer.Settings(width=1, height=1))
    assert one.mean.shape == (1, 1, 3)
    check_memory(16384, 16384, available_bytes=100 << 30)
    with pytest.raises(SettingsError, match=r"16384×16384, which needs 62\.5 GiB.*8\.0 GiB are free; ask for at most"):
        check_memory(16384, 16384, available_bytes=8 << 30)
    wide = renderer.render(view(sky=sky(1.0)), renderer.Target(spp=4), renderer.Settings(width=16384, height=1))
    assert wide.mean.shape == (1, 16384, 3)
