"""The store: nothing is lost, nothing is done twice. The same contract on SQLite and on PostgreSQL."""

from __future__ import annotations

import contextlib
import itertools
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from sqlalchemy import delete, select, update

from service.states import IllegalStep, State, Step
from service.store import (
    Database,
    DatabaseError,
    DatabaseReplaced,
    JobNotFound,
    JobRecord,
    JobStore,
    KeyUsedOtherwise,
    NewJob,
    Progress,
    SceneNotFound,
    SceneRecord,
    SceneStillNeeded,
    SceneStore,
    StillRunning,
    Superseded,
)
from service.store.belonging import DatabaseFacts, FolderFacts, bind, mismatch
from service.store.schema import data_folder, events
from service.store.schema import jobs as table

NEW = NewJob("Box", "gallery", "cornell-box", "Box", {"error": None, "seconds": 1.0, "spp": None}, {"width": 4})
LATER = "2999-01-01T00:00:00.000Z"


@pytest.fixture
def database(database_url: str) -> Iterator[Database]:
    opened = Database(database_url)
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

    threads = [threading.Thread(target=guarded, daemon=True) for _ in range(n)]
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


def test_a_long_list_is_read_page_by_page_and_state_by_state(jobs: JobStore) -> None:
    added = [jobs.add(replace(NEW, client_id="ab"[i % 2]))[0].id for i in range(7)]
    started = jobs.claim()
    assert started is not None
    pages, before = [], None
    while page := [job.id for job in jobs.newest(3, before=before)]:
        pages.append(page)
        before = page[-1]
    assert [len(page) for page in pages] == [3, 3, 1]
    assert [one for page in pages for one in page] == added[::-1]
    assert [job.id for job in jobs.newest(9, states=[State.RUNNING])] == [started.id] == added[:1]
    assert [job.id for job in jobs.newest(9, states=[State.RUNNING, State.QUEUED])] == added[::-1]
    assert [job.id for job in jobs.newest(9, "a", before=added[4])] == [added[2], added[0]]
    for unknown in ("none", added[1]):  # the second is of another client
        with pytest.raises(JobNotFound):
            jobs.newest(9, "a", before=unknown)


def test_what_has_not_changed_since_the_last_list_is_not_read_again(jobs: JobStore) -> None:
    first, second = jobs.add(NEW)[0], jobs.add(NEW)[0]
    before = jobs.newest(10)
    again = jobs.newest(10)
    assert all(new is old for new, old in zip(again, before, strict=True))
    assert before[0] == replace(jobs.get(second.id), curve=())
    jobs.move(second.id, Step.CANCEL)
    changed = jobs.newest(10)
    assert (changed[0].state, changed[1].state) == (State.CANCELLED, State.QUEUED)
    assert changed[0] == replace(jobs.get(second.id), curve=())
    assert changed[1] is before[1]
    running = jobs.claim()
    assert running is not None
    assert running.id == first.id
    assert jobs.save(running, Progress(spp=4.0, frame_seq=3, health={"status": "good"}), [], "a.exr")
    assert jobs.newest(10)[1] == replace(jobs.get(first.id), curve=())


def test_those_who_wait_are_counted_by_client(jobs: JobStore) -> None:
    for client in ("a", "a", "b", ""):
        jobs.add(replace(NEW, client_id=client))
    jobs.claim(client_id="a")
    assert jobs.waiting() == {"a": 1, "b": 1, "": 1}


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
                query = select(table.c.crashes).where(table.c.id == job.id).with_for_update()
                seen = connection.execute(query).scalar_one()
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
    assert [job.id for job in jobs.give_back(LATER)] == [first.id]
    second, _ = jobs.add(NEW)
    assert queued(jobs) == [second.id, first.id]
    claimed = jobs.claim()
    assert claimed is not None
    assert claimed.id == second.id


def test_what_was_committed_is_there_for_the_next_process(database_url: str) -> None:
    first = Database(database_url)
    first.create_tables()
    job = JobStore(first).add(NEW)[0]
    first.close()
    again = Database(database_url)
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


SCENE = SceneRecord("id", "n", "id/scene.xml", 4, 3, "d", (), "2026-01-01T00:00:00.000Z")
OF_SCENE = replace(NEW, scene_kind="upload", scene_ref="id")


