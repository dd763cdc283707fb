"""The verbs of jobs. Every change of state writes its event in the same transaction."""

from __future__ import annotations

import secrets
from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any

from sqlalchemy import Connection, delete, func, insert, select, update
from sqlalchemy.exc import IntegrityError

from service.states import DELETABLE, ENDED, IllegalStep, State, Step, destination, sources
from service.store.database import Database
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
from service.store.schema import events, jobs

_WITHOUT_CURVE = [column for column in jobs.columns if column.name != "curve"]
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


class KeyUsedOtherwise(Exception):
    """An idempotency key came again with another request."""

    def __init__(self) -> None:
        super().__init__("this Idempotency-Key was used for another request; choose a new one for a new job")


class JobStore:
    """Jobs and their events. Synchronous: call it from a thread."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def add(self, new: NewJob) -> tuple[JobRecord, bool]:
        """Queue a job; with an idempotency key at most once. The job, and whether it is new.

        Raises KeyUsedOtherwise.
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
            added = connection.execute(insert(jobs).values(row).returning(jobs)).mappings().one()
            return _record(connection, job_from(added))

    def get(self, job_id: str) -> JobRecord:
        """One job with its curve. Raises JobNotFound."""
        with self._database.read() as connection:
            return _one(connection, job_id)

    def newest(self, limit: int) -> list[JobRecord]:
        """The newest jobs, newest first, without curves."""
        query = select(*_WITHOUT_CURVE).order_by(jobs.c.number.desc()).limit(limit)
        with self._database.read() as connection:
            return [job_from(row) for row in connection.execute(query).mappings()]

    def queue(self) -> list[str]:
        """Ids of the queued jobs, next first."""
        query = select(jobs.c.id).where(jobs.c.state == State.QUEUED).order_by(*_QUEUE_ORDER)
        with self._database.read() as connection:
            return list(connection.execute(query).scalars())

    def claim(self) -> JobRecord | None:
        """Start the next queued job, in one statement: no two callers get the same one."""
        waiting = select(jobs.c.id).where(jobs.c.state == State.QUEUED).order_by(*_QUEUE_ORDER).limit(1)
        claim = (
            update(jobs)
            .where(jobs.c.id == waiting.with_for_update(skip_locked=True).scalar_subquery())
            .values(
                state=destination(Step.START),
                attempt=jobs.c.attempt + 1,
                started_at=func.coalesce(jobs.c.started_at, now()),
            )
            .returning(jobs)
        )
        with self._database.write() as connection:
            row = connection.execute(claim).mappings().first()
            return _record(connection, job_from(row)) if row else None

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
                warnings=list(job.warnings),
            )
        )
        with self._database.write() as connection:
            return connection.execute(statement).rowcount == 1

    def count_crash(self, job: JobRecord) -> JobRecord:
        """Note that the render process died under this job; its next attempt begins."""
        statement = (
            update(jobs)
            .where(jobs.c.id == job.id, jobs.c.attempt == job.attempt)
            .values(crashes=jobs.c.crashes + 1, attempt=jobs.c.attempt + 1)
            .returning(jobs)
        )
        with self._database.write() as connection:
            row = connection.execute(statement).mappings().first()
            return job_from(row) if row else _one(connection, job.id)

    def delete(self, job_id: str) -> None:
        """Forget a job; that it is gone is the last event of it. Raises JobNotFound, StillRunning."""
        statement = delete(jobs).where(jobs.c.id == job_id, jobs.c.state.in_(DELETABLE)).returning(jobs.c.client_id)
        with self._database.write() as connection:
            row = connection.execute(statement).first()
            if row is None:
                _one(connection, job_id)
                raise StillRunning
            connection.execute(delete(events).where(events.c.job_id == job_id))
            connection.execute(insert(events).values(job_id=job_id, client_id=row.client_id, at=now(), job=None))

    def move(
        self, job_id: str, step: Step, *, only_from: frozenset[State] = frozenset(State), **changes: Any
    ) -> JobRecord:
        """Take a step, with further columns changed. Raises JobNotFound, IllegalStep."""
        to = destination(step)
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
        with self._database.write() as connection:
            row = connection.execute(statement).mappings().first()
            if row is None:
                raise IllegalStep(_one(connection, job_id).state, step)
            return _record(connection, job_from(row))

    def running(self) -> list[JobRecord]:
        """Jobs marked as running."""
        query = select(*_WITHOUT_CURVE).where(jobs.c.state == State.RUNNING).order_by(jobs.c.number)
        with self._database.read() as connection:
            return [job_from(row) for row in connection.execute(query).mappings()]

    def checkpoints(self) -> dict[str, str | None]:
        """The saved estimate of every job."""
        with self._database.read() as connection:
            return {row.id: row.checkpoint for row in connection.execute(select(jobs.c.id, jobs.c.checkpoint))}

    def events_after(self, event_id: int, limit: int) -> list[EventRecord]:
        """Transitions later than `event_id`, oldest first."""
        query = select(events).where(events.c.id > event_id).order_by(events.c.id).limit(limit)
        with self._database.read() as connection:
            return [event_from(row) for row in connection.execute(query).mappings()]

    def last_event_id(self) -> int:
        """Id of the newest transition, 0 if there is none."""
        with self._database.read() as connection:
            return connection.execute(select(func.coalesce(func.max(events.c.id), 0))).scalar_one()


def _one(connection: Connection, job_id: str) -> JobRecord:
    row = connection.execute(select(jobs).where(jobs.c.id == job_id)).mappings().first()
    if row is None:
        raise JobNotFound(job_id)
    return job_from(row)


def _record(connection: Connection, job: JobRecord) -> JobRecord:
    """Write the event of a transition that has just been made, with the job's place in the queue."""
    position = None
    if job.state is State.QUEUED:
        queue = select(jobs.c.id).where(jobs.c.state == State.QUEUED).order_by(*_QUEUE_ORDER)
        position = list(connection.execute(queue).scalars()).index(job.id) + 1
    row = {
        "job_id": job.id,
        "client_id": job.client_id,
        "at": now(),
        "queue_position": position,
        "job": job_as_json(replace(job, curve=())),
    }
    connection.execute(insert(events).values(row))
    return job
