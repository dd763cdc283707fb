"""What a process that checks scenes cannot do any more, tried from within it."""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
from pathlib import Path

import pytest
from service_process import PLAIN_SCENE, ROOT
from structlog.testing import capture_logs

from service.engine import sandbox
from service.engine.inspection import inspect_upload
from service.engine.inspectors import Inspector, Inspectors
from service.engine.turn import SceneFacts

_TRY = """
import ctypes, json, mmap, os, signal, socket, subprocess, sys, threading
from pathlib import Path
from service.engine import inspection

folder, canaries = sys.argv[1], json.loads(sys.argv[2])
lacks = inspection.prepare(folder, 64 << 20, True)
import mitsuba as mi

def outcome(what):
    try:
        what()
        return "done"
    except Exception as error:
        return type(error).__name__

def in_mitsubas_threads():
    import drjit as dr
    return {str(path): outcome(lambda: mi.MemoryStream() and mi.FileStream(path)) for path in canaries}

def elsewhere(what):
    found = []
    thread = threading.Thread(target=lambda: found.append(outcome(what)))
    thread.start()
    thread.join()
    return found[0]

libc = ctypes.CDLL(None, use_errno=True)
told = {
    "lacks": lacks,
    "reads": {path: outcome(lambda: Path(path).read_bytes()) for path in canaries},
    "reads in a thread": {path: elsewhere(lambda: Path(path).read_bytes()) for path in canaries},
    "reads through Mitsuba": in_mitsubas_threads(),
    "lists home": outcome(lambda: os.listdir(os.path.dirname(canaries[0]))),
    "writes": outcome(lambda: Path(folder, "incoming", "x").write_text("x")),
    "writes elsewhere": outcome(lambda: Path(canaries[0] + ".x").write_text("x")),
    "connects": outcome(lambda: socket.create_connection(("127.0.0.1", 9), timeout=2)),
    "opens a socket": outcome(lambda: socket.socket(socket.AF_UNIX)),
    "opens a socket in a thread": elsewhere(lambda: socket.socket()),
    "starts a program": outcome(lambda: subprocess.run(["/bin/true"])),
    "signals its parent": outcome(lambda: os.kill(os.getppid(), 0)),
    "traces": libc.ptrace(0, 0, 0, 0),
    "takes memory": outcome(lambda: bytearray(1 << 30)),
    "working folder": os.listdir("."),
    "reads its own": outcome(lambda: Path(folder, "incoming", "scene.xml").read_bytes()),
    "resolves": [str(mi.file_resolver()[i]) for i in range(len(mi.file_resolver()))],
}
print(json.dumps(told))
"""
needs_both = pytest.mark.skipif(bool(sandbox.missing()), reason="; ".join(sandbox.missing()) or "-")


@pytest.fixture
def inspector(tmp_path: Path) -> Inspector:
    made = Inspector(tmp_path / "inspection" / "0")
    made.prepare()
    return made


@needs_both
def test_a_process_that_checks_scenes_reaches_its_own_folder_and_nothing_else(
    inspector: Inspector, tmp_path: Path
) -> None:
    here, other = tmp_path / "here", tmp_path / "inspection" / "1" / "incoming"
    canaries = [here / "canary.obj", other / "canary.obj", tmp_path / "secret", Path("/etc/passwd")]
    for path in canaries[:3]:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("v 0 0 0")
    (inspector.incoming / "scene.xml").write_text(PLAIN_SCENE)
    command = [sys.executable, "-c", _TRY, str(inspector.incoming.parent), json.dumps([str(path) for path in canaries])]
    environment = {"PYTHONPATH": str(ROOT), "HOME": str(here)}
    done = subprocess.run(command, capture_output=True, text=True, cwd=here, env=environment, timeout=180)
    assert done.returncode == 0, done.stderr[-2000:]
    told = json.loads(done.stdout.splitlines()[-1])
    assert told["lacks"] == []
    for how in ("reads", "reads in a thread"):
        assert set(told[how].values()) == {"PermissionError"}, told
    assert "done" not in told["reads through Mitsuba"].values()
    for what in ("lists home", "writes", "writes elsewhere", "connects", "opens a socket", "starts a program"):
        assert told[what] == "PermissionError", (what, told[what])
    assert told["opens a socket in a thread"] == "PermissionError"
    assert told["signals its parent"] == "PermissionError"
    assert told["traces"] == -1
    assert told["takes memory"] == "MemoryError"
    assert told["working folder"] == []
    assert told["reads its own"] == "done"
    assert str(here) not in told["resolves"], "the folder in which the service was started"


def test_a_scene_is_checked_within_it(inspector: Inspector) -> None:
    (inspector.incoming / "scene.xml").write_text(PLAIN_SCENE)

    async def checked() -> SceneFacts:
        try:
            what = (str(inspector.incoming), "scene.xml", 1 << 30)
            return await inspector.run(inspect_upload, *what, seconds=60, bytes_=1 << 30)
        finally:
            inspector.close()

    facts = asyncio.run(checked())
    assert facts.failure is None
    assert (facts.width, facts.height) == (32, 24)


def test_what_the_system_cannot_do_is_said(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(sandbox, "_landlock_version", lambda: 0)
    monkeypatch.setattr(sandbox.platform, "machine", lambda: "riscv64")
    assert len(sandbox.missing()) == 2
    with capture_logs() as lines:
        Inspectors(tmp_path).prepare()
    assert [line["lack"] for line in lines] == sandbox.missing(), "at the start"
    assert "Landlock" in sandbox.confine_files([], [])[0]
    assert "riscv64" in sandbox.confine_calls(may_start_programs=False)[0]
