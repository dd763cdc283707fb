"""A PostgreSQL that stands still: nobody hangs with it, what runs goes on, and all goes on by itself once it does."""

from __future__ import annotations

import contextlib
import json
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import httpx
import pytest
from postgres import MISSING, Postgres, is_installed
from service_process import LONG, SMALL, Server, wait_for
from sqlalchemy.exc import OperationalError
from sqlalchemy.exc import TimeoutError as PoolTimeout

from service.store import Database, JobStore
from service.store.threads import check_wanted, writing

ANSWER_SECONDS = 20  # a hung service answers nothing at all; how fast this one does is measured elsewhere
STREAMS = 12


@pytest.fixture
def own_postgres() -> Iterator[Postgres]:
    """One that nobody else needs meanwhile."""
    if not is_installed():
        pytest.skip(MISSING)
    running = Postgres().start()
    yield running
    running.stop()


@contextlib.contextmanager
def open_streams(server: Server, count: int) -> Iterator[list[Iterator[str]]]:
    with contextlib.ExitStack() as stack:
        client = stack.enter_context(
            httpx.Client(base_url=server.url, timeout=60, limits=httpx.Limits(max_connections=99))
        )
        answers = [stack.enter_context(client.stream("GET", "/api/events")) for _ in range(count)]
        yield [answer.iter_lines() for answer in answers]


def asks(server: Server, job_id: str) -> dict[str, Callable[[], httpx.Response]]:
    def get(path: str) -> Callable[[], httpx.Response]:
        return lambda: httpx.get(server.url + path, timeout=ANSWER_SECONDS)

    body = {"scene": {"gallery": "cornell-box"}, "target": {"spp": 4}, "settings": SMALL}
    paths = ["/healthz", "/readyz", "/metrics", "/api/jobs", "/api/scenes", "/api/scenes/none", "/api/jobs/none"]
    paths += [f"/api/jobs/{job_id}", f"/api/jobs/{job_id}/frames/latest", f"/api/jobs/{job_id}/pixel?x=1&y=1", "/"]
    return {path: get(path) for path in paths} | {
        "events": lambda: httpx.get(f"{server.url}/api/events", timeout=ANSWER_SECONDS),
        "submit": lambda: httpx.post(f"{server.url}/api/jobs", json=body, timeout=ANSWER_SECONDS),
        "delete": lambda: httpx.delete(f"{server.url}/api/jobs/none", timeout=ANSWER_SECONDS),
        "cancel": lambda: httpx.post(f"{server.url}/api/jobs/none/cancel", timeout=ANSWER_SECONDS),
    }


def test_nobody_hangs_with_a_database_that_stands_still(own_server: Server, own_postgres: Postgres) -> None:
    own_server.environment |= {"FREDHOLM_DATABASE_URL": own_postgres.new_database(), "FREDHOLM_HEARTBEAT_SECONDS": "1"}
    server = own_server.start()
    job_id = server.submit(LONG)["id"]
    server.wait(job_id, lambda job: job["frame_seq"] > 1)
    needs_none = {"/healthz", "/metrics", f"/api/jobs/{job_id}", f"/api/jobs/{job_id}/frames/latest", "/"}
    needs_none.add(f"/api/jobs/{job_id}/pixel?x=1&y=1")
    with open_streams(server, STREAMS) as streams, ThreadPoolExecutor(60) as pool:
        with own_postgres.frozen():
            # More than there are threads for, and again while those before still wait.
            for _ in range(2):
                told = [(name, pool.submit(ask)) for name, ask in asks(server, job_id).items() for _ in range(3)]
                found = {(name, answer.result().status_code) for name, answer in told}
                assert found == {(name, 200 if name in needs_none else 503) for name in asks(server, job_id)}
            readiness = httpx.get(f"{server.url}/readyz", timeout=ANSWER_SECONDS)
            assert "the database does not answer" in readiness.json()["not_ready"]
            before = server.job(job_id)["frame_seq"]
            server.wait(job_id, lambda job: job["frame_seq"] > before + 2)
            for lines in streams:  # they tell of progress meanwhile
                assert any(_seq(line) > before for line in lines)
        wait_for(lambda: httpx.get(f"{server.url}/readyz", timeout=ANSWER_SECONDS).status_code == 200, 60, "readiness")
        ended = server.wait_ended(server.submit({"spp": 4})["id"])
        assert ended["state"] == "succeeded"
        for lines in streams:
            assert any(_tells_end_of(line, ended["id"]) for line in lines)
    listed = httpx.get(f"{server.url}/api/jobs").json()["jobs"]
    assert {job["id"] for job in listed} == {job_id, ended["id"]}, "none that was refused is there"
    assert server.job(job_id)["state"] == "running"
    log = server.log_path.read_text()
    assert "Traceback" not in log
    server.cancel(job_id)


