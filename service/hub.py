"""Tells every open page what happens.

Transitions come from the store, in order, none lost; of progress the latest wins.

A client that does not keep up is disconnected once its queue is full: it comes back with its last event id
and the store replays what it missed. So a slow client costs a bounded amount of memory.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import AsyncIterator, Callable

from service import news
from service.messages import ProgressMessage
from service.news import Told
from service.store import EventRecord, JobStore

_PAGE = 200
_QUEUE_LIMIT = 1000


class Subscription:
    """What one client has yet to be told. scope: whose jobs it hears of; None: of all."""

    def __init__(self, caller: str, scope: str | None) -> None:
        self.caller = caller
        self._scope = scope
        self._transitions: deque[Told] = deque()
        self._progress: dict[str, Told] = {}
        self._news = asyncio.Event()
        self._is_closed = False

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
            if not self._is_closed and (told := [*self._transitions, *self._progress.values()]):
                self._transitions.clear()
                self._progress.clear()
                yield told[0].text if len(told) == 1 else b"".join(one.text for one in told)


class Hub:
    """Everyone who listens."""

    def __init__(self, store: JobStore) -> None:
        self._store = store
        # Replaced by who knows when a queued job will start.
        self.expected_start: Callable[[int | None], str | None] = lambda _place: None
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
        """Pass on what is new in the store. One reader at a time keeps the order of the ids."""
        async with self._reading:
            is_more = True
            while is_more:
                events = await asyncio.to_thread(self._store.events_after, self._last_event_id, _PAGE)
                # What is written from here on is told by whoever writes it.
                is_more = len(events) == _PAGE
                if events:
                    self._last_event_id = events[-1].id
                for event in events:
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

    def _transition(self, event: EventRecord) -> Told:
        return news.transition(event, self.expected_start(event.queue_position))

    async def missed(self, after: int, until: int) -> AsyncIterator[Told]:
        """Transitions from `after` (exclusive) to `until` (inclusive), page by page."""
        while after < until:
            events = await asyncio.to_thread(self._store.events_after, after, _PAGE)
            if not events:
                return
            for event in events:
                if event.id > until:
                    return
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
        for subscription in tuple(self._subscriptions):
            subscription.close()
