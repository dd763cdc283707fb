"""The verbs of jobs, one statement each. Every change of state writes its event in the same transaction."""

from __future__ import annotations

import json
import secrets
from collections.abc import Collection, Sequence
from dataclasses import asdict, replace
from typing import Any

from sqlalchemy import JSON, Connection, Text, bindparam, cast, delete, func, insert, select, true, update
from sqlalchemy.exc import IntegrityError

from service.dispatch import Waiting, start_order
from service.states import DELETABLE, ENDED, IllegalStep, State, Step, destination, sources
from service.store.database import Database, keep_event_order
from service.store.records import (
    EventRecord,
    JobRecord,
    NewJob,
    Progress,
    event_from,
    job_as_json,
    job_from,
    now,
)
from service.store.scenes import SceneNotFound
from service.store.schema import events, jobs, scenes

_WITHOUT_CURVE = [column for column in jobs.columns if column.name not in ("curve", "idempotency_key", "lease_until")]
# Their JSON as text: it is read only where it has changed.
_AS_STORED = [cast(one, Text).label(one.name) if isinstance(one.type, JSON) else one for one in _WITHOUT_CURVE]
_NAMES = [column.name for column in _WITHOUT_CURVE]
_JSON_NAMES = [column.name for column in _WITHOUT_CURVE if isinstance(column.type, JSON)]
_NUMBER = _NAMES.index("number")
_KEPT_ROWS = 2000
_QUEUED = select(jobs.c.id, jobs.c.number, jobs.c.frame_seq > 0, jobs.c.client_id, jobs.c.priority).where(
    jobs.c.state == State.QUEUED
)
_COUNTS = select(jobs.c.client_id, func.count()).where(jobs.c.state == bindparam("counted")).group_by(jobs.c.client_id)
# A job without any picture goes before one that has waited since a restart.
_QUEUE_ORDER = (jobs.c.frame_seq > 0, jobs.c.priority.desc(), jobs.c.number)


class JobNotFound(Exception):
    """There is no such job."""

    def __init__(self, job_id: str) -> None:
        super().__init__(f"there is no job {job_id!r}")


class StillRunning(Exception):
    """A running job cannot be deleted."""

    def __init__(self) -> None:
        super().__init__("a job that is running cannot be deleted; cancel it first")


class Superseded(Exception):
    """Another server has taken the job up: what this one still has of it counts no more."""


class KeyUsedOtherwise(Exception):
    """An idempotency key came again with another request."""

    def __init__(self) -> None:
        super().__init__("this Idempotency-Key was used for another request; choose a new one for a new job")


