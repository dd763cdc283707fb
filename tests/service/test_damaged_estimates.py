"""Saved estimates that are not what was saved: never taken for it, never a mistake of the service, never silent."""

from __future__ import annotations

import asyncio
import hashlib
import itertools
import random
import shutil
import sqlite3
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import httpx
import numpy as np
import pytest
from service_process import LONG, Server, wait_for
from test_full_disk import turn_of

import renderer
from service.damage import EstimateDamaged, first_sound
from service.engine import worker
from service.estimates import EstimateFiles
from service.quarantine import Quarantine
from service.routes.frames import checkpoint_exr
from service.store import Kept, Progress

SIZE = {"width": 48, "height": 48, "seed": 4}


def flip(path: Path, n: int = 2000) -> None:
    """Damage in the moments, which a reader takes for numbers like any other."""
    noise, content = random.Random(3), bytearray(path.read_bytes())
    for place in noise.sample(range(len(content) // 3, len(content)), n):
        content[place] ^= noise.randrange(1, 256)
    path.write_bytes(content)


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def empty(path: Path) -> None:
    path.write_bytes(b"")


DAMAGES = (flip, cut, empty, Path.unlink)


def saved_of(server: Server, job_id: str) -> list[Path]:
    return sorted((server.data_dir / "estimates" / job_id).glob("[0-9]*.exr"))


def statuses(server: Server, job_id: str) -> dict[str, int]:
    base = f"{server.url}/api/jobs/{job_id}"
    paths = ("", "/image.exr", "/checkpoint.exr", "/image.png", "/frames/latest", "/pixel?x=1&y=1")
    return {path: httpx.get(base + path, timeout=30).status_code for path in paths}


def go_on(server: Server, job_id: str, spp: int) -> dict[str, Any]:
    answer = httpx.post(f"{server.url}/api/jobs/{job_id}/continue", json={"target": {"spp": spp}}, timeout=30)
    assert answer.status_code == 200, answer.text
    return server.wait_ended(job_id)


def test_the_newest_sound_estimate_stands_in_and_the_loss_is_said() -> None:
    kept = [Kept(f"j/{n}.exr", "d", Progress(spp=n)) for n in (12, 8)]

    def read_from(sound: str) -> Any:
        def read(one: Kept) -> str:
            if one.name not in sound:
                raise EstimateDamaged("its checksum differs")
            return one.name

        return read

    assert first_sound(kept, read_from("j/12.exr j/8.exr")).losses == ()
    found = first_sound(kept, read_from("j/8.exr"))
    assert (found.value, found.kept) == ("j/8.exr", kept[1])
    assert found.losses == (
        "The estimate that was saved at 12 samples per pixel is damaged (its checksum differs); "
        "the one before it is used, of 8 samples per pixel.",
    )
    lost = first_sound(kept, read_from(""))
    assert (lost.value, lost.kept, len(lost.losses)) == (None, None, 2)
    assert all("no earlier one" in loss for loss in lost.losses)


def test_a_damaged_estimate_of_an_ended_job_is_gone_with_a_cause(own_server: Server) -> None:
    own_server.start()
    jobs = {damage: own_server.submit({"spp": 64}, SIZE) for damage in DAMAGES}
    old = own_server.submit({"spp": 64}, SIZE)["id"]  # saved by a version that made no checksums
    for job in (*jobs.values(), {"id": old}):
        own_server.wait_ended(job["id"])
    for damage, job in jobs.items():
        damage(saved_of(own_server, job["id"])[0])
    empty(saved_of(own_server, old)[0])
    with sqlite3.connect(own_server.data_dir / "fredholm.sqlite") as database:
        database.execute("UPDATE jobs SET checkpoint_digest = NULL WHERE id = ?", (old,))
    for job in (*jobs.values(), {"id": old}):
        found = statuses(own_server, job["id"])
        assert found == {path: 200 if path == "" else 410 for path in found}, found
        detail = httpx.get(f"{own_server.url}/api/jobs/{job['id']}/image.exr").json()["detail"]
        assert "64 samples per pixel" in detail
        assert "/" not in detail
        warnings = own_server.job(job["id"])["warnings"]
        assert [one for one in warnings if "damaged" in one] == warnings[:1], "said once, however often it is asked for"
    listed = httpx.get(f"{own_server.url}/api/jobs").json()["jobs"]
    assert all("damaged" in job["warnings"][0] for job in listed)
    # It is rendered anew, with the bits of a calm run.
    again = go_on(own_server, jobs[flip]["id"], 96)
    assert (again["state"], again["spp"]) == ("succeeded", 96)
    assert "damaged" in again["warnings"][0]
    mine = renderer.Estimate.read(saved_of(own_server, again["id"])[0])
    calm = renderer.render("cornell-box", renderer.Target(spp=96), renderer.Settings(48, 48, 4))
    assert np.array_equal(mine.moments.mean, calm.moments.mean)
    assert "Traceback" not in own_server.log_path.read_text()


def test_a_sound_estimate_that_is_not_the_one_that_was_saved_is_not_begun_from(tmp_path: Path) -> None:
    """Whoever reads it finds nothing wrong: its checksum alone tells."""

    def saved(seed: int) -> Kept:
        turn = replace(turn_of(tmp_path, spp=4), settings={"width": 8, "height": 8, "seed": seed}, job_id=f"j{seed}")
        while (told := worker.advance(turn)).stopped_by is None:
            assert told.failure is None, told.failure
        assert told.saved is not None
        return told.saved

    mine, other = saved(1), saved(2)
    folder = tmp_path / "estimates"
    again = replace(turn_of(tmp_path, spp=8), settings={"width": 8, "height": 8, "seed": 1}, job_id="j1", kept=(mine,))
    shutil.copy(folder / other.name, folder / mine.name)
    began = worker.advance(replace(again, attempt=2))
    assert began.start is not None
    assert began.start.damaged == ((mine, "its checksum differs"),)
    files = EstimateFiles(folder, Quarantine(tmp_path / "quarantine"))
    with pytest.raises(EstimateDamaged, match="its checksum differs"):
        files.check(mine)
    files.check(other)


@pytest.mark.parametrize("damage", [flip, Path.unlink])
def test_a_running_job_goes_on_from_the_estimate_before_the_damaged_one(own_server: Server, damage: Any) -> None:
    own_server.start()
    job_id = own_server.submit(LONG, SIZE)["id"]
    wait_for(lambda: len(saved_of(own_server, job_id)) >= 3, 30, "three saved estimates")
    own_server.kill()
    with sqlite3.connect(own_server.data_dir / "fredholm.sqlite") as database:
        name, earlier = database.execute("SELECT checkpoint, earlier FROM jobs WHERE id = ?", (job_id,)).fetchone()
    assert earlier
    damage(own_server.data_dir / "estimates" / name)
    own_server.start()
    went_on = own_server.wait(job_id, lambda job: bool(job["warnings"]) and job["frame_seq"] > 0)
    assert "the one before it is used" in went_on["warnings"][0]
    wait_for(lambda: len(saved_of(own_server, job_id)) >= 2, 30, "another saved estimate")
    ended = own_server.cancel(job_id).json()
    assert (ended["state"], len(ended["warnings"])) == ("cancelled", 1)
    wait_for(lambda: len(saved_of(own_server, job_id)) == 1, 60, "the end of the estimates that are needed no more")
    (kept,) = saved_of(own_server, job_id)
    mine = renderer.Estimate.read(kept)
    spp = float(mine.count.mean() * mine.replicate_size)
    assert spp == pytest.approx(ended["spp"])
    if damage is flip:
        assert list((own_server.data_dir / "quarantine").glob(f"*/estimates/{name}"))


def test_what_is_to_be_sent_outlives_the_files_of_its_job(tmp_path: Path) -> None:
    """A job that ends between the head of an answer and its body."""
    files = EstimateFiles(tmp_path / "estimates", Quarantine(tmp_path / "quarantine"))
    files.prepare()
    content = b"x" * 300_000
    (files.folder / "j").mkdir()
    files.path("j/1.exr").write_bytes(content)
    kept = (Kept("j/1.exr", hashlib.sha256(content).hexdigest(), Progress()),)
    job: Any = SimpleNamespace(id="j", checkpoint="j/1.exr", kept=kept, name="a", scene_kind="upload", scene_ref="s")
    service: Any = SimpleNamespace(files=files)
    sent = bytearray()

    async def nothing() -> Any:
        await asyncio.Event().wait()  # its client stays

    async def take(message: Any) -> None:
        sent.extend(message.get("body", b""))

    async def answered() -> None:
        answer = await checkpoint_exr(job, service)
        files.remove("j")
        await answer({"type": "http", "method": "GET", "headers": []}, nothing, take)

    asyncio.run(answered())
    assert bytes(sent) == content
    assert not list(files.sending.iterdir())
    files.remove_displays()


def test_an_image_that_is_sent_is_whole_though_its_job_ends(server: Server, client: httpx.Client) -> None:
    """Pauses and resumptions replace the file while it is read."""
    job_id = server.submit(LONG, {"width": 512, "height": 512, "seed": 2})["id"]
    server.wait(job_id, lambda job: job["frame_seq"] > 1)
    for n in itertools.count():
        with client.stream("GET", f"/api/jobs/{job_id}/checkpoint.exr", timeout=60) as answer:
            assert answer.status_code == 200
            size, length, parts = 0, int(answer.headers["Content-Length"]), answer.iter_bytes(65536)
            size += len(next(parts))
            server.cancel(job_id)
            size += sum(map(len, parts))
        assert size == length
        if n == 2:
            break
        httpx.post(f"{server.url}/api/jobs/{job_id}/continue", json={"target": LONG}, timeout=30)
        server.wait(job_id, lambda job: job["state"] == "running")
    wait_for(lambda: not list((server.data_dir / "sending").iterdir()), 60, "the end of what was held for sending")
