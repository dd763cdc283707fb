"""Several pictures of one scene as one job: each is what it would be alone, and none loads the scene again."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

import renderer
from renderer.errors import SceneError, SettingsError
from renderer.series import product, series
from service.command.main import app

SENSOR = """<sensor type="{}" id="{}"><transform name="to_world"><lookat origin="{}" target="0, 0, 0" up="0, 1, 0"/>
  </transform><film type="hdrfilm"><integer name="width" value="{}"/><integer name="height" value="6"/></film>
  </sensor>"""
XML = f"""<scene version="3.0.0">
  <default name="grey" value="0.5"/><default name="tint" value="1, 1, 1"/>
  {SENSOR.format("perspective", "left", "-3, 1, 3", 8)}
  {SENSOR.format("perspective", "right eye", "3, 1, 3", 10)}
  <shape type="sphere"><bsdf type="diffuse"><rgb name="reflectance" value="$grey"/></bsdf></shape>
  <emitter type="constant"><rgb name="radiance" value="$tint"/></emitter>
</scene>"""
TARGET = renderer.Target(spp=16)


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "scene.xml"
    path.write_text(XML)
    return path


def test_all_sensors_share_the_scene_and_give_the_pictures_that_they_give_alone(scene: Path) -> None:
    members = list(series(scene))
    assert [(m.label, m.place, m.count, m.sensor) for m in members] == [("left", 0, 2, 0), ("right-eye", 1, 2, 1)]
    assert members[0].scene.mitsuba_scene is members[1].scene.mitsuba_scene
    for m in members:
        alone = renderer.render(scene, TARGET, renderer.Settings(sensor=m.sensor))
        together = renderer.render(m.scene, TARGET, m.settings)
        assert (together.mean == alone.mean).all()
        assert together.identity == alone.identity
        assert not any("sensors: the picture is the first" in one for one in together.health.warnings)


def test_a_sweep_gives_each_combination(scene: Path) -> None:
    sweep = product({"grey": [0.2, 0.4], "tint": ["1, 0, 0", "0, 1, 0"]})
    members = list(series(renderer.SceneFile(scene), sensors=[1], sweep=sweep))
    assert [m.label for m in members] == [
        f"right-eye-grey={g}-tint={t}" for g in (0.2, 0.4) for t in ("1-0-0", "0-1-0")
    ]
    assert dict(members[3].parameters) == {"grey": "0.4", "tint": "0, 1, 0"}
    means = [renderer.render(m.scene, TARGET, m.settings).mean.mean(axis=(0, 1)) for m in members]
    assert means[0][0] > 0 == means[0][1]
    assert means[3][1] > means[1][1] > 0 == means[1][0]


@pytest.mark.parametrize(
    ("asked", "error", "says"),
    [
        ({"sensors": ["top"]}, SettingsError, "the scene has 0 'left', 1 'right eye'"),
        ({"sweep": [{"gray": 1}]}, SceneError, "no parameter 'gray'"),
        ({"sweep": [{"grey": 0.1 + i / 1e5} for i in range(5001)]}, SettingsError, "10002 pictures"),
    ],
)
def test_series_that_cannot_be_are_refused(scene: Path, asked: Any, error: type[Exception], says: str) -> None:
    with pytest.raises(error, match=says):
        list(series(scene, **asked))


def test_a_value_is_given_or_swept_over(scene: Path) -> None:
    with pytest.raises(SettingsError, match=r"grey has the value '0\.1' and is swept over"):
        list(series(renderer.SceneFile(scene, {"grey": 0.1}), sweep=[{"grey": 0.2}]))
    with pytest.raises(SettingsError, match="is a dictionary"):
        list(series({"type": "scene"}, sweep=[{"grey": 0.2}]))


def test_the_command_line_renders_a_series_into_a_file_each(scene: Path, tmp_path: Path) -> None:
    out = tmp_path / "turn.exr"
    arguments = ["render", str(scene), "-o", str(out), "--spp", "4", "--json", "--sensor", "all"]
    done = CliRunner().invoke(app, [*arguments, "--sweep", "grey=0.2,0.4"])
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout.splitlines()[-1])
    assert told["stopped_by"] == "spp"
    found = [(Path(one["output"]).name, one["width"], one["sensor"], one["parameters"]) for one in told["series"]]
    assert found == [
        (f"turn-{name}-grey={grey}.exr", width, index, {"grey": grey})
        for grey in ("0.2", "0.4")
        for index, (name, width) in enumerate((("left", 8), ("right-eye", 10)))
    ]
    assert all((tmp_path / name).is_file() for name, *_ in found)
    assert (tmp_path / "turn-left-grey=0.2.checkpoint.exr").is_file()
    for more in (["--resume", str(out)], ["--sweep", "grey"], ["--sweep", "grey=1", "--sweep", "grey=2"]):
        assert isinstance(CliRunner().invoke(app, [*arguments, *more]).exception, SettingsError), more
