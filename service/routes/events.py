"""One stream of server-sent events for all jobs."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Annotated, Any

from fastapi import APIRouter, Header
from fastapi.sse import EventSourceResponse, ServerSentEvent

from service.context import ServiceContext
from service.messages import Hello, Job, ProgressMessage
from service.store import EventRecord

router = APIRouter(prefix="/api", tags=["events"])


def _schema(*names: str) -> dict[str, Any]:
    return {"oneOf": [{"$ref": f"#/components/schemas/{name}"} for name in names]}


_EVENTS: dict[int | str, dict[str, Any]] = {
    200: {
        "description": (
            "`hello` (data: Hello) opens every stream. `job` (data: Job) has an id and tells of a change "
            "of state. `progress` (data: ProgressMessage) has none. A comment comes after 15 s of silence."
        ),
        "content": {
            "text/event-stream": {
                "itemSchema": {
                    "type": "object",
                    "required": ["event", "data"],
                    "properties": {
                        "event": {"enum": ["hello", "job", "progress"]},
                        "id": {"type": "string"},
                        "retry": {"type": "integer"},
                        "data": {
                            "type": "string",
                            "contentMediaType": "application/json",
                            "contentSchema": _schema("Hello", "Job", "ProgressMessage"),
                        },
                    },
                }
            }
        },
    }
}


@router.get("/events", response_class=EventSourceResponse, responses=_EVENTS)
async def events(
    service: ServiceContext, last_event_id: Annotated[str, Header()] = ""
) -> AsyncIterator[ServerSentEvent]:
    """Changes of state, with replay of those after Last-Event-ID, and the progress of running jobs."""
    hub = service.hub
    subscription = hub.subscribe()
    try:
        # What happens from here on is queued; what happened before is read from the store.
        until = hub.last_event_id
        after = int(last_event_id) if last_event_id.isdecimal() and int(last_event_id) <= until else None
        hello = Hello(server=service.id, last_event_id=until)
        # With its id, so that a client that sees nothing else still comes back with a Last-Event-ID.
        yield ServerSentEvent(event="hello", data=hello, retry=1000, id=str(until) if after is None else None)
        if after is not None:
            async for event in hub.missed(after, until):
                yield _transition(event)
            for live in service.runner.live_jobs():
                yield _progress(ProgressMessage.of(live.record, live.progress))
        async for news in subscription.news():
            yield _transition(news) if isinstance(news, EventRecord) else _progress(news)
    finally:
        hub.unsubscribe(subscription)


def _transition(event: EventRecord) -> ServerSentEvent:
    return ServerSentEvent(event="job", id=str(event.id), data=Job.of(event.job, queue_position=event.queue_position))


def _progress(progress: ProgressMessage) -> ServerSentEvent:
    return ServerSentEvent(event="progress", data=progress)
