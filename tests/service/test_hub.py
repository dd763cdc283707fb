"""What streams are told, without HTTP."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

from service.dispatch import Waiting
from service.hub import Hub, Subscription
from service.messages import ProgressMessage
from service.news import Told, event_text
from service.states import State
from service.store import Database, JobStore

_SILENCE = 0.05


def told(job_id: str, number: int | None = None) -> Told:
    return Told("job" if number else "progress", job_id, "", event_text("job", f'"{job_id}"', id=number), number)


def progress_of(job_id: str, spp: float) -> ProgressMessage:
    known: dict[str, Any] = dict.fromkeys(ProgressMessage.model_fields)
    known |= {"id": job_id, "state": State.RUNNING, "spp": spp, "samples": 0, "seconds": 0.0, "frame_seq": 1}
    return ProgressMessage.model_validate(known | {"invalid": 0})


def heard(act: Callable[[Subscription], Coroutine[Any, Any, None]], parts: int) -> list[bytes | None]:
    """The first parts that a stream hears while something is done to it."""

    async def listen() -> list[bytes | None]:
        subscription, found = Subscription("", None), []
        news = subscription.news(_SILENCE)
        doing = asyncio.create_task(act(subscription))
        async for part in news:
            found.append(part)
            if len(found) == parts:
                break
        await doing
        return found

    return asyncio.run(asyncio.wait_for(listen(), 10))


def test_an_event_is_written_as_its_standard_says() -> None:
    assert event_text("job", '{"a":1}', id=7, retry=1000) == b'event: job\ndata: {"a":1}\nid: 7\nretry: 1000\n\n'
    assert event_text("ping", "{}") == b"event: ping\ndata: {}\n\n"


def test_what_queues_up_is_one_part_with_transitions_before_progress() -> None:
    async def act(subscription: Subscription) -> None:
        subscription.tell_progress(told("a"))
        subscription.tell_transition(told("b", 1))
        subscription.tell_transition(told("c", 2))

    (part,) = heard(act, 1)
    assert part == told("b", 1).text + told("c", 2).text + told("a").text


def test_the_latest_progress_wins_and_a_transition_ends_it() -> None:
    async def act(subscription: Subscription) -> None:
        subscription.tell_progress(told("a"))
        subscription.tell_progress(told("b"))
        subscription.tell_progress(told("a"))
        subscription.tell_transition(told("b", 1))

    (part,) = heard(act, 1)
    assert part == told("b", 1).text + told("a").text


def test_silence_is_told_and_news_still_come_after_it() -> None:
    async def act(subscription: Subscription) -> None:
        await asyncio.sleep(2.5 * _SILENCE)
        subscription.tell_progress(told("a"))

    found = heard(act, 3)
    assert found[:2] == [None, None]
    assert told("a").text in found


def test_all_streams_send_the_same_bytes(tmp_path: Path) -> None:
    """Written once: fifty streams must not cost fifty times the JSON."""

    async def listen() -> list[bytes | None]:
        hub = Hub(JobStore(Database(f"sqlite:///{tmp_path}/hub.sqlite")))
        streams = [hub.subscribe() for _ in range(3)]
        hub.tell_progress(progress_of("a", 4.0), "")
        return [await anext(stream.news(1.0)) for stream in streams]

    first, *others = asyncio.run(listen())
    assert first is not None
    assert b'"spp":4.0' in first
    assert all(part is first for part in others)


def test_of_the_queue_the_latest_is_told_after_the_transitions_and_each_hears_of_its_own(tmp_path: Path) -> None:
    queue = [Waiting("a", 1, False, "alice"), Waiting("b", 2, False, "bob"), Waiting("c", 3, False, "alice")]

    async def listen() -> list[bytes | None]:
        store = JobStore(Database(f"sqlite:///{tmp_path}/hub.sqlite"))
        store.queue = lambda: queue  # type: ignore[method-assign]
        hub = Hub(store, queue_seconds=0.01)
        streams = [hub.subscribe(), hub.subscribe("alice", "alice")]
        hub.queue_has_changed()
        queue.pop(0)
        hub.queue_has_changed()
        for stream in streams:
            stream.tell_transition(told("x", 1))
        await asyncio.sleep(0.1)
        return [await anext(stream.news(1.0)) for stream in streams]

    all_, alices = asyncio.run(listen())
    assert all_ is not None
    assert alices is not None
    assert all_.startswith(told("x", 1).text)
    assert all_.count(b"event: queue") == 1
    assert b'{"places":[{"id":"b","position":1,' in all_
    assert b'{"id":"c","position":2,' in all_
    # A place counts all that wait before one; whose they are is not told.
    assert b'{"places":[{"id":"c","position":2,' in alices


def test_a_stream_that_does_not_keep_up_is_ended() -> None:
    async def listen() -> list[bytes | None]:
        subscription = Subscription("", None)
        for number in range(1, 2000):
            subscription.tell_transition(told("a", number))
        return [part async for part in subscription.news(1.0)]

    assert asyncio.run(asyncio.wait_for(listen(), 10)) == []
