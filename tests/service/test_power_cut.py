"""What was acknowledged is on disk: written, synced, renamed, synced again, recorded, and only then told."""

from __future__ import annotations

import asyncio
import errno
import io
import os
import shutil
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from service_process import PLAIN_SCENE, SMALL, Server
from test_full_disk import turn_of

from service.durable_files import move_into_place
from service.engine import worker
from service.engine.turn import SceneFacts
from service.errors import ProblemError
from service.quarantine import Quarantine
from service.room import Disk
from service.settings import ServiceSettings
from service.shown import MOST_CHARACTERS
from service.store import Database, SceneDamaged, SceneRecord, SceneStore
from service.uploads import Uploads

Calls = list[tuple[str, str]]


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Calls:
    """Names that were synced, renamed and recorded, in order."""
    made: Calls = []
    fsync, replace = os.fsync, os.replace

    def named(descriptor: int) -> str:
        return os.readlink(f"/proc/self/fd/{descriptor}").removeprefix(f"{tmp_path}/")

    def synced(descriptor: int) -> None:
        made.append(("sync", named(descriptor)))
        fsync(descriptor)

    def replaced(source: Any, target: Any) -> None:
        made.append(("rename", str(target).removeprefix(f"{tmp_path}/")))
        replace(source, target)

    if not Path("/proc/self/fd").is_dir():
        pytest.skip("only Linux says which file a descriptor is")
    monkeypatch.setattr(os, "fsync", synced)
    monkeypatch.setattr(os, "replace", replaced)
    return made


@pytest.fixture
def uploads(tmp_path: Path, calls: Calls, monkeypatch: pytest.MonkeyPatch) -> Iterator[Uploads]:
    """Uploads whose scenes are not looked into."""
    settings = ServiceSettings(data_dir=tmp_path, disk_reserve_bytes=0)
    database = Database(f"sqlite:///{tmp_path}/scenes.sqlite")
    database.create_tables()
    store = SceneStore(database)
    taken = Uploads(settings, store, Quarantine(settings.quarantine_dir), Disk(tmp_path, 0))
    taken.prepare()

    async def inspect(*_: object) -> SceneFacts:
        return SceneFacts(4, 3, "digest", (), {"name": "a"})

    add = store.add

    def added(scene: SceneRecord) -> None:
        calls.append(("row", scene.id))
        add(scene)

    monkeypatch.setattr(taken, "_inspect", inspect)
    monkeypatch.setattr(store, "add", added)
    yield taken
    database.close()


def take(uploads: Uploads, name: str = "a.xml", content: str = PLAIN_SCENE) -> tuple[SceneRecord, bool]:
    return asyncio.run(uploads.take(io.BytesIO(content.encode()), name, ""))


def test_files_and_folders_of_an_upload_are_on_disk_before_its_row(uploads: Uploads, calls: Calls) -> None:
    scene, _ = take(uploads)
    at = calls.index(("rename", f"scenes/{scene.id}"))
    before, after = calls[:at], calls[at + 1 :]
    named = [name for what, name in before if what == "sync" and "/.upload-" in name]
    (folder,) = {next(part for part in Path(name).parts if part.startswith(".upload-")) for name in named}
    synced = [name.partition(folder)[2].lstrip("/") for name in named]
    assert {"a/scene.xml", "a", "requirements.json", ""} <= set(synced)
    assert synced.index("a/scene.xml") < synced.index("a") < synced.index("")
    assert after.index(("sync", "scenes")) < after.index(("row", scene.id))


def test_what_is_moved_into_place_was_synced_before(tmp_path: Path, calls: Calls) -> None:
    (tmp_path / "new").write_text("x")
    move_into_place(tmp_path / "new", tmp_path / "kept")
    assert calls == [("sync", "new"), ("rename", "kept"), ("sync", str(tmp_path))]