def test_a_scene_stays_while_a_job_needs_it(database: Database, jobs: JobStore) -> None:
    store = SceneStore(database)
    with pytest.raises(SceneNotFound):
        jobs.add(OF_SCENE)
    store.add(SCENE)
    store.grant("id", "alice", "a")
    store.grant("id", "bob", "b")
    job, _ = jobs.add(replace(OF_SCENE, client_id="alice"))
    assert store.unneeded_before(LATER) == []
    for client_id in ("alice", None):
        with pytest.raises(SceneStillNeeded, match="1 job"):
            store.remove("id", client_id)
    assert not store.remove("id", "bob"), "alice has it still"
    with pytest.raises(SceneNotFound):
        store.remove("id", "bob")
    jobs.delete(job.id)
    assert (store.unneeded_before(LATER), store.unneeded_before("2001-01-01T00:00:00.000Z")) == (["id"], [])
    assert store.remove("id", "alice")
    assert (store.get("id"), store.ids()) == (None, set())


def test_no_job_is_queued_of_a_scene_that_is_deleted_at_that_moment(database: Database, jobs: JobStore) -> None:
    store = SceneStore(database)
    told: list[str] = []

    def submit() -> None:
        try:
            told.append(jobs.add(OF_SCENE)[0].id)
        except SceneNotFound:
            told.append("refused")

    def remove() -> None:
        with contextlib.suppress(SceneNotFound, SceneStillNeeded):
            store.remove("id")

    for _ in range(20):
        store.add(SCENE)
        told.clear()
        turns = itertools.cycle((submit, remove))
        in_threads(4, lambda turns=turns: next(turns)())
        queued = [name for name in told if name != "refused"]
        assert len(told) == 2
        assert (store.get("id") is not None) >= bool(queued), "a job without its scene"
        for job_id in queued:
            jobs.delete(job_id)
        if store.get("id"):
            store.remove("id")


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


def test_a_lease_that_is_renewed_is_kept_and_one_that_ends_is_given_back(jobs: JobStore) -> None:
    for _ in range(3):
        jobs.add(NEW)
    mine = jobs.claim("here#1", "2030-01-01T00:00:00.000Z")
    others = [jobs.claim("there#1", "2030-01-01T00:00:00.000Z") for _ in range(2)]
    assert mine is not None
    assert jobs.renew("here#1", "2030-01-02T00:00:00.000Z") == {mine.id: mine.attempt}
    given = jobs.give_back("2030-01-01T12:00:00.000Z")
    assert [job.id for job in given] == [job.id for job in others if job]
    assert all(job.state is State.QUEUED and job.lease_owner is None for job in given)
    assert jobs.get(mine.id).state is State.RUNNING
    assert len(jobs.give_back("2030-01-01T12:00:00.000Z", ended_place="here#")) == 1
    assert jobs.renew("here#1", LATER) == {}


def test_a_server_whose_job_was_given_to_another_changes_nothing(jobs: JobStore) -> None:
    jobs.add(NEW)
    zombie = jobs.claim("a", "2030-01-01T00:00:00.000Z")
    jobs.give_back(LATER)
    current = jobs.claim("b", LATER)
    assert zombie is not None
    assert current is not None
    assert not jobs.save(zombie, Progress(spp=1), [], "old.exr")
    for attempt in (lambda: jobs.count_crash(zombie), lambda: finish(jobs, zombie)):
        with pytest.raises(Superseded):
            attempt()
    assert jobs.get(current.id).state is State.RUNNING
    assert finish(jobs, current).state is State.SUCCEEDED


def queued(jobs: JobStore) -> list[str]:
    return [waiting.job_id for waiting in jobs.queue()]


def finish(jobs: JobStore, job: JobRecord) -> JobRecord:
    return jobs.move(job.id, Step.FINISH, attempt=job.attempt)


def test_higher_priority_goes_first_among_the_queued(jobs: JobStore) -> None:
    low, _ = jobs.add(NEW)
    high, _ = jobs.add(replace(NEW, priority=3))
    assert queued(jobs) == [high.id, low.id]


