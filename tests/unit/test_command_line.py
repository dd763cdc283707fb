"""Facts about the command `fredholm`: what it understands, what it says, and what it leaves behind."""

from __future__ import annotations

import itertools
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from renderer.errors import SettingsError
from renderer.estimate.estimate import Estimate
from renderer.estimate.moments import Moments
from renderer.scene.gallery import list_scenes
from service.command import arguments
from service.command.console import say_seconds
from service.command.main import main

ROOT = Path(__file__).resolve().parents[2]
WRITTEN = ("out.exr", "out.checkpoint.exr")
TINY = ("cornell-box", "--size", "16x16", "--replicate-size", "1")


@pytest.fixture(autouse=True)
def signal_handlers() -> Iterator[None]:
    """The command takes over two signals; the tests want theirs back."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture
def fredholm(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> type[Command]:
    """Runs the command in this process, in an empty folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    Command.monkeypatch = monkeypatch
    return Command


class Command:
    """One run of `main()`. code: its exit code, 0 where it just returned."""

    monkeypatch: pytest.MonkeyPatch

    def __init__(self, *arguments: str | Path) -> None:
        self.monkeypatch.setattr(sys, "argv", ["fredholm", *map(str, arguments)])
        self.code = 0
        try:
            main()
        except SystemExit as left:
            self.code = left.code if isinstance(left.code, int) else int(left.code is not None)


def said(capsys: pytest.CaptureFixture[str]) -> tuple[str, str]:
    """Standard output and standard error, each on one line."""
    out, err = capsys.readouterr()
    return " ".join(out.split()), " ".join(err.split())


def assert_same_bits(a: Estimate, b: Estimate) -> None:
    for field in fields(Moments):
        assert getattr(a.moments, field.name).tobytes() == getattr(b.moments, field.name).tobytes(), field.name


@pytest.mark.parametrize(
    ("text", "value"),
    [("2%", 0.02), ("0.02", 0.02), (" 2.5 % ", 0.025), ("1e-3", 1e-3), ("100%", 1.0), (".5%", 0.005), ("1e1", 10.0)],
)
def test_an_error_is_a_percentage_or_a_fraction(text: str, value: float) -> None:
    assert arguments.parse_error(text) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize("text", ["", "two", "2 percent", "%", "2%%", "0,02", "1e", "nan", "inf", "0x1", "2% 3%"])
def test_an_error_that_is_no_number_is_refused_with_an_example(text: str) -> None:
    with pytest.raises(SettingsError, match=r"--error is .*write it as 2% or 0\.02"):
        arguments.parse_error(text)


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("90", 90),
        ("90s", 90),
        (" 90 s ", 90),
        ("1.5m", 90),
        ("1m30s", 90),
        ("1m 30s", 90),
        ("1m30", 90),
        ("2min", 120),
        ("2h", 7200),
        ("1h30m5s", 5405),
        ("0.25", 0.25),
    ],
)
def test_a_time_is_said_in_seconds_minutes_and_hours(text: str, seconds: float) -> None:
    assert arguments.parse_time(text) == pytest.approx(seconds)


@pytest.mark.parametrize(
    "text", ["", "soon", "-5", "5x", "1:30", "1..5s", "1e3", "s", "5 days", "nan", "1,5m", "5 5", "1 000"]
)
def test_a_time_that_is_none_is_refused_with_an_example(text: str) -> None:
    with pytest.raises(SettingsError, match=r"--time is .*write it as 30s, 1m30s or 2h"):
        arguments.parse_time(text)


@pytest.mark.parametrize(
    ("text", "size"), [("640x480", (640, 480)), (" 1 x 1 ", (1, 1)), ("640×480", (640, 480)), ("640X480", (640, 480))]
)
def test_a_size_is_width_and_height(text: str, size: tuple[int, int]) -> None:
    assert arguments.parse_size(text) == size


