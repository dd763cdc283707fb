"""One stream of server-sent events for all jobs."""

from __future__ import annotations

import contextlib
import time
from collections.abc import AsyncIterator
from typing import Annotated, Any

import structlog
from fastapi import APIRouter, Depends, Header, Request, Response
from fastapi.responses import StreamingResponse
from sqlalchemy.exc import SQLAlchemyError

from service.access import Reader, may_still_ask
from service.context import Service, ServiceContext
from service.errors import ProblemError
from service.hub import Subscription
from service.messages import Hello, Ping, ProgressMessage
from service.news import Told, event_text, progress
from service.store.records import now
from service.store.threads import reading

router = APIRouter(prefix="/api", tags=["events"])

_LOOKS_PER_PING = 5
_log = structlog.get_logger("service.events")


def _schema(*names: str) -> dict[str, Any]:
    return {"oneOf": [{"$ref": f"#/components/schemas/{name}"} for name in names]}


_EVENTS: dict[int | str, dict[str, Any]] = {
    200: {
        "description": (
            "`hello` (data: Hello) opens every stream. `queue` (data: Queue) follows, and comes whenever places in "
            "the queue change: it tells all of them and replaces what was known. `job` (data: Job) has an id and "
            "tells of a change of state. `deleted` (data: Deleted) has one too: the job is gone. `progress` (data: "
            "ProgressMessage) has none. `ping` (data: Ping) comes after 15 s (FREDHOLM_PING_SECONDS) without others."
        ),
        "content": {
            "text/event-stream": {
                "itemSchema": {
                    "type": "object",
                    "required": ["event", "data"],
                    "properties": {
                        "event": {"type": "string", "enum": ["hello", "job", "deleted", "progress", "queue", "ping"]},
                        "id": {"type": "string"},
                        "retry": {"type": "integer", "minimum": 0},
                        "data": {
                            "type": "string",
                            "contentMediaType": "application/json",
                            "contentSchema": _schema("Hello", "Job", "Deleted", "ProgressMessage", "Queue", "Ping"),
                        },
                    },
                }
            }
        },
    }
}


async def _subscription(service: ServiceContext, caller: Reader) -> AsyncIterator[Subscription]:
    """One more stream, if the caller may open one; it counts before anyone else asks. Raises ProblemError."""
    limits, hub = service.settings, service.hub
    for count, most in (
        (hub.count(caller.client_id), limits.max_streams_per_client),
        (hub.count(), limits.max_streams),
    ):
        if count >= most:
            service.metrics.refusals.labels("streams").inc()
            detail = f"{count} event streams are open, the limit here; close one: a single stream tells of all jobs."
            raise ProblemError(429, "too-many", "Too many event streams", detail, headers={"Retry-After": "10"})
    subscription = hub.subscribe(caller.client_id, caller.scope)
    try:
        yield subscription
    finally:
        hub.unsubscribe(subscription)


# A proxy shall neither keep nor collect them.
_HEADERS = {"Cache-Control": "no-cache", "X-Accel-Buffering": "no"}


@router.get("/events", response_class=Response, responses=_EVENTS)
async def events(
    service: ServiceContext,
    subscription: Annotated[Subscription, Depends(_subscription)],
    request: Request,
    last_event_id: Annotated[str, Header()] = "",
) -> StreamingResponse:
    """Changes of state, with replay of those after Last-Event-ID, and the progress of running jobs."""
    # What happens from here on is queued; what happened before is read from the store: no stream begins without it.
    until = service.hub.last_event_id
    after = await reading(_replay_from, service, last_event_id, until)
    queue = await service.hub.queue_for(subscription)
    parts = _until_trouble(_parts(service, subscription, request, queue, after, until))
    return StreamingResponse(parts, media_type="text/event-stream", headers=_HEADERS)


async def _until_trouble(parts: AsyncIterator[bytes]) -> AsyncIterator[bytes]:
    """The parts of a stream, which ends where one cannot be made: clients come back with their last event id."""
    try:
        async for part in parts:
            yield part
    except SQLAlchemyError as error:
        _log.warning("an event stream ends: the database does not answer", cause=type(error).__name__)
    except Exception:
        _log.exception("an event stream ends")


async def _parts(
    service: Service, subscription: Subscription, request: Request, queue: Told, after: int | None, until: int
) -> AsyncIterator[bytes]:
    hub = service.hub
    hello = Hello(server=service.id, last_event_id=until).model_dump_json()
    # With its id, so that a client that sees nothing else still comes back with a Last-Event-ID.
    yield event_text("hello", hello, retry=1000, id=until if after is None else None)
    yield queue.text
    if after is not None:
        async for event in hub.missed(after, until):
            if subscription.hears(event.client_id):
                yield event.text
        for live in filter(lambda live: subscription.hears(live.record.client_id), service.runner.live_jobs()):
            yield progress(ProgressMessage.of(live.record, live.progress), live.record.client_id).text
    silent, checked = 0, time.monotonic()
    async for news in subscription.news(service.settings.ping_seconds / _LOOKS_PER_PING):
        silent = silent + 1 if news is None else 0
        if time.monotonic() - checked > service.settings.ping_seconds:
            checked = time.monotonic()
            # Whether the key was revoked cannot be known while the database is silent; it is looked up again soon.
            with contextlib.suppress(SQLAlchemyError):
                if not await may_still_ask(request, service):
                    return
        if news is not None:
            yield news
        elif silent % _LOOKS_PER_PING == 0:
            yield event_text("ping", Ping(at=now()).model_dump_json())


def _replay_from(service: Service, last_event_id: str, until: int) -> int | None:
    """The id after which to replay; None if there is nothing to replay, or too much was forgotten."""
    if not last_event_id.isdecimal() or len(last_event_id) > 18:
        return None
    after = int(last_event_id)
    return after if service.jobs.first_event_id() - 1 <= after <= until else None
