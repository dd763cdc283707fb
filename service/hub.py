"""Tells every open page what happens.

Transitions come from the store, in order, none lost; of progress the latest wins, and of the queue, which is always
told as a whole: places told one by one would contradict each other.

A client that does not keep up is disconnected once its queue is full: it comes back with its last event id
and the store replays what it missed. So a slow client costs a bounded amount of memory.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import AsyncIterator, Callable, Iterable

import structlog
from sqlalchemy.exc import SQLAlchemyError

from service import news
from service.dispatch import Waiting
from service.messages import ProgressMessage, QueuePlace
from service.news import Told
from service.store import EventRecord, JobStore
from service.store.threads import reading

_PAGE = 200
_QUEUE_LIMIT = 1000
# Many jobs that come or go at a time change the queue once.
QUEUE_SECONDS = 0.3
# Progress changes when queued jobs are expected to start.
QUEUE_REFRESH_SECONDS = 5.0
_TRY_AGAIN_SECONDS = 1.0


class Subscription:
    """What one client has yet to be told. scope: whose jobs it hears of; None: of all."""

    def __init__(self, caller: str, scope: str | None) -> None:
        self.caller = caller
        self._scope = scope
        self._transitions: deque[Told] = deque()
        self._progress: dict[str, Told] = {}
        self._queue: Told | None = None
        self._news = asyncio.Event()
        self._is_closed = False

    @property
    def scope(self) -> str | None:
        """Whose jobs it hears of; None: of all."""
        return self._scope

    def hears(self, client_id: str) -> bool:
        """Whether a client's jobs are its business."""
        return self._scope in (None, client_id)

    def tell_transition(self, told: Told) -> None:
        """Queue a transition; a full queue ends the subscription."""
        if len(self._transitions) >= _QUEUE_LIMIT:
            self.close()
            return
        # What was known before the transition is not news after it.
        self._progress.pop(told.job_id, None)
        self._transitions.append(told)
        self._news.set()

    def tell_progress(self, told: Told) -> None:
        """Replace what was to be told of this job."""
        self._progress[told.job_id] = told
        self._news.set()

    def tell_queue(self, told: Told) -> None:
        """Replace what was to be told of the queue."""
        self._queue = told
        self._news.set()

    def close(self) -> None:
        """End the stream."""
        self._is_closed = True
        self._news.set()

    async def news(self, silence_seconds: float) -> AsyncIterator[bytes | None]:
        """All that comes, until the subscription is closed; None after every `silence_seconds` without news.

        What has queued up comes in one part: each part costs a stream a write to its connection.
        """
        while not self._is_closed:
            try:
                # Not wait_for: until Python 3.12 it makes a task for every wait.
                async with asyncio.timeout(silence_seconds):
                    await self._news.wait()
            except TimeoutError:
                yield None
                continue
            self._news.clear()
            queue = [] if self._queue is None else [self._queue]
            if not self._is_closed and (told := [*self._transitions, *self._progress.values(), *queue]):
                self._transitions.clear()
                self._progress.clear()
                self._queue = None
                yield told[0].text if len(told) == 1 else b"".join(one.text for one in told)