@pytest.mark.parametrize("text", ["", "640", "640x", "x480", "640*480", "-640x480", "6.4x4.8", "640x480x3", "axb"])
def test_a_size_that_is_none_is_refused_with_an_example(text: str) -> None:
    with pytest.raises(SettingsError, match=r"--size is .*for example 640x480"):
        arguments.parse_size(text)


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(0.25, "0.2 s"), (59.9, "59.9 s"), (90, "1 min 30 s"), (3600, "1 h 0 min"), (8100, "2 h 15 min")],
)
def test_durations_are_said_as_people_say_them(seconds: float, words: str) -> None:
    assert say_seconds(seconds) == words


def test_help_names_the_commands(fredholm: type[Command], capsys: pytest.CaptureFixture[str]) -> None:
    assert fredholm("--help").code == 0
    out, _ = said(capsys)
    for name in ("render", "merge", "gallery", "serve"):
        assert f" {name} " in out


@pytest.mark.parametrize(
    ("command", "example"),
    [
        ("render", "fredholm render scene.xml -o out.exr --error 2% --time 10m"),
        ("merge", "fredholm merge a.exr b.exr -o c.exr"),
        ("serve", "fredholm serve --port 8017"),
    ],
)
def test_help_of_a_command_shows_examples(
    fredholm: type[Command], capsys: pytest.CaptureFixture[str], command: str, example: str
) -> None:
    assert fredholm(command, "--help").code == 0
    assert example in said(capsys)[0]


def test_the_gallery_lists_names_that_render_takes(fredholm: type[Command], capsys: pytest.CaptureFixture[str]) -> None:
    assert fredholm("gallery").code == 0
    out, _ = said(capsys)
    for found in list_scenes():
        assert f"{found.name} {found.title}" in out


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("teapot",), 'no built-in scene is called "teapot"; the gallery has cornell-box'),
        (("none.xml",), "none.xml: no such file"),
        ((*TINY, "--spp", "0"), "spp is 0; it must be a whole number from 1"),
        ((*TINY, "--error", "much"), "--error is 'much'"),
        ((*TINY, "--error", "2000%"), "error is 20.0; it must be from 1e-06 to 10"),
        ((*TINY, "--time", "soon"), "--time is 'soon'"),
        (("cornell-box", "--size", "big"), "--size is 'big'"),
        (("cornell-box", "--size", "0x16"), "width is 0; it must be a whole number from 1 to 16384"),
        ((*TINY, "--technique", "magic"), "technique is 'magic'; choose one of mis, bsdf"),
        ((*TINY, "--seed", "-1"), "seed is -1"),
        ((*TINY, "-o", "out.png"), "out.png; the name must end in .exr"),
        ((*TINY, "--resume", "none.exr"), "none.exr: no such file"),
        ((*TINY, "--without", "magic"), "rewrite is 'magic'; choose from flat shapes, dark lights, similarity"),
    ],
)
def test_bad_input_is_one_sentence_and_exit_code_two(
    fredholm: type[Command], capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], named: str
) -> None:
    assert fredholm("render", *arguments).code == 2
    out, err = said(capsys)
    assert named in err
    assert err.startswith("error: ")
    assert "Traceback" not in err
    assert out == ""
    assert not list(Path.cwd().iterdir())


@pytest.mark.parametrize("name", ["[2K] tiles.xml", "[/old].xml", "[bold].xml"])
def test_brackets_in_a_file_name_are_shown_and_not_taken_for_markup(
    fredholm: type[Command], capsys: pytest.CaptureFixture[str], name: str
) -> None:
    assert fredholm("render", name).code == 2
    assert f"error: {name}: no such file" in said(capsys)[1]


def test_a_long_file_name_is_not_broken_into_lines(fredholm: type[Command], capsys: pytest.CaptureFixture[str]) -> None:
    name = "/".join(["a-folder-of-scenes"] * 8) + "/scene.xml"
    assert fredholm("render", name).code == 2
    assert name in capsys.readouterr().err


def test_an_unknown_option_is_exit_code_two(fredholm: type[Command], capsys: pytest.CaptureFixture[str]) -> None:
    assert fredholm("render", "cornell-box", "--sp", "4").code == 2
    assert "No such option" in said(capsys)[1]


