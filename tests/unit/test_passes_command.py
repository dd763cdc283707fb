"""Facts about `fredholm passes` and the merge of its parts: as processes of a farm, interrupted, and misused."""

from __future__ import annotations

import contextlib
import io
import json
import os
import shlex
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path

import pytest

from renderer.estimate.estimate import Estimate
from renderer.estimate.moments import Moments
from service.command.main import main

ROOT = Path(__file__).resolve().parents[2]
SCENE = ("cornell-box", "--size", "16x12", "--replicate-size", "4", "--seed", "5")


@pytest.fixture(autouse=True)
def signal_handlers() -> Iterator[None]:
    """The command takes over two signals; the tests want theirs back."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def run(folder: Path, *arguments: str, code: int = 0) -> str:
    """Runs the command in this process, in a folder; returns what it says on standard error."""
    said, left = io.StringIO(), 0
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stderr(said):
        patch.chdir(folder)
        patch.setenv("COLUMNS", "200")
        patch.setattr(sys, "argv", ["fredholm", *arguments])
        try:
            main()
        except SystemExit as exit:
            left = exit.code if isinstance(exit.code, int) else int(exit.code is not None)
    assert left == code, said.getvalue()
    return said.getvalue()


def assert_same_bits(a: Estimate, b: Estimate) -> None:
    for field in fields(Moments):
        assert getattr(a.moments, field.name).tobytes() == getattr(b.moments, field.name).tobytes(), field.name


def test_eight_parts_of_a_shell_loop_merge_in_any_order_to_the_bits_of_one_render(tmp_path: Path) -> None:
    fredholm = f"{shlex.quote(sys.executable)} -m service.command"
    loop = f"""
        set -eu
        seq 0 7 | xargs -P 2 -I N sh -c \\
            '{fredholm} passes {" ".join(SCENE)} --replicates $((N * 3)):$((N * 3 + 3)) -o part-N.exr'
        {fredholm} merge part-*.exr -o ascending.exr
        {fredholm} merge part-7.exr part-2.exr part-0.exr part-5.exr part-1.exr part-6.exr part-4.exr part-3.exr \\
            -o mixed.exr
        {fredholm} merge part-[1357].exr -o odd.exr
        {fredholm} merge part-[0246].exr -o even.exr
        {fredholm} merge odd.exr even.exr -o halves.exr
        {fredholm} render {" ".join(SCENE)} --uniform --spp 96 -o straight.exr
    """
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        ["sh", "-c", loop], cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=500
    )
    assert done.returncode == 0, done.stderr
    assert "odd.exr: 48 spp from 4 files" in done.stderr
    assert "replicates 0:3 and 6:9 and 12:15 and 18:21 are missing: later ones wait for them" in done.stderr
    straight = Estimate.read(tmp_path / "straight.exr")
    assert straight.spp == 96
    for name in ("ascending", "mixed", "halves"):
        assert_same_bits(Estimate.read(tmp_path / f"{name}.exr"), straight)
    # What is merged is an estimate like any other: it can be replayed, and gone on from.
    run(tmp_path, "replay", "cornell-box", "mixed.exr", "3,4")
    run(tmp_path, "render", *SCENE, "--uniform", "--spp", "104", "--resume", "mixed.exr", "-o", "on.exr")
    run(tmp_path, "render", *SCENE, "--uniform", "--spp", "104", "-o", "longer.exr")
    assert_same_bits(Estimate.read(tmp_path / "on.exr"), Estimate.read(tmp_path / "longer.exr"))


def test_regions_are_said_while_others_are_missing(tmp_path: Path) -> None:
    for name, *where in (("top", "0:4", "0,0,16,5"), ("bottom", "0:4", "0,5,16,7"), ("more", "4:6", "0,0,16,12")):
        run(tmp_path, "passes", *SCENE, "--replicates", where[0], "--region", where[1], "-o", f"{name}.exr")
    half = run(tmp_path, "merge", "more.exr", "top.exr", "-o", "half.exr")
    assert "replicates 0:4 are missing" in half
    whole = run(tmp_path, "merge", "half.exr", "bottom.exr", "-o", "whole.exr")
    assert "missing" not in whole
    run(tmp_path, "render", *SCENE, "--uniform", "--spp", "24", "-o", "straight.exr")
    assert_same_bits(Estimate.read(tmp_path / "whole.exr"), Estimate.read(tmp_path / "straight.exr"))


STOPPED = """
import renderer.plan
from service.command import main, passes
renderer.plan.pass_samples_for = lambda *_: 400  # half a replicate
steps = passes.part_steps
def announced(*arguments, **more):
    for step in steps(*arguments, **more):
        if step.done.stop == {at} and not step.is_last:
            print("there", flush=True)
            input()
        yield step
