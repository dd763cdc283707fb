"""The store: nothing is lost, nothing is done twice."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from sqlalchemy import select, update

from service.states import IllegalStep, State, Step
from service.store import (
    Database,
    JobNotFound,
    JobStore,
    KeyUsedOtherwise,
    NewJob,
    Progress,
    SceneRecord,
    SceneStore,
    StillRunning,
)
from service.store.schema import jobs as table

NEW = NewJob("Box", "gallery", "cornell-box", "Box", {"error": None, "seconds": 1.0, "spp": None}, {"width": 4})


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    opened = Database(f"sqlite:///{tmp_path / 'test.sqlite'}")
    opened.create_tables()
    yield opened
    opened.close()


@pytest.fixture
def jobs(database: Database) -> JobStore:
    return JobStore(database)


def in_threads(n: int, work: Callable[[], None]) -> None:
    failures: list[BaseException] = []

    def guarded() -> None:
        try:
            work()
        except BaseException as error:
            failures.append(error)

    threads = [threading.Thread(target=guarded) for _ in range(n)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not failures, failures


def test_a_job_reads_back_as_it_was_added(jobs: JobStore) -> None:
    added, _ = jobs.add(NEW)
    found = jobs.get(added.id)
    assert found == added
    assert (found.state, found.name, found.settings) == (State.QUEUED, "Box", {"width": 4})


def test_an_unknown_job_is_told(jobs: JobStore) -> None:
    with pytest.raises(JobNotFound, match="no job 'nope'"):
        jobs.get("nope")
    with pytest.raises(JobNotFound):
        jobs.move("nope", Step.CANCEL)


def test_every_transition_is_an_event_with_the_job_as_it_was(jobs: JobStore) -> None:
    job, _ = jobs.add(NEW)
    jobs.claim()
    jobs.move(job.id, Step.FINISH, stopped_by="spp", progress=Progress(spp=8, frame_seq=3))
    events = jobs.events_after(0, 10)
    assert [event.job and event.job.state for event in events] == [State.QUEUED, State.RUNNING, State.SUCCEEDED]
    assert [event.queue_position for event in events] == [1, None, None]
    assert events[-1].job is not None
    assert events[-1].job.progress.spp == 8
    assert jobs.last_event_id() == events[-1].id
    assert jobs.events_after(events[1].id, 10) == events[2:]


def test_an_illegal_step_changes_nothing_and_writes_no_event(jobs: JobStore) -> None:
    job, _ = jobs.add(NEW)
    before = jobs.last_event_id()
    with pytest.raises(IllegalStep, match="a job that is queued cannot be finished"):
        jobs.move(job.id, Step.FINISH)
    assert jobs.get(job.id).state is State.QUEUED
    assert jobs.last_event_id() == before


def test_two_hundred_jobs_are_claimed_once_each_by_eight_threads(jobs: JobStore) -> None:
    added = [jobs.add(NEW)[0].id for _ in range(200)]
    claimed: list[str] = []

    def claim_all() -> None:
        while job := jobs.claim():
            claimed.append(job.id)

    in_threads(8, claim_all)
    assert sorted(claimed) == sorted(added)


def test_concurrent_updates_lose_nothing(database: Database, jobs: JobStore) -> None:
    job, _ = jobs.add(NEW)

    def read_then_write() -> None:
        for _ in range(40):
            with database.write() as connection:
                seen = connection.execute(select(table.c.crashes).where(table.c.id == job.id)).scalar_one()
                connection.execute(update(table).where(table.c.id == job.id).values(crashes=seen + 1))

    in_threads(6, read_then_write)
    assert jobs.get(job.id).crashes == 240


def test_results_of_an_older_attempt_change_nothing(jobs: JobStore) -> None:
    jobs.add(NEW)
    zombie = jobs.claim()
    assert zombie is not None
    current = jobs.count_crash(zombie)
    assert not jobs.save(zombie, Progress(spp=1), [], "old.exr")
    assert jobs.save(current, Progress(spp=2), [], "new.exr")
    assert jobs.get(current.id).checkpoint == "new.exr"


def test_a_job_given_back_waits_behind_those_without_a_picture(jobs: JobStore) -> None:
    jobs.add(NEW)
    first = jobs.claim()
    assert first is not None
    jobs.save(first, Progress(frame_seq=5), [], "a.exr")
    jobs.move(first.id, Step.GIVE_BACK)
    second, _ = jobs.add(NEW)
    assert jobs.queue() == [second.id, first.id]
    claimed = jobs.claim()
    assert claimed is not None
    assert claimed.id == second.id


def test_what_was_committed_is_there_for_the_next_process(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'test.sqlite'}"
    first = Database(url)
    first.create_tables()
    job = JobStore(first).add(NEW)[0]
    first.close()
    again = Database(url)
    again.create_tables()
    assert JobStore(again).get(job.id) == job
    again.close()


def test_readers_do_not_wait_for_a_writer(database: Database, jobs: JobStore) -> None:
    job, _ = jobs.add(NEW)
    with database.write():
        assert jobs.get(job.id) == job


def test_scenes_read_back(database: Database) -> None:
    store = SceneStore(database)
    scene = SceneRecord("id", "n", "id/scene.xml", 4, 3, "d", ("odd",), "2026-01-01T00:00:00.000Z")
    store.add(scene)
    assert store.get("id") == scene
    assert store.newest() == [scene]
    assert store.get("other") is None


def test_a_deleted_job_leaves_one_event_and_nothing_else(jobs: JobStore) -> None:
    job, _ = jobs.add(NEW)
    running, _ = jobs.add(NEW)
    jobs.delete(job.id)
    with pytest.raises(JobNotFound):
        jobs.get(job.id)
    told = [(event.job_id, event.job is None) for event in jobs.events_after(0, 10)]
    assert told == [(running.id, False), (job.id, True)]
    jobs.claim()
    with pytest.raises(StillRunning):
        jobs.delete(running.id)
    with pytest.raises(JobNotFound):
        jobs.delete(job.id)


def test_one_key_is_one_job_however_many_ask_at_once(jobs: JobStore) -> None:
    new = replace(NEW, idempotency_key="k", request_digest="d")
    seen: list[tuple[str, bool]] = []

    def submit() -> None:
        job, is_new = jobs.add(new)
        seen.append((job.id, is_new))

    in_threads(8, submit)
    assert len({job_id for job_id, _ in seen}) == 1
    assert [is_new for _, is_new in seen].count(True) == 1
    with pytest.raises(KeyUsedOtherwise):
        jobs.add(replace(new, request_digest="other"))
    other, is_new = jobs.add(replace(new, client_id="someone else"))
    assert is_new
    assert other.id != seen[0][0]
