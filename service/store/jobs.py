"""The verbs of jobs, one statement each. Every change of state writes its event in the same transaction."""

from __future__ import annotations

import json
import secrets
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import structlog
from sqlalchemy import (
    JSON,
    Column,
    ColumnElement,
    Connection,
    RowMapping,
    Text,
    bindparam,
    cast,
    delete,
    func,
    insert,
    select,
    true,
    update,
)
from sqlalchemy.exc import IntegrityError

from service.dispatch import Waiting, start_order
from service.states import DELETABLE, ENDED, IllegalStep, State, Step, destination, sources
from service.store.database import Database, keep_event_order
from service.store.records import (
    EventRecord,
    JobRecord,
    Kept,
    NewJob,
    Progress,
    RowUnreadable,
    event_from,
    job_as_json,
    job_from,
    now,
)
from service.store.scenes import SceneNotFound
from service.store.schema import events, jobs, scenes
from service.store.webhooks import Webhook, forget, queue_message, remember


def _as_text(column: Column[Any]) -> ColumnElement[Any]:
    """JSON as text: it is read only where it has changed, and one that is none spoils no other row."""
    return cast(column, Text).label(column.name) if isinstance(column.type, JSON) else column


_UNREAD = ("idempotency_key", "lease_until")
_WHOLE = [_as_text(column) for column in jobs.columns if column.name not in _UNREAD]
_LISTED = [column for column in _WHOLE if column.name != "curve"]
_NAMES = [column.name for column in _LISTED]
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


class QueueFull(Exception):
    """No more jobs may wait."""

    def __init__(self, count: int, whose: str) -> None:
        super().__init__(f"{count} jobs wait already, {whose}; try again later or cancel some")


