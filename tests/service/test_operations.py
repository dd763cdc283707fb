"""What operators rely on: readiness that says why not, figures, ids in logs, an end that saves, retention."""

from __future__ import annotations

import asyncio
import os
import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

import httpx
import pytest
from prometheus_client.parser import text_string_to_metric_families
from service_process import LONG, Server, is_alive, wait_for
from sqlalchemy import update

from service.housekeeping import Housekeeping
from service.metrics import Metrics
from service.quarantine import Quarantine
from service.room import Disk
from service.settings import ServiceSettings
from service.states import Step
from service.store import Database, JobNotFound, JobStore, NewJob, SceneRecord, SceneStore
from service.store.schema import events, jobs
from service.uploads import Uploads

NEW = NewJob("Box", "gallery", "cornell-box", "Box", {"spp": 1}, {"width": 4})


def test_figures_are_prometheus_text_and_count_what_happened(server: Server, client: httpx.Client) -> None:
    def figures() -> dict[str, float]:
        text = client.get("/metrics").text
        samples = [one for family in text_string_to_metric_families(text) for one in family.samples]
        return {one.name + "".join(one.labels.values()): one.value for one in samples}

    before = figures()
    server.wait_ended(server.submit({"spp": 16})["id"])
    after = figures()
    assert after["fredholm_samples_total"] - before.get("fredholm_samples_total", 0) >= 16 * 64 * 64
    assert after["fredholm_turns_total"] > before.get("fredholm_turns_total", 0)
    assert after["fredholm_first_picture_seconds_count"] == before["fredholm_first_picture_seconds_count"] + 1
    assert after["fredholm_jobssucceeded"] == before["fredholm_jobssucceeded"] + 1
    assert after["fredholm_jobsqueued"] == 0
    assert after["fredholm_memory_bytesservice"] > 10e6
    assert after["fredholm_memory_bytesrender"] > 10e6


def test_a_request_has_an_id_in_its_answer_and_in_the_log(server: Server, client: httpx.Client) -> None:
    answer = client.post("/api/jobs/nope/cancel", headers={"X-Request-ID": "my-request.7"})
    assert answer.headers["X-Request-ID"] == "my-request.7"
    assert len(client.get("/healthz").headers["X-Request-ID"]) == 16
    logged = [line for line in server.log() if line.get("request") == "my-request.7"]
    assert [line["status"] for line in logged] == [404]


def test_not_ready_says_why(own_server: Server) -> None:
    own_server.environment["FREDHOLM_WARM_UP"] = "1"
    own_server.start(wait_until="/healthz")
    answer = httpx.get(f"{own_server.url}/readyz")
    assert answer.status_code == 503
    assert answer.json()["not_ready"] == ["the renderer is starting"]
    wait_for(lambda: httpx.get(f"{own_server.url}/readyz").json()["not_ready"] == [], 60, "readiness")


def test_an_end_saves_what_runs_and_the_next_start_goes_on(own_server: Server) -> None:
    own_server.environment["FREDHOLM_CHECKPOINT_SECONDS"] = "600"
    own_server.start()
    ids = [own_server.submit(LONG, {"width": 256, "height": 256, "seed": seed})["id"] for seed in range(3)]
    for job_id in ids:
        own_server.wait(job_id, lambda job: job["frame_seq"] > 1)
    told = {job_id: own_server.job(job_id)["samples"] for job_id in ids}
    own_server.stop()
    assert not [pid for pid in own_server.render_pids() if is_alive(pid)]
    assert len(list(own_server.data_dir.glob("estimates/*/*.exr"))) == 3
    own_server.start()
    for job_id in ids:
        assert own_server.job(job_id)["samples"] >= told[job_id], "nothing was lost"


def test_a_missing_driver_or_foreign_database_is_one_sentence(tmp_path: Path, server: Server) -> None:
    mine = Server(tmp_path / "data", {"FREDHOLM_DATABASE_URL": f"sqlite:///{server.data_dir / 'fredholm.sqlite'}"})
    with pytest.raises(AssertionError, match="belongs to another data folder"):
        mine.start()