def test_a_render_writes_its_image_and_one_last_line_of_json(
    fredholm: type[Command], capsys: pytest.CaptureFixture[str]
) -> None:
    assert fredholm("render", "cornell-box", "--size", "16x16", "--spp", "64", "--seed", "7", "--json").code == 0
    out, err = capsys.readouterr()
    report = json.loads(out.splitlines()[-1])
    assert set(report) >= {"seconds", "spp", "error", "samples", "stopped_by", "scene", "seed"}
    assert (report["spp"], report["samples"], report["stopped_by"]) == (64, 64 * 256, "spp")
    assert (report["scene"], report["seed"], report["width"], report["height"]) == ("cornell-box", 7, 16, 16)
    assert 0 < report["error"] < 2
    assert report["error_unknown"] is None
    assert report["seconds"] > 0
    written = Estimate.read("out.exr")
    assert (written.samples, written.identity.seed, written.identity.scene) == (64 * 256, 7, report["scene_digest"])
    assert written.mean.max() > 0
    assert "out.exr: error" in err
    assert "samples done" in err


def test_a_rewrite_is_left_out_on_request_and_the_image_says_so(fredholm: type[Command]) -> None:
    assert fredholm("render", *TINY, "--spp", "1", "-o", "whole.exr").code == 0
    assert fredholm("render", *TINY, "--spp", "1", "-o", "left.exr", "--without", "similarity, flat faces").code == 0
    whole, left = (Estimate.read(f"{name}.exr").identity.scene for name in ("whole", "left"))
    assert whole != left


def test_the_number_of_threads_changes_no_bit(tmp_path: Path) -> None:
    for threads in (1, 3):
        command = [sys.executable, "-m", "service.command", "render", *TINY, "--spp", "64", "--threads", str(threads)]
        subprocess.run([*command, "-o", tmp_path / f"{threads}.exr"], cwd=ROOT, check=True)
    one, three = (Estimate.read(tmp_path / f"{threads}.exr") for threads in (1, 3))
    assert np.array_equal(one.moments.mean, three.moments.mean)
    assert np.array_equal(one.moments.m2, three.moments.m2)


def test_without_json_standard_output_stays_empty(fredholm: type[Command], capsys: pytest.CaptureFixture[str]) -> None:
    assert fredholm("render", *TINY, "--spp", "1").code == 0
    assert capsys.readouterr().out == ""


def test_resuming_gives_the_bits_of_a_straight_render(fredholm: type[Command]) -> None:
    assert fredholm("render", *TINY, "--spp", "12", "-o", "straight.exr").code == 0
    assert fredholm("render", *TINY, "--spp", "5", "-o", "part.exr").code == 0
    assert fredholm("render", *TINY, "--spp", "12", "-o", "whole.exr", "--resume", "part.exr").code == 0
    assert_same_bits(Estimate.read("whole.exr"), Estimate.read("straight.exr"))
    assert Estimate.read("part.exr").spp == 5


def test_a_checkpoint_goes_on_in_its_own_file_with_its_own_replicate_size(fredholm: type[Command]) -> None:
    assert fredholm("render", "cornell-box", "--size", "16x16", "--spp", "8").code == 0
    assert fredholm("render", "cornell-box", "--size", "16x16", "--spp", "16", "--resume", "out.exr").code == 0
    again = Estimate.read("out.exr")
    assert (again.spp, again.replicate_size) == (16, 2)


def test_resuming_another_question_is_refused_and_keeps_the_file(
    fredholm: type[Command], capsys: pytest.CaptureFixture[str]
) -> None:
    assert fredholm("render", *TINY, "--spp", "1").code == 0
    before = Path("out.exr").read_bytes()
    assert fredholm("render", *TINY, "--spp", "2", "--seed", "1", "--resume", "out.exr").code == 2
    assert "the checkpoint has seed 0, asked is 1" in said(capsys)[1]
    assert fredholm("render", "furnace", "--size", "16x16", "--spp", "2", "--resume", "out.exr").code == 2
    assert "the checkpoint is of another scene" in said(capsys)[1]
    assert Path("out.exr").read_bytes() == before


