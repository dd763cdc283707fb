"""Facts about names that are not UTF-8: said before anything is rendered, by every door."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from renderer.errors import CheckpointError, FredholmError, SceneError, SettingsError
from renderer.estimate.estimate import Estimate
from renderer.region import Region
from renderer.scene.compile import Scene, load_scene
from service.command.main import main

SCENE = '<scene version="3.0.0"><emitter type="constant"/><sensor type="perspective"/></scene>'
SHOWN = "latin\\xe9"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / os.fsdecode(b"latin\xe9")
    try:
        made.mkdir()
    except OSError:
        pytest.skip("this file system takes no names that are not UTF-8")
    (made / "scene.xml").write_text(SCENE)
    return made


def test_each_door_says_it(folder: Path) -> None:
    doors: list[tuple[type[FredholmError], object]] = [
        (SceneError, lambda: load_scene(folder / "scene.xml")),
        (CheckpointError, lambda: Estimate.read(folder / "out.exr")),
        (SettingsError, lambda: Region.read(folder / "mask.png")),
    ]
    for error, door in doors:
        with pytest.raises(error, match="whose name is not UTF-8") as caught:
            door()  # type: ignore[operator]
        assert SHOWN in str(caught.value)


def test_a_relative_name_counts_with_its_folders(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    with pytest.raises(SceneError, match="not UTF-8"):
        load_scene("scene.xml")


@pytest.mark.parametrize("command", ["render", "passes"])
def test_nothing_is_rendered_for_an_output_that_cannot_be_written(
    command: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise AssertionError("it was rendered")

    monkeypatch.setattr(Scene, "kernel", fail)
    more = ["--replicates", "0:1"] if command == "passes" else ["--spp", "16"]
    monkeypatch.setattr("sys.argv", ["fredholm", command, "cornell-box", "-o", str(folder / "o.exr"), *more])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert "not UTF-8" in capsys.readouterr().err
