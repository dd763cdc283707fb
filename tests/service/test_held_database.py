"""A database in which somebody else writes for long: who reads, and what renders, does not wait for that."""

from __future__ import annotations

import asyncio
import contextlib
import sqlite3
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import httpx
import pytest
from service_process import LONG, Server
from sqlalchemy.exc import TimeoutError as PoolTimeout

from service.store import threads
from service.store.threads import WRITERS, reading, writing


def test_reads_do_not_wait_for_a_held_write_lock_and_writes_are_told_to_come_again(own_server: Server) -> None:
    server = own_server.start()
    job_id = server.submit(LONG)["id"]
    server.wait(job_id, lambda job: job["frame_seq"] > 1)
    body = {"scene": {"gallery": "cornell-box"}, "target": {"spp": 4}}

    def submit(_: int) -> httpx.Response:
        return httpx.post(f"{server.url}/api/jobs", json=body, timeout=25)

    with contextlib.closing(sqlite3.connect(server.data_dir / "fredholm.sqlite", isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")  # until the end of this block
        with ThreadPoolExecutor(8) as pool:
            submits = [pool.submit(submit, i) for i in range(8)]
            for path in ("/api/jobs", f"/api/jobs/{job_id}", f"/api/jobs/{job_id}/frames/latest", "/healthz"):
                assert httpx.get(server.url + path, timeout=25).status_code == 200, path
            assert [answer.result().status_code for answer in submits] == [503] * 8
            assert all(answer.result().headers["Retry-After"] for answer in submits)
        before = server.job(job_id)["seconds"]
        server.wait(job_id, lambda job: job["seconds"] > before + 0.5)
        other.execute("ROLLBACK")
    server.wait(job_id, lambda job: job["state"] == "running")
    assert len(httpx.get(f"{server.url}/api/jobs").json()["jobs"]) == 1, "none that was refused is there"
    again = server.submit({"spp": 4})["id"]
    assert server.wait_ended(again)["state"] == "succeeded"
    server.cancel(job_id)


def test_who_reads_needs_no_thread_of_those_who_write() -> None:
    release = threading.Event()

    async def read() -> int:
        held = [asyncio.create_task(writing(release.wait, 30)) for _ in range(2 * WRITERS)]
        await asyncio.sleep(0)
        try:
            return await reading(lambda: 7)
        finally:
            release.set()
            await asyncio.gather(*held, return_exceptions=True)

    assert asyncio.run(read()) == 7


@pytest.mark.parametrize("call", [reading, writing])
def test_nobody_is_kept_waiting_by_a_database(call: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threads, "WAIT_SECONDS", 0.05)
    release = threading.Event()

    async def told() -> None:
        try:
            with pytest.raises(PoolTimeout):
                await asyncio.wait_for(call(release.wait, 30), 10)
        finally:
            release.set()

    asyncio.run(told())