class JobStore:
    """Jobs and their events. Synchronous: call it from a thread."""

    def __init__(self, database: Database) -> None:
        self._database = database
        # Rows of lists and what was made of them, by number: most are as they were when they were last asked for.
        self._rows: dict[int, tuple[tuple[Any, ...], JobRecord]] = {}

    def add(self, new: NewJob) -> tuple[JobRecord, bool]:
        """Queue a job; with an idempotency key at most once. The job, and whether it is new.

        Raises KeyUsedOtherwise, and SceneNotFound where the scene was deleted meanwhile.
        """
        try:
            if found := self.submitted(new.client_id, new.idempotency_key, new.request_digest):
                return found, False
            return self._insert(new), True
        except IntegrityError:
            # Another request with the same key came in between.
            if found := self.submitted(new.client_id, new.idempotency_key, new.request_digest):
                return found, False
            raise

    def submitted(self, client_id: str, idempotency_key: str | None, request_digest: str | None) -> JobRecord | None:
        """The job that a client has queued with this key, or None. Raises KeyUsedOtherwise."""
        if idempotency_key is None:
            return None
        query = select(jobs).where(jobs.c.client_id == client_id, jobs.c.idempotency_key == idempotency_key)
        with self._database.read() as connection:
            row = connection.execute(query).mappings().first()
        if row is not None and row["request_digest"] != request_digest:
            raise KeyUsedOtherwise
        return job_from(row) if row is not None else None

    def _insert(self, new: NewJob) -> JobRecord:
        row = {**asdict(new), "id": secrets.token_hex(6), "state": State.QUEUED, "created_at": now()}
        row |= {"progress": asdict(Progress()), "curve": [], "warnings": list(new.warnings)}
        with self._database.write() as connection:
            if new.scene_kind == "upload":
                held = (
                    select(scenes.c.id).where(scenes.c.id == new.scene_ref).with_for_update(read=True, key_share=True)
                )
                if connection.execute(held).first() is None:
                    raise SceneNotFound(new.scene_ref)
            added = connection.execute(insert(jobs).values(row).returning(jobs)).mappings().one()
            return _record(connection, job_from(added))

    def get(self, job_id: str) -> JobRecord:
        """One job with its curve. Raises JobNotFound."""
        with self._database.read() as connection:
            return _one(connection, job_id)

    def newest(
        self,
        limit: int,
        client_id: str | None = None,
        *,
        states: Collection[State] = (),
        before: str | None = None,
    ) -> list[JobRecord]:
        """The newest jobs, of one client or of all, newest first, without curves.

        states: only jobs in one of these; any if empty. before: only jobs older than this one. A job that has not
        changed is the same value as the last time. Raises JobNotFound.
        """
        is_own = true() if client_id is None else jobs.c.client_id == client_id
        query = select(*_AS_STORED).where(is_own).order_by(jobs.c.number.desc()).limit(limit)
        if states:
            query = query.where(jobs.c.state.in_(states))
        with self._database.read() as connection:
            if before is not None:
                number = connection.execute(select(jobs.c.number).where(is_own, jobs.c.id == before)).scalar()
                if number is None:
                    raise JobNotFound(before)
                query = query.where(jobs.c.number < number)
            return [self._listed(tuple(row)) for row in connection.execute(query)]

    def _listed(self, row: tuple[Any, ...]) -> JobRecord:
        number = row[_NUMBER]
        if (kept := self._rows.get(number)) is not None and kept[0] == row:
            return kept[1]
        fields = dict(zip(_NAMES, row, strict=True))
        job = job_from(fields | {name: json.loads(fields[name] or "null") for name in _JSON_NAMES})
        if len(self._rows) >= _KEPT_ROWS:
            self._rows.clear()
        self._rows[number] = row, job
        return job

    def queue(self) -> list[Waiting]:
        """The queued jobs, next first."""
        with self._database.read() as connection:
            return _queue(connection)

    def waiting(self) -> dict[str, int]:
        """How many jobs of each client are queued."""
        with self._database.read() as connection:
            return _counts_by_client(connection, State.QUEUED)

    def claim(self, owner: str = "", lease_until: str = "", client_id: str | None = None) -> JobRecord | None:
        """Start the next queued job of a client or of all, in one statement: no two callers get the same one.

        owner, lease_until: who runs it, and until when it may be silent.
        """
        waiting = select(jobs.c.id).where(jobs.c.state == State.QUEUED).order_by(*_QUEUE_ORDER).limit(1)
        if client_id is not None:
            waiting = waiting.where(jobs.c.client_id == client_id)
        claim = (
            update(jobs)
            .where(jobs.c.id == waiting.with_for_update(skip_locked=True).scalar_subquery())
            .values(
                state=destination(Step.START),
                attempt=jobs.c.attempt + 1,
                started_at=func.coalesce(jobs.c.started_at, now()),
                lease_owner=owner,
                lease_until=lease_until,
            )
            .returning(jobs)
        )
        with self._database.write() as connection:
            row = connection.execute(claim).mappings().first()
            return _record(connection, job_from(row)) if row else None

    def renew(self, owner: str, lease_until: str) -> dict[str, int]:
        """Keep the leases of all jobs that an owner runs; their attempts by id."""
        statement = (
            update(jobs)
            .where(jobs.c.state == State.RUNNING, jobs.c.lease_owner == owner)
            .values(lease_until=lease_until)
            .returning(jobs.c.id, jobs.c.attempt)
        )
        with self._database.write() as connection:
            return {row.id: row.attempt for row in connection.execute(statement)}

    def give_back(self, at: str, ended_place: str | None = None) -> list[JobRecord]:
        """Queue the running jobs whose lease ended before `at`.

        ended_place: owners whose name starts with this are known to have ended, whatever their leases say.
        """
        is_over = jobs.c.lease_until < at
        is_over |= jobs.c.lease_owner.is_(None)
        if ended_place is not None:
            is_over |= jobs.c.lease_owner.startswith(ended_place, autoescape=True)
        statement = (
            update(jobs)
            .where(jobs.c.state.in_(sources(Step.GIVE_BACK)), is_over)
            .values(state=destination(Step.GIVE_BACK), lease_owner=None, lease_until=None)
            .returning(jobs)
        )
        with self._database.write() as connection:
            given = [job_from(row) for row in connection.execute(statement).mappings()]
            return [_record(connection, job) for job in sorted(given, key=lambda job: job.number)]

    def save(
        self, job: JobRecord, progress: Progress, curve: Sequence[dict[str, float]], checkpoint: str | None
    ) -> bool:
        """Record progress together with the estimate that holds it.

        False if the job has moved on meanwhile.
        """
        statement = (
            update(jobs)
            .where(jobs.c.id == job.id, jobs.c.attempt == job.attempt, jobs.c.state == State.RUNNING)
            .values(
                progress=asdict(progress),
                frame_seq=progress.frame_seq,
                curve=list(curve),
                checkpoint=checkpoint,
                crashes=0,  # it got further than where it crashed
                warnings=list(job.warnings),
            )
        )
        with self._database.write() as connection:
            return connection.execute(statement).rowcount == 1

    def count_crash(self, job: JobRecord) -> JobRecord:
        """Note that the render process died under this job; its next attempt begins. Raises Superseded."""
        statement = (
            update(jobs)
            .where(jobs.c.id == job.id, jobs.c.attempt == job.attempt, jobs.c.state == State.RUNNING)
            .values(crashes=jobs.c.crashes + 1, attempt=jobs.c.attempt + 1)
            .returning(jobs)
        )
        with self._database.write() as connection:
            row = connection.execute(statement).mappings().first()
            if row is None:
                raise Superseded(job.id)
            return job_from(row)

    def delete(self, job_id: str) -> None:
        """Forget a job; that it is gone is the last event of it. Raises JobNotFound, StillRunning."""
        statement = delete(jobs).where(jobs.c.id == job_id, jobs.c.state.in_(DELETABLE)).returning(jobs.c.client_id)
        with self._database.write() as connection:
            row = connection.execute(statement).first()
            if row is None:
                _one(connection, job_id)
                raise StillRunning
            connection.execute(delete(events).where(events.c.job_id == job_id))
            keep_event_order(connection)
            connection.execute(insert(events).values(job_id=job_id, client_id=row.client_id, at=now(), job=None))

    def move(
        self,
        job_id: str,
        step: Step,
        *,
        only_from: frozenset[State] = frozenset(State),
        attempt: int | None = None,
        **changes: Any,
    ) -> JobRecord:
        """Take a step, with further columns changed.

        attempt: of the caller; one that is no longer the job's changes nothing. Raises JobNotFound, IllegalStep,
        Superseded.
        """
        to = destination(step)
        if to is not State.RUNNING:
            changes |= {"lease_owner": None, "lease_until": None}
        if to in ENDED:
            changes.setdefault("finished_at", now())
        if isinstance(progress := changes.get("progress"), Progress):
            changes |= {"progress": asdict(progress), "frame_seq": progress.frame_seq}
        statement = (
            update(jobs)
            .where(jobs.c.id == job_id, jobs.c.state.in_(only_from.intersection(sources(step))))
            .values(state=to, **changes)
            .returning(jobs)
        )
        if attempt is not None:
            statement = statement.where(jobs.c.attempt == attempt)
        with self._database.write() as connection:
            row = connection.execute(statement).mappings().first()
            if row is None:
                found = _one(connection, job_id)
                if attempt not in (None, found.attempt):
                    raise Superseded(job_id)
                raise IllegalStep(found.state, step)
            return _record(connection, job_from(row))

    def counts(self) -> dict[State, int]:
        """How many jobs are in each state."""
        query = select(jobs.c.state, func.count()).group_by(jobs.c.state)
        with self._database.read() as connection:
            found = {state: count for state, count in connection.execute(query)}
        return {state: found.get(state, 0) for state in State}

    def checkpoints(self) -> dict[str, str | None]:
        """The saved estimate of every job."""
        with self._database.read() as connection:
            return {row.id: row.checkpoint for row in connection.execute(select(jobs.c.id, jobs.c.checkpoint))}

    def events_after(self, event_id: int, limit: int) -> list[EventRecord]:
        """Transitions later than `event_id`, oldest first."""
        query = select(events).where(events.c.id > event_id).order_by(events.c.id).limit(limit)
        with self._database.read() as connection:
            return [event_from(row) for row in connection.execute(query).mappings()]

    def forget_events(self, before: str) -> int:
        """Delete transitions older than `before`, but never the newest one; how many."""
        newest = select(func.max(events.c.id)).scalar_subquery()
        with self._database.write() as connection:
            return connection.execute(delete(events).where(events.c.at < before, events.c.id < newest)).rowcount

    def ended_before(self, at: str, limit: int) -> list[str]:
        """Ids of jobs that ended before `at`, oldest first."""
        query = select(jobs.c.id).where(jobs.c.state.in_(ENDED), jobs.c.finished_at < at)
        with self._database.read() as connection:
            return list(connection.execute(query.order_by(jobs.c.number).limit(limit)).scalars())

    def first_event_id(self) -> int:
        """Id of the oldest transition that is kept, 0 if there is none."""
        with self._database.read() as connection:
            return connection.execute(select(func.coalesce(func.min(events.c.id), 0))).scalar_one()

    def last_event_id(self) -> int:
        """Id of the newest transition, 0 if there is none."""
        with self._database.read() as connection:
            return connection.execute(select(func.coalesce(func.max(events.c.id), 0))).scalar_one()