@dataclass(frozen=True, slots=True)
class QueueLimits:
    """How many jobs may be queued: of all clients together, and of one."""

    of_all: int
    of_one: int

    def check(self, waiting: Mapping[str, int], client_id: str) -> None:
        """Whether one more job of a client may wait. waiting: queued jobs by client. Raises QueueFull."""
        limits = [(sum(waiting.values()), self.of_all, "the limit of this service")]
        if client_id:
            limits.append((waiting.get(client_id, 0), self.of_one, "the limit of one client"))
        for count, most, whose in limits:
            if count >= most:
                raise QueueFull(count, whose)


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
        self._unreadable: dict[str, str] = {}

    def add(self, new: NewJob, limits: QueueLimits | None = None) -> tuple[JobRecord, bool]:
        """Queue a job; with an idempotency key at most once. The job, and whether it is new.

        Raises KeyUsedOtherwise, QueueFull, and SceneNotFound where the scene was deleted meanwhile.
        """
        try:
            if found := self.submitted(new.client_id, new.idempotency_key, new.request_digest):
                return found, False
            return self._insert(new, limits), True
        except IntegrityError:
            # Another request with the same key came in between.
            if found := self.submitted(new.client_id, new.idempotency_key, new.request_digest):
                return found, False
            raise

    def submitted(self, client_id: str, idempotency_key: str | None, request_digest: str | None) -> JobRecord | None:
        """The job that a client has queued with this key, or None. Raises KeyUsedOtherwise."""
        if idempotency_key is None:
            return None
        query = select(*_WHOLE).where(jobs.c.client_id == client_id, jobs.c.idempotency_key == idempotency_key)
        with self._database.read() as connection:
            row = connection.execute(query).mappings().first()
        if row is not None and row["request_digest"] != request_digest:
            raise KeyUsedOtherwise
        return job_from(row) if row is not None else None

    def add_series(self, some: Sequence[NewJob], limits: QueueLimits | None = None) -> tuple[list[JobRecord], bool]:
        """Queue jobs as one series, all or none of them; with an idempotency key, that of the first, at most once. The
        jobs, and whether they are new. Raises as `add` does.
        """
        first = some[0]

        def submitted() -> list[JobRecord]:
            found = self.submitted(first.client_id, first.idempotency_key, first.request_digest)
            return self.series(found.series) if found is not None and found.series else []

        if found := submitted():
            return found, False
        name = secrets.token_hex(6)
        try:
            with self._database.write() as connection:
                made = [self._insert_one(connection, replace(new, series=name), limits) for new in some]
        except IntegrityError:
            # Another request with the same key came in between.
            if found := submitted():
                return found, False
            raise
        return made, True

    def series(self, name: str, client_id: str | None = None) -> list[JobRecord]:
        """The jobs of a series, of one client or of all, in the order in which they were queued."""
        is_own = true() if client_id is None else jobs.c.client_id == client_id
        query = select(*_WHOLE).where(is_own, jobs.c.series == name).order_by(jobs.c.number)
        with self._database.read() as connection:
            return [job_from(row) for row in connection.execute(query).mappings()]

    def _insert(self, new: NewJob, limits: QueueLimits | None) -> JobRecord:
        with self._database.write() as connection:
            return self._insert_one(connection, new, limits)

    def _insert_one(self, connection: Connection, new: NewJob, limits: QueueLimits | None) -> JobRecord:
        row = {**asdict(new), "id": secrets.token_hex(6), "state": State.QUEUED, "created_at": now()}
        row |= {"progress": asdict(Progress()), "curve": [], "warnings": list(new.warnings)}
        del row["webhook"]
        _check_room(connection, new.client_id, limits)
        if new.scene_kind == "upload":
            held = select(scenes.c.id).where(scenes.c.id == new.scene_ref).with_for_update(read=True, key_share=True)
            if connection.execute(held).first() is None:
                raise SceneNotFound(new.scene_ref)
        added = connection.execute(insert(jobs).values(row).returning(*_WHOLE)).mappings().one()
        if new.webhook is not None:
            remember(connection, row["id"], Webhook(**new.webhook))
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
        query = select(*_LISTED).where(is_own).order_by(jobs.c.number.desc())
        if states:
            query = query.where(jobs.c.state.in_(states))
        found: list[JobRecord] = []
        with self._database.read() as connection:
            if before is not None:
                number = connection.execute(select(jobs.c.number).where(is_own, jobs.c.id == before)).scalar()
                if number is None:
                    raise JobNotFound(before)
                query = query.where(jobs.c.number < number)
            # Rows that cannot be read are not the end of the list.
            while rows := [tuple(row) for row in connection.execute(query.limit(limit - len(found)))]:
                found.extend(job for row in rows if (job := self._listed(row)) is not None)
                if len(found) >= limit:
                    break
                query = query.where(jobs.c.number < rows[-1][_NUMBER])
        return found

    def count(self, client_id: str | None = None, states: Collection[State] = ()) -> int:
        """How many jobs there are, of one client or of all, in these states or in any."""
        query = select(func.count()).select_from(jobs)
        if client_id is not None:
            query = query.where(jobs.c.client_id == client_id)
        if states:
            query = query.where(jobs.c.state.in_(states))
        with self._database.read() as connection:
            return connection.execute(query).scalar_one()

    def _listed(self, row: tuple[Any, ...]) -> JobRecord | None:
        number = row[_NUMBER]
        if (kept := self._rows.get(number)) is not None and kept[0] == row:
            return kept[1]
        job = self._read(dict(zip(_NAMES, row, strict=True)))
        if job is not None:
            if len(self._rows) >= _KEPT_ROWS:
                self._rows.clear()
            self._rows[number] = row, job
        return job

    def _read(self, row: RowMapping | dict[str, Any]) -> JobRecord | None:
        """A row as a value; None, with its name in the log, where it cannot be read."""
        try:
            job = job_from(row)
        except RowUnreadable as bad:
            self.note_unreadable(bad)
            return None
        self._unreadable.pop(job.id, None)
        return job

    def note_unreadable(self, bad: RowUnreadable) -> None:
        """Say once which row cannot be read."""
        if self._unreadable.get(bad.row_id) != bad.reason:
            self._unreadable[bad.row_id] = bad.reason
            structlog.get_logger("service.store").error("a row cannot be read", job=bad.row_id, why=bad.reason)

    def unreadable(self) -> dict[str, str]:
        """Rows of jobs that could not be read, with the reasons, as far as they were looked at."""
        return dict(self._unreadable)

    def clients(self) -> dict[str, str]:
        """Whose each job is, by id."""
        with self._database.read() as connection:
            return {row.id: row.client_id for row in connection.execute(select(jobs.c.id, jobs.c.client_id))}

    def queue(self) -> list[Waiting]:
        """The queued jobs that can be read, next first."""
        with self._database.read() as connection:
            return [waiting for waiting in _queue(connection) if waiting.job_id not in self._unreadable]

    def waiting(self) -> dict[str, int]:
        """How many jobs of each client are queued."""
        with self._database.read() as connection:
            return _counts_by_client(connection, State.QUEUED)

    def claim(
        self, owner: str = "", lease_until: str = "", client_id: str | None = None, passed: Collection[str] = ()
    ) -> JobRecord | None:
        """Start the next queued job of a client or of all, in one statement: no two callers get the same one.

        owner, lease_until: who runs it, and until when it may be silent. passed: jobs that are not to be started now.
        """
        while True:
            try:
                return self._claim(owner, lease_until, client_id, passed)
            except RowUnreadable as bad:  # it stays queued, and others go on
                self.note_unreadable(bad)

    def _claim(self, owner: str, lease_until: str, client_id: str | None, passed: Collection[str]) -> JobRecord | None:
        is_queued = (jobs.c.state == State.QUEUED) & jobs.c.id.not_in([*self._unreadable, *passed])
        waiting = select(jobs.c.id).where(is_queued).order_by(*_QUEUE_ORDER).limit(1)
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
            .returning(*_WHOLE)
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
        found = select(*_WHOLE).where(jobs.c.state.in_(sources(Step.GIVE_BACK)), is_over).with_for_update()
        to = {"state": destination(Step.GIVE_BACK), "lease_owner": None, "lease_until": None}
        with self._database.write() as connection:
            rows = [self._read(row) for row in connection.execute(found).mappings().all()]
            ids = [job.id for job in rows if job is not None]
            statement = update(jobs).where(jobs.c.id.in_(ids)).values(to).returning(*_WHOLE)
            given = [job_from(row) for row in connection.execute(statement).mappings()] if ids else []
            return [_record(connection, job) for job in sorted(given, key=lambda job: job.number)]

    def save(
        self,
        job: JobRecord,
        progress: Progress,
        curve: Sequence[dict[str, Any]],
        checkpoint: str | None,
        digest: str | None = None,
        earlier: Kept | None = None,
    ) -> bool:
        """Record progress together with the estimate that holds it, its sha256, and the estimate before it.

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
                checkpoint_digest=digest,
                earlier=asdict(earlier) if earlier else None,
                crashes=0,  # it got further than where it crashed
                warnings=list(job.warnings),
                losses=list(job.losses) or None,
            )
        )
        with self._database.write() as connection:
            return connection.execute(statement).rowcount == 1

    def note_loss(self, job: JobRecord, losses: Sequence[str], kept: Kept | None) -> None:
        """Say in a job that does not run which of its saved estimates were found damaged.

        kept: what it has from now on; None: nothing sound is left, and its row goes on naming what there was, in case
        someone puts the file back. Nothing is said of a job that runs or has another estimate meanwhile.
        """
        told = [*job.losses, *(one for one in losses if one not in job.losses)]
        changes: dict[str, Any] = {"losses": told}
        if kept is not None:
            changes |= {"checkpoint": kept.name, "checkpoint_digest": kept.digest, "earlier": None}
            changes |= {"progress": asdict(replace(kept.progress, frame_seq=job.progress.frame_seq + 1))}
            changes |= {"frame_seq": job.progress.frame_seq + 1}
        statement = (
            update(jobs)
            .where(jobs.c.id == job.id, jobs.c.checkpoint == job.checkpoint, jobs.c.state != State.RUNNING)
            .values(changes)
            .returning(*_WHOLE)
        )
        with self._database.write() as connection:
            row = connection.execute(statement).mappings().first()
            if row is not None:
                _record(connection, job_from(row))

    def count_crash(self, job: JobRecord) -> JobRecord:
        """Note that the render process died under this job; its next attempt begins. Raises Superseded."""
        statement = (
            update(jobs)
            .where(jobs.c.id == job.id, jobs.c.attempt == job.attempt, jobs.c.state == State.RUNNING)
            .values(crashes=jobs.c.crashes + 1, attempt=jobs.c.attempt + 1)
            .returning(*_WHOLE)
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
            forget(connection, job_id)
            keep_event_order(connection)
            connection.execute(insert(events).values(job_id=job_id, client_id=row.client_id, at=now(), job=None))

    def move(
        self,
        job_id: str,
        step: Step,
        *,
        only_from: frozenset[State] = frozenset(State),
        attempt: int | None = None,
        limits: QueueLimits | None = None,
        **changes: Any,
    ) -> JobRecord:
        """Take a step, with further columns changed.

        attempt: of the caller; one that is no longer the job's changes nothing. limits: of the queue that the step
        leads to. Raises JobNotFound, IllegalStep, Superseded, QueueFull.
        """
        to = destination(step)
        if to is not State.RUNNING:
            changes |= {"lease_owner": None, "lease_until": None}
        if to in ENDED:
            changes.setdefault("finished_at", now())
        if isinstance(earlier := changes.get("earlier"), Kept):
            changes["earlier"] = asdict(earlier)
        if isinstance(progress := changes.get("progress"), Progress):
            changes |= {"progress": asdict(progress), "frame_seq": progress.frame_seq}
        statement = (
            update(jobs)
            .where(jobs.c.id == job_id, jobs.c.state.in_(only_from.intersection(sources(step))))
            .values(state=to, **changes)
            .returning(*_WHOLE)
        )
        if attempt is not None:
            statement = statement.where(jobs.c.attempt == attempt)
        with self._database.write() as connection:
            if limits is not None:
                _check_room(connection, _one(connection, job_id).client_id, limits)
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

    def checkpoints(self) -> dict[str, set[str] | None]:
        """The saved estimates of every job: the newest, and the one before it. None where that cannot be read."""
        query = select(jobs.c.id, jobs.c.checkpoint, _as_text(jobs.c.earlier))
        found: dict[str, set[str] | None] = {}
        with self._database.read() as connection:
            for row in connection.execute(query):
                try:
                    earlier = json.loads(row.earlier)["name"] if row.earlier else None
                    found[row.id] = {name for name in (row.checkpoint, earlier) if name}
                except (ValueError, TypeError, LookupError):
                    found[row.id] = None
        return found

    def check_presence(self) -> None:
        """Whether the database is still there. Raises DatabaseReplaced."""
        self._database.check_presence()

    def events_after(self, event_id: int, limit: int) -> list[EventRecord]:
        """Transitions later than `event_id`, oldest first."""
        columns = [_as_text(column) for column in events.columns]
        query = select(*columns).where(events.c.id > event_id).order_by(events.c.id).limit(limit)
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
    row = connection.execute(select(*_WHOLE).where(jobs.c.id == job_id)).mappings().first()
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


def _check_room(connection: Connection, client_id: str, limits: QueueLimits | None) -> None:
    """In the transaction that queues a job: two that count at once would both find the last place. Raises QueueFull."""
    if limits is not None:
        keep_event_order(connection)  # nobody else queues before this transaction ends
        limits.check(_counts_by_client(connection, State.QUEUED), client_id)


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
    if job.state in ENDED:
        queue_message(connection, job)
    return job