passes.part_steps = announced
main.main()
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda number: number.name)
def test_an_interrupted_part_saves_what_is_whole_and_says_what_is_left(tmp_path: Path, number: signal.Signals) -> None:
    stderr, code, out = interrupted(tmp_path, number, at=9)
    assert code == 130, stderr
    report = json.loads(out.splitlines()[-1])
    assert (report["first"], report["end"], report["asked"]) == (6, 9, [6, 1000])
    assert report["stopped_by"] == "interrupted"
    assert "replicates 6:9" in stderr
    assert "9:1000 of 6:1000 are to be rendered" in stderr
    for name, replicates in (("before", "0:6"), ("after", "9:12")):
        run(tmp_path, "passes", *SCENE, "--replicates", replicates, "-o", f"{name}.exr")
    run(tmp_path, "merge", "after.exr", "part.exr", "before.exr", "-o", "all.exr")
    run(tmp_path, "render", *SCENE, "--uniform", "--spp", "48", "-o", "straight.exr")
    assert_same_bits(Estimate.read(tmp_path / "all.exr"), Estimate.read(tmp_path / "straight.exr"))


def test_a_part_of_which_nothing_is_whole_leaves_no_file(tmp_path: Path) -> None:
    stderr, code, out = interrupted(tmp_path, signal.SIGTERM, at=6)
    assert code == 130, stderr
    assert "part.exr is not written" in stderr
    assert json.loads(out.splitlines()[-1])["samples"] == 0
    assert not list(tmp_path.iterdir())


def interrupted(folder: Path, number: signal.Signals, at: int) -> tuple[str, int, str]:
    """Standard error, exit code and output of a part that is interrupted when replicates up to `at` are whole."""
    arguments = ("passes", *SCENE, "--replicates", "6:1000", "-o", "part.exr", "--json")
    process = subprocess.Popen(
        [sys.executable, "-c", STOPPED.replace("{at}", str(at)), *arguments],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "there\n"
        os.kill(process.pid, number)
        out, stderr = process.communicate("\n" * 50, timeout=120)
    finally:
        process.kill()
        process.wait()
    return stderr, process.returncode, out


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--replicates", "64"), "--replicates is '64'; write it as FIRST:END"),
        (("--replicates", "8:8"), "replicates are 8:8; the first must be 0 or more"),
        (("--replicates", "0:4", "-o", "part.png"), "--output is part.png; the name must end in .exr"),
        (("--replicates", "0:4", "--region", "9,9,9,9"), "reaches outside the image of 16×12"),
        (("--replicates", "0:4", "--guide", "maybe"), "guide is 'maybe'; choose one of off, on"),
        ((), "Missing option '--replicates'"),
    ],
)
def test_bad_input_is_named(tmp_path: Path, arguments: tuple[str, ...], said: str) -> None:
    done = run(tmp_path, "passes", *SCENE, *arguments, code=2)
    assert said in " ".join(done.split())
    assert not list(tmp_path.iterdir())


def test_what_cannot_be_merged_is_named_and_nothing_is_written(tmp_path: Path) -> None:
    for name, replicates in (("a", "0:4"), ("b", "3:6")):
        run(tmp_path, "passes", *SCENE, "--replicates", replicates, "-o", f"{name}.exr")
    (tmp_path / "c.exr").write_bytes(b"no picture")
    before = sorted(tmp_path.iterdir())
    overlap = run(tmp_path, "merge", "a.exr", "b.exr", "-o", "out.exr", code=2)
    assert "replicates overlap: both hold seed 5, both hold replicates 3:4 of 192 pixels" in overlap
    for other, named in (("c.exr", "c.exr cannot be read"), ("d.exr", "d.exr: no such file")):
        assert named in run(tmp_path, "merge", "a.exr", other, "-o", "out.exr", code=2)
    waits = run(tmp_path, "render", *SCENE, "--uniform", "--spp", "96", "--resume", "b.exr", "-o", "out.exr", code=2)
    assert "waits for replicates 0:3" in waits
    assert sorted(tmp_path.iterdir()) == before
