"""Rows that this version cannot read: each hides itself and is named, and all others go on."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import replace

import httpx
import pytest
from service_process import Server
from sqlalchemy import text, update

from service.shown import MOST_CHARACTERS, shown
from service.states import State, Step
from service.store import (
    Database,
    JobStore,
    NewJob,
    QueueFull,
    QueueLimits,
    RowUnreadable,
    SceneNotFound,
    SceneRecord,
    SceneStore,
)
from service.store.schema import jobs as table

NEW = NewJob("Box", "gallery", "cornell-box", "Box", {"spp": 1}, {"width": 4})
BAD = ("state", "progress", "warnings", "earlier")


@pytest.fixture
def database(database_url: str) -> Iterator[Database]:
    opened = Database(database_url)
    opened.create_tables()
    yield opened
    opened.close()


def spoil(database: Database, job_id: str, what: str) -> None:
    """As a newer version, or a damaged disk, leaves a row."""
    values = {
        "state": {"state": "frozen"},
        "progress": {"progress": {"spp": 4.0, "colour_error": 0.1}},
        "warnings": {"warnings": 7},
        "earlier": {"earlier": {"file": "a.exr"}},
    }
    with database.write() as connection:
        connection.execute(update(table).where(table.c.id == job_id).values(values[what]))


@pytest.mark.parametrize("what", BAD)
def test_a_row_that_cannot_be_read_hides_itself_and_is_named(database: Database, what: str) -> None:
    jobs = JobStore(database)
    ids = [jobs.add(NEW)[0].id for _ in range(4)]
    spoil(database, ids[1], what)
    assert [job.id for job in jobs.newest(2)] == [ids[3], ids[2]]
    assert [job.id for job in jobs.newest(10)] == [ids[3], ids[2], ids[0]]
    assert [job.id for job in jobs.newest(2, before=ids[2])] == [ids[0]]
    assert list(jobs.unreadable()) == [ids[1]]
    for touch in (lambda: jobs.get(ids[1]), lambda: jobs.move(ids[1], Step.PAUSE)):
        with pytest.raises(RowUnreadable, match=ids[1]):
            touch()
    claimed = [job.id for job in iter(lambda: jobs.claim("me#1", "2000"), None)]
    assert claimed == [ids[0], ids[2], ids[3]]
    spoil(database, ids[2], "progress")
    given = jobs.give_back("2999")
    assert [job.id for job in given] == [ids[0], ids[3]]
    assert [waiting.job_id for waiting in jobs.queue()] == [ids[0], ids[3]]
    assert all(event.is_readable for event in jobs.events_after(0, 100))
    # Once it can be read again, it is there again.
    mended = {"state": "queued", "progress": {}, "warnings": [], "earlier": None}
    with database.write() as connection:
        connection.execute(update(table).where(table.c.id == ids[1]).values(mended))
    assert len(jobs.newest(10)) == 3
    assert ids[1] not in jobs.unreadable()


def test_text_that_is_no_json_spoils_no_other_row(tmp_path: object) -> None:
    database = Database(f"sqlite:///{tmp_path}/a.sqlite")
    database.create_tables()
    jobs = JobStore(database)
    ids = [jobs.add(NEW)[0].id for _ in range(3)]
    with database.write() as connection:
        connection.execute(text("UPDATE jobs SET progress = '{', earlier = '{' WHERE id = :id"), {"id": ids[1]})
        connection.execute(text("UPDATE events SET job = '{' WHERE job_id = :id"), {"id": ids[1]})
    assert [job.id for job in jobs.newest(10)] == [ids[2], ids[0]]
    assert jobs.checkpoints() == {ids[0]: set(), ids[1]: None, ids[2]: set()}
    assert [event.is_readable for event in jobs.events_after(0, 10)] == [True, False, True]
    database.close()


def test_a_service_with_bad_rows_starts_and_names_them(own_server: Server) -> None:
    own_server.start()
    good, bad, odd = (own_server.submit({"spp": 4}, {"width": 8, "height": 8})["id"] for _ in range(3))
    for job_id in (good, bad, odd):
        own_server.wait_ended(job_id)
    own_server.stop()
    database = Database(f"sqlite:///{own_server.data_dir / 'fredholm.sqlite'}")
    spoil(database, bad, "state")
    with database.write() as connection:
        connection.execute(update(table).where(table.c.id == odd).values(target={"until": "noon"}))
    database.close()
    own_server.start()
    found = httpx.get(f"{own_server.url}/api/jobs").json()
    found = httpx.get(f"{own_server.url}/api/jobs").json()
    assert [job["id"] for job in found["jobs"]] == [good]
    told = {row["id"]: row["reason"] for row in found["unreadable"]}
    assert set(told) == {bad, odd}
    assert "frozen" in told[bad]
    assert "target" in told[odd]
    for job_id in (bad, odd):
        assert httpx.get(f"{own_server.url}/api/jobs/{job_id}").status_code == 409
    assert "fredholm_unreadable_rows 2.0" in httpx.get(f"{own_server.url}/metrics").text
    named = [line for line in own_server.log() if line["event"] == "a row cannot be read"]
    assert {line["job"] for line in named} == {bad, odd}
    assert (own_server.data_dir / "estimates" / bad).is_dir(), "its files are left alone"
    assert "Traceback" not in own_server.log_path.read_text()


def test_no_more_jobs_wait_than_may_however_many_ask_at_once(database: Database) -> None:
    jobs, limits = JobStore(database), QueueLimits(of_all=10, of_one=6)
    refused: list[str] = []

    def submit(n: int) -> None:
        try:
            jobs.add(replace(NEW, client_id="ab"[n % 2]), limits)
        except QueueFull as full:
            refused.append(str(full))

    threads = [threading.Thread(target=submit, args=(n,)) for n in range(32)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    waiting = jobs.waiting()
    assert sum(waiting.values()) == 10
    assert max(waiting.values()) <= 6
    assert len(refused) == 22
    paused = jobs.newest(1)[0]
    jobs.move(paused.id, Step.PAUSE)
    jobs.add(replace(NEW, client_id="c"), limits)
    with pytest.raises(QueueFull):
        jobs.move(paused.id, Step.RESUME, limits=limits)
    assert jobs.get(paused.id).state is State.PAUSED


def test_scenes_are_listed_page_by_page(database: Database) -> None:
    scenes = SceneStore(database)
    for n in range(7):  # some at the same moment
        scenes.add(SceneRecord(f"s{n}", "n", f"s{n}/a/scene.xml", 4, 3, "d", (), f"2026-01-0{1 + n // 3}"))
        if n % 2:
            scenes.grant(f"s{n}", "alice", "hers")
    pages, before = [], None
    while page := [scene.id for scene in scenes.newest(limit=3, before=before)]:
        pages.append(page)
        before = page[-1]
    assert pages == [["s6", "s5", "s4"], ["s3", "s2", "s1"], ["s0"]]
    assert [scene.id for scene in scenes.newest("alice", before="s5")] == ["s3", "s1"]
    with pytest.raises(SceneNotFound):
        scenes.newest("alice", before="s2")


def test_long_names_of_a_scene_are_short_in_lists() -> None:
    long = "x" * 100_000
    told = shown({"warnings": [f"{long}: flat"] * 500, "shapes": {long: 2}, "low": [0.5, 1], "nothing": None})
    assert len(str(told)) < 100 * (MOST_CHARACTERS + 10)
    assert told["warnings"][-1] == "… and 401 more"
    assert (told["low"], told["nothing"]) == ([0.5, 1], None)
    assert shown(("short",)) == ("short",)