@dataclass
class Deleter:
    """Deletes as the runner does."""

    store: JobStore
    deleted: list[str] = field(default_factory=list)

    async def delete(self, job_id: str) -> None:
        self.store.delete(job_id)
        self.deleted.append(job_id)


def test_old_jobs_and_events_are_forgotten(database_url: str, tmp_path: Path) -> None:
    database = Database(database_url)
    database.create_tables()
    store = JobStore(database)
    ids = [store.add(NEW)[0].id for _ in range(3)]
    for _ in ids:
        claimed = store.claim()
        assert claimed is not None
    for job_id in ids[:2]:
        store.move(job_id, Step.FINISH)
    with database.write() as connection:
        old = "2001-01-01T00:00:00.000Z"
        connection.execute(update(jobs).where(jobs.c.id == ids[0]).values(finished_at=old))
        connection.execute(update(events).where(events.c.job_id == ids[2]).values(at=old))
    deleter = Deleter(store)
    settings = ServiceSettings(data_dir=tmp_path, keep_jobs_days=30)
    quarantine = Quarantine(settings.quarantine_dir)
    uploads = Uploads(settings, SceneStore(database), quarantine, Disk(tmp_path, 0))
    keeper = Housekeeping(settings, store, uploads, cast(Any, deleter), Metrics(), quarantine)
    asyncio.run(keeper.forget_old())
    assert deleter.deleted == [ids[0]]
    with pytest.raises(JobNotFound):
        store.get(ids[0])
    assert {event.job_id for event in store.events_after(0, 100)} == {ids[0], ids[1]}
    assert store.get(ids[2]).id == ids[2]
    database.close()


def test_old_scenes_are_forgotten_unless_used_since(database_url: str, tmp_path: Path) -> None:
    database = Database(database_url)
    database.create_tables()
    store = SceneStore(database)
    settings = ServiceSettings(data_dir=tmp_path, keep_scenes_days=30)
    old = "2001-01-01T00:00:00.000Z"
    for name in ("unused", "needed", "again"):
        store.add(SceneRecord(name, "n", f"{name}/scene.xml", 4, 3, "d", (), old))
        folder = settings.scenes_dir / name
        folder.mkdir(parents=True)
        os.utime(folder, (0, time.time() if name == "again" else 1e9))
    JobStore(database).add(replace(NEW, scene_kind="upload", scene_ref="needed"))
    quarantine = Quarantine(settings.quarantine_dir)
    uploads = Uploads(settings, store, quarantine, Disk(tmp_path, 0))
    keeper = Housekeeping(settings, JobStore(database), uploads, cast(Any, None), Metrics(), quarantine)
    asyncio.run(keeper.forget_old())
    assert store.ids() == {"needed", "again"}
    assert sorted(folder.name for folder in settings.scenes_dir.iterdir()) == ["again", "needed"]
    database.close()


def test_a_reader_that_stops_reading_costs_nothing(server: Server) -> None:
    """Its stream is open, and it never takes a byte: others are served as before."""
    import socket

    with socket.create_connection(("127.0.0.1", server.port)) as lazy:
        lazy.sendall(b"GET /api/events HTTP/1.1\r\nHost: localhost\r\n\r\n")
        job_id = server.submit({"seconds": 1.5})["id"]
        began = time.monotonic()
        assert server.wait_ended(job_id)["state"] == "succeeded"
        assert time.monotonic() - began < 30


def test_without_its_page_the_service_says_how_to_build_it(own_server: Server, tmp_path: Path) -> None:
    own_server.environment["FREDHOLM_STATIC_DIR"] = str(tmp_path / "nothing")
    own_server.start()
    assert "make run" in httpx.get(own_server.url).text
    for path in ("/assets/index.js", "/%00"):
        assert httpx.get(own_server.url + path).status_code == 404
    assert "Traceback" not in own_server.log_path.read_text()
