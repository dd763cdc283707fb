"""What an event stream says, written once for all who listen."""

from __future__ import annotations

from dataclasses import dataclass

from service.messages import Deleted, Job, ProgressMessage
from service.store import EventRecord


@dataclass(frozen=True, slots=True)
class Told:
    """One event as text. id: None where there is nothing to replay; client_id: whose job it is about."""

    kind: str
    job_id: str
    client_id: str
    text: str
    id: int | None = None


def transition(event: EventRecord, expected_start: str | None) -> Told:
    """A change of state, or that a job is gone."""
    if event.job is None:
        return Told("deleted", event.job_id, event.client_id, Deleted(id=event.job_id).model_dump_json(), event.id)
    job = Job.of(event.job, queue_position=event.queue_position, expected_start=expected_start)
    return Told("job", event.job_id, event.client_id, job.model_dump_json(), event.id)


def progress(message: ProgressMessage, client_id: str) -> Told:
    """How a running job gets on."""
    return Told("progress", message.id, client_id, message.model_dump_json())
