"""What an event stream says, written once for all who listen."""

from __future__ import annotations

from dataclasses import dataclass

from service.messages import Deleted, Job, ProgressMessage, Queue, QueuePlace
from service.store import EventRecord


@dataclass(frozen=True, slots=True)
class Told:
    """One event as it goes over the wire. id: None where there is nothing to replay; client_id: whose job it is about.

    text: the bytes that every stream sends, shared by all.
    """

    kind: str
    job_id: str
    client_id: str
    text: bytes
    id: int | None = None


def event_text(kind: str, data: str, *, id: int | None = None, retry: int | None = None) -> bytes:
    """One server-sent event. data: JSON, which has no line breaks of its own; retry: milliseconds."""
    lines = [f"event: {kind}", f"data: {data}"]
    if id is not None:
        lines.append(f"id: {id}")
    if retry is not None:
        lines.append(f"retry: {retry}")
    return "\n".join((*lines, "", "")).encode()


def transition(event: EventRecord, expected_start: str | None) -> Told:
    """A change of state, or that a job is gone."""
    if event.job is None:
        kind, data = "deleted", Deleted(id=event.job_id).model_dump_json()
    else:
        job = Job.of(event.job, queue_position=event.queue_position, expected_start=expected_start)
        kind, data = "job", job.model_dump_json()
    return Told(kind, event.job_id, event.client_id, event_text(kind, data, id=event.id), event.id)


def progress(message: ProgressMessage, client_id: str) -> Told:
    """How a running job gets on."""
    return Told("progress", message.id, client_id, event_text("progress", message.model_dump_json()))


def queue(places: list[QueuePlace]) -> Told:
    """Who waits where."""
    return Told("queue", "", "", event_text("queue", Queue(places=places).model_dump_json()))
