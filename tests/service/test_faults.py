"""Kill anything: jobs go on, nothing is left behind."""

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
import sys

import httpx
import pytest
from event_stream import EventStream
from service_process import LONG, ROOT, SMALL, Server, is_alive, wait_for
from sqlalchemy import select, update

from service.store import Database
from service.store.schema import jobs


def test_a_killed_render_process_is_replaced_and_the_job_goes_on(server: Server) -> None:
    job_id = server.submit({"seconds": 4})["id"]
    before = server.wait(job_id, lambda job: job["seconds"] > 1.2)
    killed = server.render_pids()[-1]
    os.kill(killed, signal.SIGKILL)
    job = server.wait_ended(job_id)
    assert job["state"] == "succeeded", job
    assert job["stopped_by"] == "seconds"
    assert job["frame_seq"] > before["frame_seq"]
    assert server.render_pids()[-1] != killed
    # It went on from its last saved estimate: less was rendered again than had been rendered.
    lost = [line for line in server.log() if line.get("event") == "job lost its render process"]
    assert lost[-1]["job"] == job_id


def test_a_job_that_keeps_killing_its_render_process_fails_and_others_do_not(own_server: Server) -> None:
    own_server.environment |= {"FREDHOLM_CHECKPOINT_SECONDS": "60"}
    server = own_server.start()
    job_id = server.submit(LONG)["id"]
    for crash in range(3):
        known = len(server.render_pids())
        seen = server.job(job_id)["frame_seq"]
        server.wait(job_id, lambda job, seen=seen: job["frame_seq"] > seen)
        os.kill(server.render_pids()[-1], signal.SIGSEGV)
        if crash < 2:
            wait_for(lambda known=known: len(server.render_pids()) > known, 30, "a new render process")
    job = server.wait_ended(job_id)
    assert job["state"] == "failed"
    assert job["cause"]["title"] == "The render process died"
    detail = job["cause"]["detail"]
    assert "3 times" in detail
    assert "signal SIGSEGV" in detail
    assert "last words" in detail
    assert "/" not in detail
    assert job["cause"]["hint"]
    # Nothing was saved, so nothing is claimed: neither picture nor error.
    assert (job["frame_seq"], job["samples"], job["error"], job["curve"]) == (0, 0, None, [])
    assert httpx.get(f"{server.url}/api/jobs/{job_id}/image.exr").status_code == 404
    assert server.wait_ended(server.submit({"spp": 4})["id"])["state"] == "succeeded"


@pytest.mark.parametrize("kills", [2])
def test_after_kill_9_of_the_server_jobs_continue(own_server: Server, kills: int) -> None:
    own_server.start()
    done = own_server.wait_ended(own_server.submit({"spp": 16})["id"])
    job_id = own_server.submit(LONG)["id"]
    waiting = own_server.submit({"spp": 16}, SMALL | {"seed": 9})["id"]
    samples, seq = 0, 0

    def named() -> str | None:
        """The estimate that the database knows: a file beside it may be one that nobody was told of."""
        with database.read() as connection:
            return connection.execute(select(jobs.c.checkpoint).where(jobs.c.id == job_id)).scalar_one()

    database = Database(f"sqlite:///{own_server.data_dir / 'fredholm.sqlite'}")
    for _ in range(kills):
        old = named()
        wait_for(lambda old=old: named() != old, 60, "a saved estimate")
        worker = own_server.render_pids()[-1]
        own_server.kill()
        wait_for(lambda worker=worker: not is_alive(worker), 60, "the end of the orphaned render process")
        assert not own_server.displays()
        own_server.start()
        job = own_server.job(job_id)
        assert job["state"] in ("queued", "running")
        assert job["samples"] > samples, "it goes on from its saved estimate"
        assert job["frame_seq"] > seq
        samples, seq = job["samples"], job["frame_seq"]
    database.close()
    assert own_server.job(done["id"])["state"] == "succeeded"
    assert own_server.wait_ended(waiting)["state"] == "succeeded"
    own_server.wait(job_id, lambda job: job["samples"] > samples)
    assert own_server.cancel(job_id).json()["state"] == "cancelled"


