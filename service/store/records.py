"""Rows as values, and the one place where rows become values."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from types import MappingProxyType
from typing import Any

from sqlalchemy import RowMapping

from service.states import State

_JSON = frozenset({"target", "settings", "progress", "curve", "cause", "warnings", "earlier", "losses"})


NO_PARAMETERS: Mapping[str, str] = MappingProxyType({})


def loaded_as(scene: str, parameters: Mapping[str, str]) -> str:
    """A name that tells a scene with values for its parameters from the same scene with others."""
    return f"{scene} {json.dumps(parameters, sort_keys=True)}" if parameters else scene


class RowUnreadable(Exception):
    """A row that this version cannot read: it is left as it is, and named."""

    def __init__(self, what: str, row_id: str, reason: str) -> None:
        self.row_id = row_id
        self.reason = reason
        super().__init__(f"the {what} {row_id!r} cannot be read by this version: {reason}")


def now() -> str:
    """This moment, ISO 8601 in UTC with milliseconds."""
    return iso(datetime.now(UTC))


def iso(moment: datetime) -> str:
    """A moment in UTC, ISO 8601 with milliseconds."""
    return moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")


@dataclass(frozen=True, slots=True)
class Progress:
    """What is known of a job's estimate. error: relative (0.03 = 3 %), None where it cannot be said: error_unknown says
    why. seconds: of rendering. replicate_size: samples in a replicate, as resolved; with it a job that is taken up
    again has the same bits, whatever the pace was when it began.
    """

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
    error_unknown: str | None = None
    replicate_size: int | None = None
    health: dict[str, Any] | None = None


@dataclass(frozen=True, slots=True)
class Kept:
    """A saved estimate: its file below the folder of estimates, the sha256 of that, and the progress that it holds."""

    name: str
    digest: str | None
    progress: Progress


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
    series: str | None = None
    webhook: dict[str, str] | None = None  # url and secret: who is told of its end


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
    curve: tuple[dict[str, Any], ...] = field(default=())
    client_id: str = ""
    priority: int = 0
    request_digest: str | None = None
    lease_owner: str | None = None
    checkpoint_digest: str | None = None
    earlier: Kept | None = None
    losses: tuple[str, ...] = ()
    series: str | None = None

    @property
    def loaded_scene(self) -> str:
        """What the renderer loads for it: the same name for jobs that share a scene."""
        return loaded_as(self.scene_ref, self.settings.get("parameters", NO_PARAMETERS))

    @property
    def kept(self) -> tuple[Kept, ...]:
        """The saved estimates, newest first."""
        newest = (Kept(self.checkpoint, self.checkpoint_digest, self.progress),) if self.checkpoint else ()
        return newest + ((self.earlier,) if self.earlier else ())


@dataclass(frozen=True, slots=True)
class EventRecord:
    """One transition: the job as it was right after it, or None once it was deleted."""

    id: int
    job_id: str
    client_id: str
    at: str
    queue_position: int | None
    job: JobRecord | None
    is_readable: bool = True


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
    """A row of `jobs`, or its JSON form in an event, as a value. JSON may be text still. Raises RowUnreadable."""
    try:
        known = {name: _parsed(name, row[name]) for name in JobRecord.__dataclass_fields__ if name in row}
        known["state"] = State(row["state"])
        known["progress"] = Progress(**known["progress"])
        known["warnings"] = tuple(known["warnings"])
        known["losses"] = tuple(known.get("losses") or ())
        if earlier := known.get("earlier"):
            known["earlier"] = Kept(earlier["name"], earlier["digest"], Progress(**earlier["progress"]))
        known["curve"] = tuple(known.get("curve") or ())
        return JobRecord(**known)
    except (ValueError, TypeError, LookupError, AttributeError) as error:
        raise RowUnreadable("job", str(row.get("id")), _short(error)) from error


def _parsed(name: str, value: Any) -> Any:
    return json.loads(value) if name in _JSON and isinstance(value, str) else value


def _short(error: Exception) -> str:
    """What is wrong, in one line."""
    missing = f"{error} is missing" if isinstance(error, KeyError) else str(error)
    return missing.replace("Progress.__init__() got an", "progress has an").splitlines()[0][:200]


def job_as_json(job: JobRecord) -> dict[str, Any]:
    """The form in which an event keeps a job: without its curve, which grows, and without its files."""
    kept = asdict(job)
    for name in ("curve", "checkpoint_digest", "earlier"):
        del kept[name]
    return kept


def event_from(row: RowMapping) -> EventRecord:
    """A row of `events` as a value; one that cannot be read says nothing, and keeps its id."""
    fields = {name: row[name] for name in ("id", "job_id", "client_id", "at", "queue_position")}
    try:
        told = json.loads(row["job"]) if isinstance(row["job"], str) else row["job"]
        return EventRecord(**fields, job=job_from(told) if told else None)
    except (RowUnreadable, ValueError):
        return EventRecord(**fields, job=None, is_readable=False)


def scene_from(row: RowMapping) -> SceneRecord:
    """A row of `scenes` as a value. Raises RowUnreadable."""
    try:
        return SceneRecord(**{**row, "warnings": tuple(json.loads(row["warnings"]))})
    except (ValueError, TypeError) as error:
        raise RowUnreadable("scene", str(row.get("id")), _short(error)) from error