def test_events_become_visible_in_the_order_of_their_ids(database: Database, jobs: JobStore) -> None:
    seen: list[int] = []
    is_over = threading.Event()

    def follow() -> None:
        while not is_over.is_set() or jobs.last_event_id() > (seen[-1] if seen else 0):
            seen.extend(event.id for event in jobs.events_after(seen[-1] if seen else 0, 10))
            time.sleep(0.001)  # without it, every statement of a writer would wait for this thread

    follower = threading.Thread(target=follow, daemon=True)
    follower.start()

    def add_some() -> None:
        for _ in range(12):
            jobs.add(NEW)

    try:
        in_threads(6, add_some)
    finally:
        is_over.set()
        follower.join(120)
    with database.read() as connection:
        written = list(connection.execute(select(events.c.id).order_by(events.c.id)).scalars())
    assert len(written) == 72
    assert seen == written


def test_old_events_are_forgotten_but_never_the_newest(jobs: JobStore) -> None:
    for _ in range(3):
        jobs.add(NEW)
    assert jobs.forget_events("2000-01-01T00:00:00.000Z") == 0
    assert jobs.forget_events(LATER) == 2
    assert jobs.first_event_id() == jobs.last_event_id() > 0


def facts(database: Database, folder: Path, noted: str | None, is_used: bool) -> tuple[FolderFacts, DatabaseFacts]:
    return FolderFacts(folder, "a", noted, is_used), database.facts() or DatabaseFacts()


def test_a_database_belongs_to_one_data_folder_and_a_folder_to_one_database(database: Database, tmp_path: Path) -> None:
    # An empty one takes a folder that holds nothing, and none that holds something.
    assert mismatch(*facts(database, tmp_path, None, False)) is None
    assert "another database" in (mismatch(*facts(database, tmp_path, None, True)) or "")
    assert "another database" in (mismatch(*facts(database, tmp_path, "1", False)) or "")
    for identity, wrong in (("a", None), ("b", "another data folder")):
        with database.write() as connection:
            connection.execute(delete(data_folder))
            bind(connection, identity, "1")
        for noted in ("1", None):
            assert wrong in (mismatch(*facts(database, tmp_path, noted, True)) or "") if wrong else True
            assert (mismatch(*facts(database, tmp_path, noted, True)) is None) == (wrong is None)
        assert mismatch(*facts(database, tmp_path, "2", True)) is not None
    with database.write() as connection:
        connection.execute(update(data_folder).values(identity="a", database_id=None))
    assert mismatch(*facts(database, tmp_path, "1", True)) is None, "a copy from before databases had names"


def test_a_database_that_becomes_another_one_takes_nothing_more(database: Database, jobs: JobStore) -> None:
    with database.write() as connection:
        bind(connection, "a", "1")
    database.pin("1")
    jobs.add(NEW)
    other = Database(database.engine.url.render_as_string(hide_password=False))
    with other.write() as connection:
        connection.execute(update(data_folder).values(database_id="2"))
    other.close()
    with pytest.raises(DatabaseReplaced):
        jobs.add(NEW)
    with pytest.raises(DatabaseReplaced):
        jobs.newest(1)


@pytest.mark.parametrize(
    ("url", "told"), [("mysql://x/y", "not supported"), ("nonsense", "not understood"), ("what://x", "not supported")]
)
def test_a_database_that_cannot_be_used_is_told(url: str, told: str) -> None:
    with pytest.raises(DatabaseError, match=told):
        Database(url)


def test_each_job_is_claimed_once_by_four_processes(database_url: str) -> None:
    database = Database(database_url)
    database.create_tables()
    store = JobStore(database)
    added = [store.add(NEW)[0].id for _ in range(60)]
    database.close()
    code = (
        "import sys; from service.store import Database, JobStore\n"
        "jobs = JobStore(Database(sys.argv[1]))\n"
        "print('ready', flush=True); sys.stdin.readline()\n"
        "while job := jobs.claim(sys.argv[2], '2999'): print(job.id, flush=True)\n"
    )
    command = [sys.executable, "-c", code, database_url]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    claimers = [subprocess.Popen([*command, str(n)], **pipes) for n in range(4)]
    for claimer in claimers:
        assert claimer.stdout is not None
        assert claimer.stdout.readline() == "ready\n"
    told = [claimer.communicate("go\n", timeout=60)[0].split() for claimer in claimers]
    assert sorted(job_id for ids in told for job_id in ids) == sorted(added)
    assert all(claimer.returncode == 0 for claimer in claimers)
