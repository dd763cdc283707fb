"""Hostile uploads over HTTP: each gets the error that names it, and the service stays as it was."""

from __future__ import annotations

import re
from pathlib import Path

import httpx
import pytest

from tests.faults.canary import Canary
from tests.faults.hostile import ALL, Hostile
from tests.faults.seeds import scene
from tests.service.service_process import Server

DEADLINE = 90.0  # of one answer, with the start of a process, on a busy machine; `make fuzz` prints what they take
MEMORY_BYTES = 1536 << 20  # of the server and the process that loads scenes, together


def upload(server: Server, file_name: str, content: bytes) -> httpx.Response:
    return httpx.post(f"{server.url}/api/scenes", files={"file": (file_name, content)}, timeout=DEADLINE)


def memory_of(server: Server) -> int:
    """Resident bytes of the server and of the process that loads scenes."""
    assert server.process is not None
    pids = [server.process.pid, *server.render_pids(engine="inspect")[-1:]]
    total = 0
    for pid in pids:
        status = Path(f"/proc/{pid}/status")
        if status.exists() and (found := re.search(r"VmRSS:\s+(\d+)", status.read_text())):
            total += int(found[1]) * 1024
    return total


def test_the_corpus_is_large_and_every_case_has_a_name_of_its_own() -> None:
    assert len({case.name for case in ALL}) == len(ALL) >= 60


@pytest.mark.parametrize("case", ALL, ids=lambda case: case.name)
def test_a_hostile_input_gets_the_error_that_names_it(case: Hostile, victim: Server, canary: Canary) -> None:
    canary.touched()
    answer = upload(victim, case.file_name, case.make())
    assert answer.status_code == 422, answer.text
    problem = answer.json()
    assert re.search(case.says, problem["detail"]), problem["detail"]
    assert "with an unexpected" not in problem["detail"]
    assert str(victim.data_dir) not in answer.text
    assert ".upload-" not in answer.text
    assert len(problem["detail"]) < 1000
    assert canary.touched() == []
    assert victim.process is not None
    assert victim.process.poll() is None
    assert memory_of(victim) < MEMORY_BYTES


def test_the_service_still_takes_a_good_scene_afterwards(victim: Server) -> None:
    assert upload(victim, "a.xml", scene('<shape type="cube"/>')).status_code in (200, 201)
    assert list((victim.data_dir / "inspection").glob("*/incoming/.upload-*")) == []
    assert upload(victim, "a.xml", scene("")).status_code in (200, 201)