def _seq(line: str) -> int:
    return _data(line).get("frame_seq", 0)


def _tells_end_of(line: str, job_id: str) -> bool:
    told = _data(line)
    return told.get("id") == job_id and told.get("state") == "succeeded"


def _data(line: str) -> dict[str, Any]:
    return json.loads(line.removeprefix("data: ")) if line.startswith("data: ") else {}


def test_the_service_ends_while_its_database_stands_still(own_server: Server, own_postgres: Postgres) -> None:
    own_server.environment |= {"FREDHOLM_DATABASE_URL": own_postgres.new_database()}
    server = own_server.start()
    with own_postgres.frozen():
        with ThreadPoolExecutor(12) as pool:
            told = [pool.submit(httpx.get, f"{server.url}/api/jobs", timeout=ANSWER_SECONDS) for _ in range(12)]
            assert {answer.result().status_code for answer in told} == {503}
        server.stop()  # fails where the process does not end
        assert server.process is not None
        assert server.process.poll() is not None


def test_a_statement_that_takes_too_long_is_ended(postgres: Postgres, monkeypatch: pytest.MonkeyPatch) -> None:
    for limit in ("_READ_SECONDS", "_LOCK_SECONDS"):
        monkeypatch.setattr(f"service.store.lines.{limit}", 1)
    database = Database(postgres.new_database())
    database.create_tables()
    with pytest.raises(OperationalError, match="statement timeout"), database.read() as connection:
        connection.exec_driver_sql("SELECT pg_sleep(20)")
    with database.write() as holding:
        holding.exec_driver_sql("LOCK TABLE jobs")
        # Should that limit be missing, the other one ends it.
        with pytest.raises(OperationalError, match="lock timeout"), database.write() as connection:
            connection.exec_driver_sql("SET LOCAL statement_timeout = 10000; LOCK TABLE jobs")
    database.close()


def test_what_nobody_waits_for_any_more_is_not_written(database_url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A submission that was answered with 503 must not be rendered after all."""
    import asyncio

    from test_store import NEW

    database = Database(database_url)
    database.create_tables()
    jobs = JobStore(database)
    monkeypatch.setattr("service.store.threads.WAIT_SECONDS", 0.05)

    has_ended = threading.Event()

    def slowly() -> None:
        try:
            with database.write() as connection:
                jobs._insert_one(connection, NEW, None)
                time.sleep(0.2)
        finally:
            has_ended.set()

    def queue() -> None:
        record, _ = jobs.add(NEW)
        assert record.id

    async def refused() -> None:
        with pytest.raises(PoolTimeout):
            await writing(slowly)
        assert await asyncio.to_thread(has_ended.wait, 20)
        monkeypatch.setattr("service.store.threads.WAIT_SECONDS", 5.0)
        await writing(queue)

    asyncio.run(refused())
    assert len(jobs.newest(10)) == 1
    check_wanted()  # out of a request there is no deadline
    database.close()