@pytest.mark.parametrize("when", ["before it is taken", "while it is written"])
def test_an_upload_without_room_is_told_so(
    uploads: Uploads, when: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    if when == "before it is taken":
        monkeypatch.setattr(uploads, "_disk", Disk(tmp_path, 1 << 62))
    else:
        monkeypatch.setattr(uploads, "_unpack", full)
    with pytest.raises(ProblemError) as refused:
        take(uploads)
    assert refused.value.problem.status == 507
    assert not list((tmp_path / "inspection").glob("*/incoming/*")), "nothing half written is left"


def test_long_names_of_an_upload_are_cut(uploads: Uploads, monkeypatch: pytest.MonkeyPatch) -> None:
    long = "x" * 100_000

    async def inspect(*_: object) -> SceneFacts:
        return SceneFacts(4, 3, "digest", (f"{long}: flat",), {"notes": [long], "sensor_choices": [{"name": long}]})

    monkeypatch.setattr(uploads, "_inspect", inspect)
    scene, _ = take(uploads)
    assert [len(one) for one in scene.warnings] == [MOST_CHARACTERS]
    told = uploads.requirements(scene.id)
    assert told is not None
    assert len(str(told)) < 5 * MOST_CHARACTERS


def test_a_saved_estimate_is_on_disk_before_it_is_told(tmp_path: Path, calls: Calls) -> None:
    turn = turn_of(tmp_path, spp=4)
    while (told := worker.advance(turn)).stopped_by is None:
        assert told.failure is None, told.failure
    assert told.saved is not None
    at = calls.index(("rename", f"estimates/{told.saved.name}"))
    assert calls[at - 1][0] == "sync", "its content"
    assert Path(calls[at - 1][1]).parent == Path("estimates/j")
    assert calls[at + 1 :] == [("sync", "estimates/j"), ("sync", "estimates")]


def test_what_is_committed_is_flushed(tmp_path: Path) -> None:
    database = Database(f"sqlite:///{tmp_path}/a.sqlite")
    with database.write() as connection:
        assert connection.exec_driver_sql("PRAGMA synchronous").scalar() == 2, "FULL"
    database.close()


@pytest.mark.parametrize("damage", ["empty", "flip", "missing", "no folder", "more", "requirements"])
def test_a_damaged_scene_is_found_out_and_healed_by_the_same_upload(
    uploads: Uploads, tmp_path: Path, damage: str
) -> None:
    scene, is_new = take(uploads)
    path = tmp_path / "scenes" / scene.path
    whole = path.read_bytes()
    if damage == "empty":
        path.write_bytes(b"")
    elif damage == "flip":
        path.write_bytes(whole.replace(b"0.4", b"0.5"))
    elif damage == "missing":
        path.unlink()
    elif damage == "no folder":
        shutil.rmtree(path.parent.parent)
    elif damage == "more":
        path.with_name("more.xml").write_text("x")
    else:
        (path.parent.parent / "requirements.json").write_text("")
    with pytest.raises(SceneDamaged, match=scene.id):
        uploads.check_whole(scene)
    # Under another name it is the same scene, in the folder that its row names.
    healed, is_new_again = take(uploads, "other.xml")
    assert (is_new, is_new_again) == (True, False)
    assert healed == scene
    assert path.read_bytes() == whole
    uploads.check_whole(scene)
    assert (uploads.requirements(scene.id) or {})["name"] == "other"


def test_a_damaged_scene_starts_no_job_and_is_healed_by_the_same_upload(server: Server, client: httpx.Client) -> None:
    content = PLAIN_SCENE.replace("0.4", "0.44")
    scene = client.post("/api/scenes", files={"file": ("a.xml", content)}, timeout=60).json()["id"]
    (path,) = (server.data_dir / "scenes" / scene).glob("*/scene.xml")
    path.write_bytes(b"")
    body = {"scene": {"id": scene}, "target": {"spp": 4}, "settings": {"width": 8, "height": 8}}
    refused = client.post("/api/jobs", json=body)
    assert refused.status_code == 410
    assert "upload the same scene again" in refused.json()["detail"]
    again = client.post("/api/scenes", files={"file": ("b.xml", content)}, timeout=60)
    assert again.json()["id"] == scene
    job = client.post("/api/jobs", json=body)
    assert server.wait_ended(job.json()["id"])["state"] == "succeeded"


def run(*command: object) -> None:
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True, timeout=60)
    if done.returncode != 0:
        pytest.skip(f"no file system of the test's own here: {' '.join(map(str, command))}: {done.stderr.strip()}")


@pytest.mark.slow
def test_what_was_acknowledged_outlives_a_power_cut(tmp_path: Path) -> None:
    """ext4 on a loop device, copied at the moment of the answer: what was not flushed by then is not in the copy."""
    if os.name == "nt" or os.geteuid() != 0:
        pytest.skip("a file system of the test's own can be mounted by root alone")
    disk, cut, folder = tmp_path / "disk.img", tmp_path / "cut.img", tmp_path / "mounted"
    folder.mkdir()
    run("truncate", "-s", "160M", disk)
    run("mkfs.ext4", "-q", "-F", disk)
    # Nothing goes to the disk by itself while this runs: only what is asked for does.
    run("mount", "-o", "loop,commit=600", disk, folder)
    server = Server(folder / "data", {"FREDHOLM_WARM_UP": "0", "FREDHOLM_DISK_RESERVE_BYTES": "0"})
    scenes: list[tuple[str, str]] = []
    jobs: list[str] = []
    try:
        server.start(wait_until="/healthz")
        for n in range(3):
            content = PLAIN_SCENE.replace("0.4", f"0.{n + 1}")
            answer = httpx.post(f"{server.url}/api/scenes", files={"file": ("a.xml", content)}, timeout=60)
            assert answer.status_code == 201, answer.text
            scenes.append((answer.json()["id"], content))
            jobs.append(server.wait_ended(server.submit({"spp": 16}, SMALL, id=scenes[-1][0])["id"])["id"])
        jobs.append(server.submit({"spp": 64}, SMALL, id=scenes[-1][0])["id"])
        assert server.process is not None
        os.killpg(server.process.pid, signal.SIGSTOP)
        shutil.copyfile(disk, cut)
        os.killpg(server.process.pid, signal.SIGCONT)
        server.kill()
    finally:
        subprocess.run(["umount", "-l", folder])
    run("mount", "-o", "loop", cut, folder)
    try:
        for scene, content in scenes:
            (path,) = (server.data_dir / "scenes" / scene).glob("*/scene.xml")
            assert path.read_text() == content
        server.start(wait_until="/healthz")
        for job_id in jobs:
            assert server.wait_ended(job_id)["state"] == "succeeded"
            assert server.job(job_id)["warnings"] == []
            assert httpx.get(f"{server.url}/api/jobs/{job_id}/image.exr").status_code == 200
        server.stop()
    finally:
        if server.process is not None and server.process.poll() is None:
            server.kill()
        subprocess.run(["umount", "-l", folder])
