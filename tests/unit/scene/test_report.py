"""Facts about `fredholm inspect`: it says what is there, what is risky, and what is missing."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

import renderer
from renderer.errors import UnsupportedScene
from renderer.scene import gallery
from renderer.scene.report import inspect_scene
from service.command.main import app

SHARED = Path(__file__).resolve().parents[4] / "shared" / "scenes"
NAMES = sorted(path.parent.name for path in SHARED.glob("*/scene.xml")) or ["none"]
SENSOR = {"type": "perspective", "film": {"type": "hdrfilm", "width": 4, "height": 4}}


def shell(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["inspect", *arguments])
    return result.exit_code, result.output


@pytest.mark.parametrize("name", [entry.name for entry in gallery.list_scenes()])
def test_every_built_in_scene_is_inspected(name: str) -> None:
    found = inspect_scene(name)
    entry = gallery.find(name)
    assert (found["name"], found["width"], found["height"]) == (name, entry.width, entry.height)
    assert found["emitters"]
    assert not found["unsupported"]
    assert found["load_seconds"] > 0
    assert json.loads(json.dumps(found)) is not None


@pytest.mark.skipif(not SHARED.is_dir(), reason="there is no folder of shared scenes beside the checkout")
@pytest.mark.parametrize("name", NAMES)
def test_every_scene_from_elsewhere_is_inspected_or_refused_by_a_sentence(name: str) -> None:
    found = inspect_scene(SHARED / name / "scene.xml")
    assert found["shapes"]
    assert found["triangles"] > 0
    assert found["low"] is not None
    for sentence in found["unsupported"]:
        assert sentence.startswith("scene.xml:")
        assert "not supported" in sentence
    assert (found["load_seconds"] is None) == bool(found["unsupported"])


def test_the_command_prints_a_page_or_a_line_of_json() -> None:
    code, page = shell("cornell-box")
    assert code == 0
    for part in ("6 rectangle, 2 cube", "triangles", "36", "colour", "depth", "kernel"):
        assert part in page
    code, line = shell("cornell-box", "--json")
    assert code == 0
    assert json.loads(line)["shapes"] == {"rectangle": 6, "cube": 2}


def test_what_is_not_supported_is_told_with_everything_else(tmp_path: Path) -> None:
    path = tmp_path / "scene.xml"
    path.write_text(
        '<scene version="3.0.0"><sensor type="perspective"/>\n<film type="specfilm"/><shape type="cube"/></scene>'
    )
    result = CliRunner().invoke(app, ["inspect", str(path), "--json"])
    assert isinstance(result.exception, UnsupportedScene)
    assert json.loads(result.stdout)["shapes"] == {"cube": 1}
    assert "scene.xml:2: bands of a spectral film" in str(result.exception)


def room(**walls: Any) -> dict[str, Any]:
    from renderer.backend import mitsuba

    point = mitsuba().ScalarPoint3f(0, -1, 0)
    light = {"type": "directional", "direction": point}
    return {"type": "scene", "sensor": SENSOR, "light": light, "box": {"type": "cube", **walls}}


def test_a_closed_room_with_the_light_outside_is_warned_of() -> None:
    assert any(warning.startswith("closed room") for warning in inspect_scene(room())["warnings"])


def test_a_room_of_glass_or_with_a_lamp_is_not() -> None:
    for walls in ({"bsdf": {"type": "thindielectric"}}, {"emitter": {"type": "area"}}):
        assert not inspect_scene(room(**walls))["warnings"]


def test_a_mirror_beyond_what_floats_hold_ends_no_inspection() -> None:
    contents = {
        "type": "scene",
        "sensor": {"type": "perspective", "film": {"type": "hdrfilm", "width": 8, "height": 6}},
        "ball": {"type": "sphere", "radius": 1e300, "center": [1, 0, 0], "bsdf": {"type": "plastic"}},
        "cube": {"type": "cube"},
        "lamp": {"type": "point"},
    }
    assert inspect_scene(contents)["shapes"] == {"sphere": 1, "cube": 1}


def test_a_group_without_shapes_is_refused_by_its_place() -> None:
    """Mitsuba takes it, and no kernel of any scene beside it can then be compiled."""
    contents = {"type": "scene", "sensor": {"type": "perspective"}, "empty": {"type": "shapegroup"}}
    with pytest.raises(
        UnsupportedScene, match=r"scene\.empty: a shapegroup holds no shape; put one into it, or take it out"
    ):
        renderer.load_scene(contents)
    full = {**contents, "empty": {"type": "shapegroup", "ball": {"type": "sphere"}}}
    assert renderer.load_scene({**full, "one": {"type": "sphere"}}).requirements.shapes["shapegroup"] == 1