def _one(connection: Connection, job_id: str) -> JobRecord:
    row = connection.execute(select(jobs).where(jobs.c.id == job_id)).mappings().first()
    if row is None:
        raise JobNotFound(job_id)
    return job_from(row)


def _queue(connection: Connection) -> list[Waiting]:
    """The queued jobs in the order in which they will start."""
    queued = {row[0]: Waiting._make(row) for row in connection.execute(_QUEUED)}
    running = _counts_by_client(connection, State.RUNNING)
    return [queued[job_id] for job_id in start_order(queued.values(), running)]


def _counts_by_client(connection: Connection, state: State) -> dict[str, int]:
    return {client_id: count for client_id, count in connection.execute(_COUNTS, {"counted": state})}


def _record(connection: Connection, job: JobRecord) -> JobRecord:
    """Write the event of a transition that has just been made, with the job's place in the queue."""
    position = None
    if job.state is State.QUEUED:
        waiting = _queue(connection)
        position = next(place for place, other in enumerate(waiting, start=1) if other.job_id == job.id)
    row = {
        "job_id": job.id,
        "client_id": job.client_id,
        "at": now(),
        "queue_position": position,
        "job": job_as_json(replace(job, curve=())),
    }
    keep_event_order(connection)
    connection.execute(insert(events).values(row))
    return job
