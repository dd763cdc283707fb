"""No message names a folder of this machine, whichever way it came into the message."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from service.crashes import shown_words
from service.engine import worker
from service.engine.turn import Turn
from service.engine.worker import failure_of
from service.without_paths import without_paths


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("/data/scenes/a b/ball/m.ply: no such file", "ball/m.ply: no such file"),
        ('"/data/scenes/a b/scene.xml" (line 3)', '"scene.xml" (line 3)'),
        ("in /data/scenes/a b", "in "),
        ("'/etc/passwd' is outside", "'…/passwd' is outside"),
        ("cannot open:/usr/lib/x/libembree.so!", "cannot open:…/libembree.so!"),
        ("C:\\Users\\Jane\\a.xml and \\\\host\\share\\b", "…/a.xml and …/b"),
        (f"{sys.prefix}/lib/x.py", "…/x.py"),
        (f"'{os.getcwd()}' is outside", f"'…/{Path.cwd().name}' is outside"),  # as of any other folder
        (f"file={os.path.expanduser('~')}/.drjit/a.bin", "file=…/a.bin"),
    ],
)
def test_folders_are_left_out(text: str, told: str) -> None:
    assert without_paths(text, ["/data/scenes/a b"]) == told


@pytest.mark.parametrize("text", ["see http://a.b/c/d", "3 W/m²/sr and/or 1/2", "scene.xml:3: a / b", "textures/a.png"])
def test_what_is_no_path_stays(text: str) -> None:
    assert without_paths(text, ["/data"]) == text


def test_last_words_name_no_folder() -> None:
    assert shown_words("Thread 1\n/home/jane/lib/libx.so: assertion failed\n") == "libx.so: assertion failed"


@pytest.mark.parametrize("scene", ["gone.xml", "gone.zip", "gone.json", "gone.txt", "folder.xml"])
def test_the_cause_of_a_job_names_no_folder(tmp_path: Path, scene: str) -> None:
    folder = tmp_path / "a b" / "scene id"
    (folder / "folder.xml").mkdir(parents=True)
    turn = Turn(
        job_id="j", attempt=1, scene=str(folder / scene), is_gallery=False, target={"spp": 4}, settings={}, kept=(),
        display_path=str(tmp_path / "d"), estimates_dir=str(tmp_path / "estimates"), next_seq=1, seconds=1.0,
        checkpoint_seconds=9.0,
    )  # fmt: skip
    failure = worker.advance(turn).failure
    assert failure is not None
    assert scene in failure.detail
    for part in ("a b", "scene id", tmp_path.name, "/"):
        assert part not in failure.detail


def test_an_error_nobody_foresaw_names_no_folder(tmp_path: Path) -> None:
    for error in (OSError(2, "gone", str(tmp_path / "x")), ValueError(f"{tmp_path}/x"), MemoryError(str(tmp_path))):
        assert tmp_path.name not in failure_of(error).detail
