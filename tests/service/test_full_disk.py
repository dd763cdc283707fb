"""A disk without room: jobs wait and say so, what cannot be kept is not taken, and all go on by themselves."""

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import httpx
import numpy as np
import pytest
from service_process import LONG, PLAIN_SCENE, Server, wait_for
from sqlalchemy.exc import OperationalError
from starlette.requests import Request

import renderer
from service import errors
from service.engine import worker
from service.engine.turn import Turn
from service.room import Disk, Shortage, estimate_bytes, is_full, say_bytes

SIZE = {"width": 64, "height": 64, "seed": 4}
MEGABYTE = 10**6


def mount(folder: Path, size: int) -> None:
    folder.mkdir(exist_ok=True)
    done = subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(folder)], capture_output=True)
    if done.returncode != 0:
        pytest.skip("a file system of the test's own can be mounted by root alone")


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 40 MB."""
    if os.name == "nt" or os.geteuid() != 0:
        pytest.skip("a file system of the test's own can be mounted by root alone")
    folder = tmp_path / "disk"
    mount(folder, 40 * MEGABYTE)
    yield folder
    subprocess.run(["umount", "-l", str(folder)], check=True)


def fill(folder: Path, leave: int) -> Path:
    """A file that leaves so many bytes free."""
    filler = folder / "filler"
    free = os.statvfs(folder).f_bavail * os.statvfs(folder).f_frsize
    with filler.open("wb") as file:
        file.write(bytes(max(0, free - leave)))
    return filler


def turn_of(folder: Path, seconds: float = 60.0, spp: int = 32) -> Turn:
    return Turn(
        job_id="j",
        attempt=1,
        scene="furnace",
        is_gallery=True,
        target={"spp": spp},
        settings={"width": 64, "height": 64, "seed": 1},
        kept=(),
        display_path=str(folder / "displays" / "j-1.display"),
        estimates_dir=str(folder / "estimates"),
        next_seq=1,
        seconds=seconds,
        checkpoint_seconds=1000.0,
    )


def test_sizes_are_said_in_the_unit_that_fits() -> None:
    assert [say_bytes(n) for n in (12, 3.0e5, 300e6, 2.5e9)] == ["12 bytes", "300 kB", "300 MB", "2.5 GB"]
    assert Shortage(300 * MEGABYTE, 12).waits_for == "waits for 300 MB of disk; 12 bytes are free"


def test_an_estimate_takes_no_more_than_is_reckoned(tmp_path: Path) -> None:
    settings = renderer.Settings(96, 64, 1, channels=("albedo", "depth"))
    rendered = renderer.render("furnace", renderer.Target(spp=8), settings)
    rendered.write(tmp_path / "a.exr")
    assert 0.5 < (tmp_path / "a.exr").stat().st_size / estimate_bytes(96, 64, 2) <= 1


def test_a_run_without_room_keeps_what_it_has_and_saves_it_later(small_disk: Path) -> None:
    filler = fill(small_disk, 0)
    turn = replace(turn_of(small_disk), save=True)
    told = worker.advance(turn)
    for _ in range(4):
        told = worker.advance(turn)
        assert told.failure is None, told.failure
        assert told.unsaved is not None
        assert told.unsaved.reason
        assert told.unsaved.needed_bytes > 64 * 64 * 120
        assert (told.saved, told.stopped_by) == (None, None)
    assert told.progress is not None
    assert told.progress.spp == 32, "the last turns render nothing more"
    filler.unlink()
    told = worker.advance(turn)
    assert (told.unsaved, told.stopped_by) == (None, "spp")
    assert told.saved is not None
    mine = renderer.Estimate.read(small_disk / "estimates" / told.saved.name)
    calm = renderer.render("furnace", renderer.Target(spp=32), renderer.Settings(64, 64, 1))
    assert np.array_equal(mine.moments.mean, calm.moments.mean)


def test_a_display_that_cannot_be_written_is_not_fatal(small_disk: Path, tmp_path: Path) -> None:
    fill(small_disk, 0)
    turn = replace(turn_of(tmp_path), job_id="k", display_path=str(small_disk / "k.display"))
    while (told := worker.advance(turn)).stopped_by is None:
        assert told.failure is None, told.failure
    assert told.saved is not None
    assert not list(small_disk.glob("k.display*")), "nothing half written is left"


def test_what_a_full_disk_says_is_known_from_other_errors(small_disk: Path) -> None:
    fill(small_disk, 0)
    with pytest.raises(OSError) as full:  # noqa: PT011 - its number is looked at
        (small_disk / "a").write_bytes(bytes(8192))
    assert is_full(full.value)
    assert not is_full(FileNotFoundError(2, "no"))
    shortage = Disk(small_disk, 1000).shortage(500)
    assert shortage == Shortage(1500, 0)
    assert Disk(small_disk.parent, 0).shortage(1) is None


def test_what_a_full_database_says_is_known_and_answered_as_such() -> None:
    class OfPostgres(Exception):
        sqlstate = "53100"

    for cause in (Exception("database or disk is full"), OfPostgres("could not extend file")):
        full = OperationalError("INSERT", {}, cause)
        assert is_full(full)
        answer = asyncio.run(errors._on_lost_database(Request({"type": "http"}), full))
        assert answer.status_code == 507
    assert not is_full(OperationalError("INSERT", {}, Exception("database is locked")))


def test_jobs_wait_for_room_on_disk_and_go_on_by_themselves(own_server: Server, small_disk: Path) -> None:
    own_server.data_dir = small_disk  # its log lies beside, where there is room
    own_server.environment |= {"FREDHOLM_DISK_RESERVE_BYTES": str(MEGABYTE)}
    own_server.start(wait_until="/healthz")
    running = own_server.submit({"spp": 4096}, SIZE)["id"]
    own_server.wait(running, lambda job: job["frame_seq"] > 1)
    waiting = own_server.submit({"spp": 16}, {"width": 16, "height": 16})["id"]
    own_server.wait_ended(waiting)
    filler = fill(small_disk, 0)
    held = own_server.wait(running, lambda job: job["waits_for"] is not None)
    assert held["state"] == "running"
    assert "MB of disk" in held["waits_for"]
    listed = httpx.get(f"{own_server.url}/api/jobs").json()["jobs"]
    assert [job["waits_for"] for job in listed if job["id"] == running] == [held["waits_for"]]
    body = {"scene": {"gallery": "cornell-box"}, "target": {"spp": 4}, "settings": SIZE}
    for answer in (
        httpx.post(f"{own_server.url}/api/jobs", json=body),
        httpx.post(f"{own_server.url}/api/scenes", files={"file": ("a.xml", PLAIN_SCENE)}, timeout=60),
        httpx.post(f"{own_server.url}/api/jobs/{waiting}/continue", json={"target": {"spp": 64}}),
    ):
        assert answer.status_code == 507, answer.text
        assert "of disk are needed" in answer.json()["detail"]
    assert any("of disk are needed" in why for why in httpx.get(f"{own_server.url}/readyz").json()["not_ready"])
    filler.unlink()
    ended = own_server.wait(running, lambda job: job["state"] == "succeeded", 240)
    assert ended["waits_for"] is None
    mine = renderer.Estimate.read(next((own_server.data_dir / "estimates" / running).iterdir()))
    calm = renderer.render("cornell-box", renderer.Target(spp=4096), renderer.Settings(64, 64, 4))
    assert np.array_equal(mine.moments.mean, calm.moments.mean)
    assert httpx.post(f"{own_server.url}/api/jobs", json=body).status_code == 201


def test_an_upload_without_room_for_temporary_files_is_told_so(own_server: Server, small_disk: Path) -> None:
    own_server.environment |= {"TMPDIR": str(small_disk), "FREDHOLM_DISK_RESERVE_BYTES": "0"}
    own_server.start(wait_until="/healthz")
    filler = fill(small_disk, MEGABYTE)
    long = {"file": ("a.xml", PLAIN_SCENE + "<!--" + "x" * 3 * MEGABYTE + "-->")}
    answer = httpx.post(f"{own_server.url}/api/scenes", files=long, timeout=60)
    assert answer.status_code == 507, answer.text
    assert "too full to take in what was sent" in answer.json()["detail"]
    filler.unlink()
    assert httpx.post(f"{own_server.url}/api/scenes", files=long, timeout=60).status_code == 201


def test_a_failed_job_is_continued_from_its_estimate(own_server: Server) -> None:
    own_server.start()
    job_id = own_server.submit(LONG, SIZE)["id"]
    saved = own_server.data_dir / "estimates" / job_id
    wait_for(lambda: len(list(saved.glob("[0-9]*"))) > 1, 30, "a recorded estimate")
    own_server.environment |= {"FREDHOLM_CRASH_LIMIT": "1"}
    own_server.kill()
    n_renders = len(own_server.render_pids())
    own_server.start()
    seen = own_server.job(job_id)["spp"]
    own_server.wait(job_id, lambda job: job["spp"] > seen and len(own_server.render_pids()) > n_renders)
    os.kill(own_server.render_pids()[-1], signal.SIGKILL)
    failed = own_server.wait_ended(job_id)
    assert failed["state"] == "failed"
    assert failed["spp"] > 0
    answer = httpx.post(f"{own_server.url}/api/jobs/{job_id}/continue", json={"target": {"spp": 2**14}})
    assert (answer.status_code, answer.json()["cause"]) == (200, None)
    again = own_server.wait(job_id, lambda job: job["state"] == "running" and job["spp"] > failed["spp"])
    assert again["warnings"] == []
    own_server.cancel(job_id)