def test_two_seeds_merge_and_equal_seeds_are_refused(
    fredholm: type[Command], capsys: pytest.CaptureFixture[str]
) -> None:
    for seed in ("1", "2"):
        assert fredholm("render", *TINY, "--spp", "4", "--seed", seed, "-o", f"{seed}.exr").code == 0
    assert fredholm("merge", "1.exr", "2.exr", "-o", "both.exr").code == 0
    a, b, both = (Estimate.read(f"{name}.exr") for name in ("1", "2", "both"))
    assert both.spp == 8
    assert both.ranges == ((1, 4), (2, 4))
    assert both.mean == pytest.approx((a.mean + b.mean) / 2, rel=1e-12)
    capsys.readouterr()
    for pair in (("1.exr", "1.exr"), ("both.exr", "2.exr")):
        assert fredholm("merge", *pair, "-o", "again.exr").code == 2
        assert "replicates overlap: both hold seed" in said(capsys)[1]
    assert not Path("again.exr").exists()


def test_one_file_is_no_merge(fredholm: type[Command], capsys: pytest.CaptureFixture[str]) -> None:
    assert fredholm("merge", "a.exr", "-o", "b.exr").code == 2
    assert "at least two files" in said(capsys)[1]


def test_a_pixel_is_replayed_and_a_changed_file_is_noticed(
    fredholm: type[Command], capsys: pytest.CaptureFixture[str]
) -> None:
    assert fredholm("render", *TINY, "--spp", "12").code == 0
    assert fredholm("replay", "cornell-box", "out.exr", "5,9").code == 0
    out, err = capsys.readouterr()
    assert len(out.splitlines()) == Estimate.read("out.exr").count[9, 5]
    assert "the same bits" in err
    changed = Estimate.read("out.exr")
    changed.moments.mean[9 * 16 + 5, 1] += 1e-12
    changed.write("changed.exr")
    assert fredholm("replay", "cornell-box", "changed.exr", "5,9").code == 1
    assert "not the same bits: mean" in said(capsys)[1]
    assert fredholm("replay", "cornell-box", "out.exr", "5,9", "--replicate", "2").code == 0
    for bad, named in (("16,0", "outside the image"), ("5", "write it as X,Y")):
        assert fredholm("replay", "cornell-box", "out.exr", bad).code == 2
        assert named in said(capsys)[1]


