"""Values for a scene's parameters: those of the file where none is given, another scene where one is."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import pytest
from typer.testing import CliRunner

import renderer
from renderer.errors import SceneError
from renderer.scene.parameters import LONGEST_VALUE, SceneFile, with_parameters
from renderer.scene.source import parse
from service.command.main import app

XML = """<scene version="3.0.0">
  <default name="grey" value="0.5"/><default name="side" value="4"/><default name="near" value="false"/>
  <integrator type="path"/>
  <sensor type="perspective"><film type="hdrfilm"><integer name="width" value="$side"/>
    <integer name="height" value="$side"/></film></sensor>
  <shape type="sphere"><boolean name="flip_normals" value="$near"/>
    <bsdf type="diffuse"><rgb name="reflectance" value="$grey"/></bsdf></shape>
  <emitter type="constant"/>
</scene>"""


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "scene.xml"
    path.write_text(XML)
    return path


def test_values_stand_in_for_defaults_and_make_another_scene(scene: Path) -> None:
    plain, same, other = (
        parse(source)
        for source in (scene, SceneFile(scene, {"grey": "0.5"}), SceneFile(scene, {"grey": 0.25, "near": True}))
    )
    assert plain.digest == same.digest != other.digest
    loaded = renderer.load_scene(SceneFile(scene, {"side": 7}))
    assert (loaded.width, loaded.height) == (7, 7)
    assert loaded.sized(renderer.Settings(colour="spectral")).width == 7


def test_a_zip_has_parameters_too(scene: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "scene.zip", "w") as bundle:
        bundle.write(scene, "scene.xml")
    assert renderer.load_scene(SceneFile(tmp_path / "scene.zip", {"side": 5})).width == 5


@pytest.mark.parametrize(
    ("parameters", "says"),
    [
        ({"gray": "0.5"}, r"no parameter 'gray'; its parameters are grey, side, near"),
        ({"grey": "$side"}, "names a parameter itself"),
        ({"grey": "x" * (LONGEST_VALUE + 1)}, f"use at most {LONGEST_VALUE}"),
        ({"side": "wide"}, "wide"),
    ],
)
def test_what_is_no_value_is_named(scene: Path, parameters: dict[str, str], says: str) -> None:
    with pytest.raises(SceneError, match=says):
        parse(SceneFile(scene, parameters))


def test_scenes_that_are_no_xml_have_none() -> None:
    with pytest.raises(SceneError, match="no parameter 'side'; it has no <default>"):
        parse(SceneFile("cornell-box", {"side": "3"}))


@pytest.mark.parametrize(("given", "says"), [("side", "write -D name=value"), ("=4", "write -D name=value")])
def test_an_assignment_needs_name_and_value(given: str, says: str) -> None:
    with pytest.raises(SceneError, match=says):
        with_parameters("scene.xml", [given])


def test_an_assignment_is_given_once() -> None:
    with pytest.raises(SceneError, match="given twice"):
        with_parameters("scene.xml", ["a=1", "a=2"])


def test_the_commands_take_them(scene: Path, tmp_path: Path) -> None:
    run = CliRunner()
    told = run.invoke(app, ["inspect", str(scene), "-D", "side=9", "--json"], catch_exceptions=False)
    assert json.loads(told.stdout)["width"] == 9
    out = tmp_path / "out.exr"
    define = ["-D", "side=3", "-D", "grey=0.25"]
    done = run.invoke(app, ["render", str(scene), "--spp", "64", "-o", str(out), *define], catch_exceptions=False)
    assert done.exit_code == 0
    assert renderer.Estimate.read(tmp_path / "out.checkpoint.exr").width == 3
    again = run.invoke(app, ["replay", str(scene), str(out), "1,1", *define], catch_exceptions=False)
    assert again.exit_code == 0, again.output
