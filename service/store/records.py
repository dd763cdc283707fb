"""Rows as values, and the one place where rows become values."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import RowMapping

from service.states import State


def now() -> str:
    """This moment, ISO 8601 in UTC with milliseconds."""
    return iso(datetime.now(UTC))


def iso(moment: datetime) -> str:
    """A moment in UTC, ISO 8601 with milliseconds."""
    return moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")


@dataclass(frozen=True, slots=True)
class Progress:
    """What is known of a job's estimate. error: relative (0.03 = 3 %); seconds: of rendering."""

    error: float | None = None
    spp: float = 0.0
    samples: int = 0
    seconds: float = 0.0
    frame_seq: int = 0
    forecast: dict[str, float | None] | None = None
    share_within: float | None = None
    share_trusted: float | None = None
    invalid: int = 0
    error_upper: float | None = None
    health: dict[str, Any] | None = None


@dataclass(frozen=True, slots=True)
class NewJob:
    """What is needed to queue a job."""

    name: str
    scene_kind: str
    scene_ref: str
    scene_name: str
    target: dict[str, Any]
    settings: dict[str, Any]
    warnings: tuple[str, ...] = ()
    client_id: str = ""
    priority: int = 0
    idempotency_key: str | None = None
    request_digest: str | None = None


@dataclass(frozen=True, slots=True)
class JobRecord:
    """One job as stored. `curve` is empty unless asked for."""

    number: int
    id: str
    name: str
    scene_kind: str
    scene_ref: str
    scene_name: str
    state: State
    target: dict[str, Any]
    settings: dict[str, Any]
    created_at: str
    started_at: str | None
    finished_at: str | None
    attempt: int
    crashes: int
    checkpoint: str | None
    progress: Progress
    stopped_by: str | None
    cause: dict[str, Any] | None
    warnings: tuple[str, ...]
    curve: tuple[dict[str, float], ...] = field(default=())
    client_id: str = ""
    priority: int = 0
    request_digest: str | None = None
    lease_owner: str | None = None


@dataclass(frozen=True, slots=True)
class EventRecord:
    """One transition: the job as it was right after it, or None once it was deleted."""

    id: int
    job_id: str
    client_id: str
    at: str
    queue_position: int | None
    job: JobRecord | None


@dataclass(frozen=True, slots=True)
class SceneRecord:
    """One uploaded scene. `path` is relative to the folder of scenes."""

    id: str
    name: str
    path: str
    width: int
    height: int
    digest: str
    warnings: tuple[str, ...]
    created_at: str


def job_from(row: RowMapping | dict[str, Any]) -> JobRecord:
    """A row of `jobs`, or its JSON form in an event, as a value."""
    known = {name: row[name] for name in JobRecord.__dataclass_fields__ if name in row}
    known["state"] = State(row["state"])
    known["progress"] = Progress(**row["progress"])
    known["warnings"] = tuple(row["warnings"])
    known["curve"] = tuple(row["curve"]) if "curve" in row else ()
    return JobRecord(**known)


def job_as_json(job: JobRecord) -> dict[str, Any]:
    """The form in which an event keeps a job: without its curve, which grows."""
    kept = asdict(job)
    del kept["curve"]
    return kept


def event_from(row: RowMapping) -> EventRecord:
    """A row of `events` as a value."""
    fields = {name: row[name] for name in ("id", "job_id", "client_id", "at", "queue_position")}
    return EventRecord(**fields, job=job_from(row["job"]) if row["job"] else None)


def scene_from(row: RowMapping) -> SceneRecord:
    """A row of `scenes` as a value."""
    known = dict(row)
    known["warnings"] = tuple(known["warnings"])
    return SceneRecord(**known)