def test_health_confidence_and_region_are_in_the_report(
    fredholm: type[Command], capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ("--error", "60%", "--confidence", "90%", "--region", "0,8,16,8", "--json")
    assert fredholm("render", *TINY[:3], *asked).code == 0
    out, err = capsys.readouterr()
    report = json.loads(out.splitlines()[-1])
    assert report["stopped_by"] == "error"
    assert 0 < report["error"] < report["error_upper"] <= 0.6
    assert report["health"]["status"] == "uncertain"
    assert "with 90 % confidence" in err
    assert "error bars that cannot be believed yet" in err
    for bad, named in (
        (("--error", "5%", "--confidence", "2"), "confidence is 2.0; it must be from 0.5"),
        (("--spp", "4", "--share", "90%"), "share is given without an error"),
        (("--error", "5%", "--region", "9,9,9,9"), "reaches outside the image of 16×16"),
        (("--error", "5%", "--region", "none.png"), "no such image"),
    ):
        assert fredholm("render", *TINY, *bad).code == 2
        assert named in said(capsys)[1]


HURRIED = """
from service.command import main, rendering
rendering.CHECKPOINT_SECONDS = 0.5
main.main()
"""


def test_a_killed_render_loses_no_more_than_its_last_checkpoint_interval(tmp_path: Path) -> None:
    out = tmp_path / "out.exr"
    arguments = ["render", *TINY, "--time", "120s", "-o", str(out)]
    process = subprocess.Popen([sys.executable, "-c", HURRIED, *arguments], cwd=ROOT, stderr=subprocess.DEVNULL)
    try:
        saved: list[float] = []
        deadline = time.monotonic() + 90
        while len(saved) < 4 and time.monotonic() < deadline:
            if out.exists() and (not saved or out.stat().st_mtime > saved[-1]):
                saved.append(out.stat().st_mtime)
            time.sleep(0.02)
        assert len(saved) == 4
        os.kill(process.pid, signal.SIGKILL)
    finally:
        process.kill()
        process.wait()
    left = Estimate.read(out)
    assert left.seconds > 0
    assert max(b - a for a, b in itertools.pairwise(saved)) < 10 * 0.5, "loose: the machine may be busy"
    command = [sys.executable, "-m", "service.command", "render", *TINY, "-o", str(out), "--resume", str(out)]
    done = subprocess.run([*command, "--time", f"{left.seconds + 0.3}s"], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    resumed = Estimate.read(out)
    assert resumed.samples > left.samples
    assert sorted(p.name for p in tmp_path.iterdir() if not p.name.startswith(".")) == sorted(WRITTEN)


ANNOUNCED = """
from service.command import main, rendering
rendered = rendering.progressive
def announced(*arguments, **more):
    for snapshot in rendered(*arguments, **more):
        print("snapshot", flush=True)
        yield snapshot
rendering.progressive = announced
main.main()
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda number: number.name)
def test_an_interrupted_render_saves_its_image_and_exits_with_130(tmp_path: Path, number: signal.Signals) -> None:
    out = tmp_path / "out.exr"
    arguments = ["render", *TINY, "--time", "120s", "--json", "-o", str(out)]
    process = subprocess.Popen(
        [sys.executable, "-c", ANNOUNCED, *arguments],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "snapshot\n"
        os.kill(process.pid, number)
        stdout, stderr = process.communicate(timeout=60)
    finally:
        process.kill()
        process.wait()
    assert process.returncode == 130, stderr
    report = json.loads(stdout.splitlines()[-1])
    assert report["stopped_by"] == "interrupted"
    assert Estimate.read(out).samples == report["samples"] > 0
    assert "interrupted" in stderr
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(WRITTEN)


def test_the_version_names_what_an_image_depends_on(
    fredholm: type[Command], capsys: pytest.CaptureFixture[str]
) -> None:
    assert fredholm("--version").code == 0
    assert said(capsys)[0].split()[0::2] == ["fredholm", "mitsuba", "drjit", "numpy"]


@pytest.mark.parametrize(
    ("asked", "size"),
    [((), (8, 4)), (("--width", "16"), (16, 8)), (("--height", "2"), (4, 2)), (("--size", "6x6"), (6, 6))],
)
def test_one_side_alone_keeps_the_proportions(
    asked: tuple[str, ...], size: tuple[int, int], fredholm: type[Command], tmp_path: Path
) -> None:
    film = '<film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="4"/></film>'
    path = tmp_path / "wide.xml"
    path.write_text(f'<scene version="3.0.0"><sensor type="perspective">{film}</sensor></scene>')
    assert fredholm("render", path, "--spp", "1", *asked).code == 0
    estimate = Estimate.read(tmp_path / "out.exr")
    assert (estimate.width, estimate.height) == size


def test_a_size_and_a_side_are_refused_together(fredholm: type[Command], capsys: pytest.CaptureFixture[str]) -> None:
    assert fredholm("render", "furnace", "--size", "8x8", "--width", "8").code == 2
    assert "--size is '8x8' and --width or --height is given as well" in said(capsys)[1]


def test_a_sensor_is_chosen_by_name_or_number(
    fredholm: type[Command], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def sensor(name: str, side: int) -> str:
        film = f'<film type="hdrfilm"><integer name="width" value="{side}"/><integer name="height" value="8"/></film>'
        return f'<sensor type="perspective" id="{name}">{film}</sensor>'

    path = tmp_path / "two.xml"
    path.write_text(f'<scene version="3.0.0">{sensor("a", 8)}{sensor("b", 12)}<emitter type="constant"/></scene>')
    for asked, width in ((("--sensor", "b"), 12), (("--sensor", "1"), 12), ((), 8)):
        assert fredholm("render", path, "--spp", "1", "--json", *asked).code == 0
        out, err = said(capsys)
        assert json.loads(out)["width"] == width
        assert ("2 sensors: the picture is the first one's, 'a'" in err) == ("--sensor" not in asked)
    assert fredholm("render", path, "--sensor", "c", "--spp", "1").code == 2
    assert "sensor is 'c', and the scene has 0 'a', 1 'b'" in said(capsys)[1]
    assert fredholm("inspect", path).code == 0
    assert "a 8×8 (perspective), b 12×8 (perspective)" in said(capsys)[0]


def test_the_picture_is_small_and_resume_and_merge_find_its_checkpoint(
    fredholm: type[Command], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """A 512×512 EXR was 39 MB: 149 bytes a pixel. The commands that the README has always named go on working."""
    asked = ("cornell-box", "--size", "64x64", "--uniform", "--replicate-size", "16")
    assert fredholm("render", *asked, "--spp", "64", "-o", "straight.exr").code == 0
    assert fredholm("render", *asked, "--spp", "32").code == 0
    assert fredholm("render", *asked, "--spp", "64", "--resume", "out.exr").code == 0
    straight, resumed = Estimate.read("straight.exr"), Estimate.read("out.exr")
    assert np.array_equal(straight.mean, resumed.mean)
    assert np.array_equal(straight.moments.m2, resumed.moments.m2)
    assert (tmp_path / "out.exr").stat().st_size < 24 * 64 * 64 + 10_000
    assert fredholm("render", *asked, "--spp", "64", "--seed", "1", "-o", "b.exr", "--half").code == 0
    assert (tmp_path / "b.exr").stat().st_size < 0.7 * (tmp_path / "out.exr").stat().st_size
    assert fredholm("merge", "out.exr", "b.exr", "-o", "c.exr").code == 0
    assert Estimate.read("c.exr").spp == Estimate.read("c.checkpoint.exr").spp == 128
    capsys.readouterr()
    (tmp_path / "b.checkpoint.exr").rename(tmp_path / "elsewhere.exr")
    assert fredholm("merge", "out.exr", "b.exr", "-o", "d.exr").code == 2
    said_of_it = said(capsys)[1]
    assert "b.exr is a picture, without the moments that going on, merging and replaying need" in said_of_it
    assert "they are in its checkpoint b.checkpoint.exr: put that file beside it, or name it" in said_of_it
    assert fredholm("merge", "out.exr", "elsewhere.exr", "-o", "d.exr").code == 0


def test_a_checkpoint_is_left_out_or_put_elsewhere_on_request(
    fredholm: type[Command], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "kept").mkdir()
    assert fredholm("render", *TINY, "--spp", "1", "--checkpoint", "kept/all.exr").code == 0
    assert Estimate.read("kept/all.exr").spp == 1
    assert fredholm("render", *TINY, "--spp", "1", "--no-checkpoint", "-o", "alone.exr").code == 0
    assert sorted(p.name for p in tmp_path.glob("*.exr")) == ["alone.exr", "out.exr"]
    assert fredholm("render", *TINY, "--spp", "2", "--resume", "alone.exr").code == 2
    assert "no checkpoint was written with it; render again with --checkpoint" in said(capsys)[1]
    for options in (
        ("--checkpoint", "out.exr"),
        ("--checkpoint", "a.txt"),
        ("--checkpoint", "a.exr", "--no-checkpoint"),
    ):
        assert fredholm("render", *TINY, "--spp", "1", *options).code == 2


def test_a_picture_never_stands_for_the_checkpoint_of_another_render(
    fredholm: type[Command], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert fredholm("render", *TINY, "--spp", "1").code == 0
    (tmp_path / "out.exr").rename(tmp_path / "first.exr")
    assert Estimate.read("first.exr").spp == 1
    assert fredholm("render", *TINY, "--spp", "1", "--seed", "1").code == 0
    assert fredholm("render", *TINY, "--spp", "2", "--resume", "first.exr", "-o", "x.exr").code == 2
    assert "out.checkpoint.exr beside it is of another render by now" in said(capsys)[1]