class Hub:
    """Everyone who listens."""

    def __init__(self, store: JobStore, *, queue_seconds: float = QUEUE_SECONDS) -> None:
        self._store = store
        # Replaced by who knows when queued jobs will start.
        self.expected_starts: Callable[[Iterable[int]], dict[int, str | None]] = dict.fromkeys
        self._queue_seconds = queue_seconds
        self._has_queue = False
        self._queue_due: asyncio.TimerHandle | None = None
        self._telling_queue: asyncio.Task[None] | None = None
        self._again: asyncio.TimerHandle | None = None  # when the store is asked again
        self._telling: asyncio.Task[None] | None = None
        self._log = structlog.get_logger("service")
        self._subscriptions: set[Subscription] = set()
        self._reading = asyncio.Lock()
        self._last_event_id = 0
        self._is_closed = False

    async def start(self) -> None:
        """Begin after the newest transition there is."""
        self._last_event_id = await asyncio.to_thread(self._store.last_event_id)

    @property
    def last_event_id(self) -> int:
        """Id of the newest transition that was told."""
        return self._last_event_id

    async def tell_transitions(self) -> None:
        """Pass on what is new in the store; where it does not answer, soon again: what was written is true anyway."""
        if self._again is not None:
            return  # it was asked a moment ago
        try:
            await self._tell_transitions()
        except SQLAlchemyError as error:
            self._log.warning("changes of state could not be read, trying again", cause=type(error).__name__)
            if not self._is_closed and self._again is None:
                loop = asyncio.get_running_loop()
                self._again = loop.call_later(_TRY_AGAIN_SECONDS, self._tell_transitions_again)

    def _tell_transitions_again(self) -> None:
        self._again = None
        self._telling = asyncio.create_task(self.tell_transitions(), name="tell transitions again")

    async def _tell_transitions(self) -> None:
        """One reader at a time keeps the order of the ids."""
        async with self._reading:
            is_more = self._again is None
            while is_more:
                events = await reading(self._store.events_after, self._last_event_id, _PAGE)
                # What is written from here on is told by whoever writes it.
                is_more = len(events) == _PAGE
                if events:
                    self._last_event_id = events[-1].id
                    self.queue_has_changed()
                for event in events:
                    if not event.is_readable:
                        continue
                    told = self._transition(event)
                    for subscription in tuple(self._subscriptions):
                        if subscription.hears(told.client_id):
                            subscription.tell_transition(told)

    def tell_progress(self, progress: ProgressMessage, client_id: str) -> None:
        """Pass on how a job of a client gets on."""
        told = news.progress(progress, client_id)
        for subscription in tuple(self._subscriptions):
            if subscription.hears(client_id):
                subscription.tell_progress(told)
        if self._has_queue and self._queue_due is None:
            self._tell_queue_in(QUEUE_REFRESH_SECONDS)

    def queue_has_changed(self) -> None:
        """Tell the queue soon."""
        self._tell_queue_in(self._queue_seconds)

    def _tell_queue_in(self, seconds: float) -> None:
        loop = asyncio.get_running_loop()
        if self._is_closed or (self._queue_due is not None and self._queue_due.when() <= loop.time() + seconds):
            return
        if self._queue_due is not None:
            self._queue_due.cancel()
        self._queue_due = loop.call_later(seconds, self._tell_queue_now)

    def _tell_queue_now(self) -> None:
        self._queue_due = None
        self._telling_queue = asyncio.create_task(self._tell_queue(), name="tell the queue")

    async def _tell_queue(self) -> None:
        try:
            waiting = await reading(self._store.queue)
        except SQLAlchemyError as error:
            self._log.warning("the queue could not be read, trying again", cause=type(error).__name__)
            self._tell_queue_in(QUEUE_REFRESH_SECONDS)
            return
        except Exception:
            # The next change tells all that this one did.
            self._log.exception("the queue could not be read, going on")
            return
        self._has_queue = bool(waiting)
        told: dict[str | None, Told] = {}
        for subscription in tuple(self._subscriptions):
            scope = subscription.scope
            if scope not in told:
                told[scope] = self._queue_as_seen(waiting, scope)
            subscription.tell_queue(told[scope])

    async def queue_for(self, subscription: Subscription) -> Told:
        """The queue as it is now, for a new listener."""
        return self._queue_as_seen(await reading(self._store.queue), subscription.scope)

    def _queue_as_seen(self, waiting: list[Waiting], scope: str | None) -> Told:
        places = {job.job_id: place for place, job in enumerate(waiting, 1) if scope in (None, job.client_id)}
        starts = self.expected_starts(places.values())
        return news.queue(
            [QueuePlace(id=job_id, position=place, expected_start=starts[place]) for job_id, place in places.items()]
        )

    def _transition(self, event: EventRecord) -> Told:
        place = event.queue_position
        return news.transition(event, None if place is None else self.expected_starts([place])[place])

    async def missed(self, after: int, until: int) -> AsyncIterator[Told]:
        """Transitions from `after` (exclusive) to `until` (inclusive), page by page."""
        while after < until:
            events = await reading(self._store.events_after, after, _PAGE)
            if not events:
                return
            for event in events:
                if event.id > until:
                    return
                if event.is_readable:
                    yield self._transition(event)
            after = events[-1].id

    def subscribe(self, caller: str = "", scope: str | None = None) -> Subscription:
        """A new listener, from now on; unsubscribe it in the end."""
        subscription = Subscription(caller, scope)
        if self._is_closed:
            subscription.close()
        self._subscriptions.add(subscription)
        return subscription

    def count(self, client_id: str | None = None) -> int:
        """Open streams, of one client or of all."""
        if client_id is None:
            return len(self._subscriptions)
        return sum(1 for subscription in self._subscriptions if subscription.caller == client_id)

    def unsubscribe(self, subscription: Subscription) -> None:
        """Forget a listener."""
        self._subscriptions.discard(subscription)

    def close(self) -> None:
        """End all streams: the server can only stop when they have."""
        self._is_closed = True
        for due in (self._queue_due, self._again):
            if due is not None:
                due.cancel()
        for subscription in tuple(self._subscriptions):
            subscription.close()