def test_database_and_memory_that_disagree_agree_again(own_server: Server) -> None:
    """An answer of the database that was lost on its way: a job started that nobody runs, one ended that runs on."""
    own_server.environment |= {"FREDHOLM_HEARTBEAT_SECONDS": "0.3", "FREDHOLM_MAX_RUNNING_JOBS": "1"}
    own_server.start()
    running, waiting = (own_server.submit(LONG)["id"], own_server.submit({"spp": 4}, SMALL | {"seed": 2})["id"])
    own_server.wait(running, lambda job: job["frame_seq"] > 0)
    database = Database(f"sqlite:///{own_server.data_dir / 'fredholm.sqlite'}")
    with database.write() as connection:
        mine = connection.execute(select(jobs.c.lease_owner, jobs.c.lease_until).where(jobs.c.id == running)).one()
        started = {"state": "running", "attempt": 1, "lease_owner": mine.lease_owner, "lease_until": mine.lease_until}
        connection.execute(update(jobs).where(jobs.c.id == waiting).values(started))
    own_server.wait(waiting, lambda job: job["state"] == "queued", 20)
    with database.write() as connection:
        connection.execute(update(jobs).where(jobs.c.id == running).values(state="cancelled", lease_owner=None))
    database.close()
    assert own_server.wait_ended(waiting, 30)["state"] == "succeeded"
    assert own_server.job(running)["state"] == "cancelled"
    assert not [line for line in own_server.log() if line["event"] == "turn failed, going on"]


def test_questions_of_many_pages_cost_no_job_its_picture(own_server: Server) -> None:
    own_server.start()
    job_id = own_server.submit(LONG)["id"]
    own_server.wait(job_id, lambda job: job["seconds"] > 0.5)
    asked = "/api/learn/cornell-box/samples?x=174&y=445&count=65536&first="

    async def flood() -> tuple[list[int], httpx.Response]:
        async with httpx.AsyncClient(base_url=own_server.url, timeout=120) as client:
            questions = [asyncio.create_task(client.get(f"{asked}{i}")) for i in range(50)]
            await asyncio.sleep(0.5)
            left = await client.post(f"/api/jobs/{job_id}/cancel")
            return [(await question).status_code for question in questions], left

    statuses, left = asyncio.run(flood())
    assert left.json()["state"] == "cancelled"
    assert set(statuses) <= {200, 429}
    assert 429 in statuses, "there is an end to how many may wait"
    said = [line["event"] for line in own_server.log()]
    # In vain without fair turns: its time was over before all who asked earlier were answered.
    assert "job keeps its last saved picture only" not in said
    assert said.count("render process started") == 1
    turns = [line for line in own_server.log() if line.get("path", "").endswith("/cancel")]
    assert turns[0]["ms"] < 8000


def test_the_queue_has_places_and_an_end(own_server: Server) -> None:
    own_server.environment |= {"FREDHOLM_MAX_RUNNING_JOBS": "1", "FREDHOLM_MAX_WAITING_JOBS": "2"}
    own_server.start()
    running = own_server.submit(LONG)["id"]
    own_server.wait(running, lambda job: job["state"] == "running")
    first, second = (own_server.submit({"spp": 4}) for _ in range(2))
    assert [first["queue_position"], second["queue_position"]] == [1, 2]
    body = {"scene": {"gallery": "cornell-box"}, "target": {"spp": 4}}
    refused = httpx.post(f"{own_server.url}/api/jobs", json=body)
    assert refused.status_code == 429
    assert "2 jobs wait already" in refused.json()["detail"]
    cancelled = own_server.cancel(first["id"]).json()
    assert (cancelled["state"], cancelled["queue_position"]) == ("cancelled", None)
    assert own_server.job(second["id"])["queue_position"] == 1
    own_server.cancel(running)
    assert own_server.wait_ended(second["id"])["state"] == "succeeded"


def test_a_server_ends_promptly_with_open_streams_and_a_running_job(own_server: Server) -> None:
    own_server.start()
    job_id = own_server.submit(LONG)["id"]
    own_server.wait(job_id, lambda job: job["frame_seq"] > 1)
    worker = own_server.render_pids()[-1]
    with EventStream(own_server.url) as first, EventStream(own_server.url) as second:
        own_server.stop()  # gives up long before the job would end
        assert first.is_over.wait(30)
        assert second.is_over.wait(30)
    assert own_server.process is not None
    assert own_server.process.returncode in (0, -signal.SIGINT, 130)
    wait_for(lambda: not is_alive(worker), 60, "the end of the render process")
    assert "Traceback" not in own_server.log_path.read_text()


def test_a_second_service_is_told_what_is_in_the_way(server: Server) -> None:
    code = (
        "import sys, pathlib; from service.serve import ServeError, run\n"
        "try: run('127.0.0.1', int(sys.argv[1]), pathlib.Path(sys.argv[2]), False)\n"
        "except ServeError as error: print(error)\n"
    )

    def told(port: int, folder: str) -> str:
        command = [sys.executable, "-c", code, str(port), folder]
        environment = os.environ | {"PYTHONPATH": str(ROOT)}
        return subprocess.run(command, capture_output=True, text=True, env=environment, timeout=30).stdout

    assert "is in use" in told(server.port, str(server.data_dir))
    assert "another Fredholm service uses" in told(0, str(server.data_dir))
