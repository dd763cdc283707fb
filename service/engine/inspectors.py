"""The processes that check uploaded scenes, and who has one: each client one at a time, in a queue of its own.

So a client whose scenes take long makes itself wait and nobody else, as long as there are no more such clients than
processes. Each process has folders of its own, the only ones of this service that it can see.
"""

from __future__ import annotations

import asyncio
import shutil
from collections import deque
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

import structlog

from service.engine import inspection, sandbox
from service.engine.local import LocalEngine
from service.engine.turn import SceneFacts

AT_ONCE = 3
_WAITING = 20  # uploads of one client
_IDLE_SECONDS = 60.0
_LOADING_SECONDS = 60.0  # to start a process and import the renderer, on a busy machine


class TooManyWaiting(Exception):
    """One client's uploads wait in a line that is long enough."""


class Inspector:
    """One such process, started when it is needed. incoming: where what it is to look at is put."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.incoming = folder / "incoming"
        self._engine = LocalEngine("inspect")
        self._prepared: int | None = None  # pid of the process that is
        self._idle: asyncio.TimerHandle | None = None
        self._log = structlog.get_logger("service.uploads")

    def prepare(self) -> None:
        """Make its folders; what a killed server left in them goes. Synchronous."""
        shutil.rmtree(self.incoming, ignore_errors=True)
        for name in ("incoming", "empty", "home"):
            (self._folder / name).mkdir(parents=True, exist_ok=True)

    async def run(self, call: Callable[..., SceneFacts], *arguments: object, seconds: float, bytes_: int) -> SceneFacts:
        """What the call finds out about a scene, in a process that may grow by twice `bytes_`. Raises Lost."""
        if self._engine.pid is None or self._engine.pid != self._prepared:
            await self._start(bytes_)
        facts = await self._engine.submit(call, *arguments, deadline=seconds)
        if facts.failure is not None and facts.failure.is_unexpected:
            self._engine.close()  # the next scene is checked in a fresh process
        return facts

    async def _start(self, bytes_: int) -> None:
        """Start the process; where it cannot start with files and calls given up, say so and let it keep them."""
        try:
            lacks = await self._prepare(bytes_, is_confined=True)
        except Exception as error:
            self._engine.close()
            lacks = [f"the process keeps its files and calls (without them: {str(error)[:200]})"]
            lacks += await self._prepare(bytes_, is_confined=False)
        self._prepared = self._engine.pid
        for lack in lacks:
            self._log.warning("scenes are checked without full confinement", lack=lack)

    async def _prepare(self, bytes_: int, *, is_confined: bool) -> list[str]:
        how = (str(self._folder), bytes_, is_confined)
        return await self._engine.submit(inspection.prepare, *how, deadline=_LOADING_SECONDS)

    def rest(self) -> None:
        """Nobody needs it: end the process after a while."""
        self._idle = asyncio.get_running_loop().call_later(_IDLE_SECONDS, self._engine.close)

    def wake(self) -> None:
        """Somebody needs it."""
        if self._idle is not None:
            self._idle.cancel()

    def close(self) -> None:
        """End the process."""
        self.wake()
        self._engine.close()


class Inspectors:
    """All of them. folder: where theirs lie."""

    def __init__(self, folder: Path, at_once: int = AT_ONCE) -> None:
        self._all = [Inspector(folder / f"{i}") for i in range(at_once)]
        self._free = list(reversed(self._all))  # the last one used is the next: its process is warm
        self._served: set[str] = set()
        self._waiting: dict[str, deque[asyncio.Future[Inspector]]] = {}  # in the order in which clients have their turn

    def prepare(self) -> None:
        """Make their folders, and say what the system cannot keep them from. Synchronous."""
        for inspector in self._all:
            inspector.prepare()
        for what in sandbox.missing():
            structlog.get_logger("service.uploads").warning("scenes are checked without full confinement", lack=what)

    @asynccontextmanager
    async def turn(self, client: str) -> AsyncIterator[Inspector]:
        """An inspector for one scene of a client, once it is its turn. Raises TooManyWaiting."""
        inspector = await self._wait(client)
        inspector.wake()
        try:
            yield inspector
        finally:
            inspector.rest()
            self._served.discard(client)
            if (places := self._waiting.pop(client, None)) is not None:
                self._waiting[client] = places  # behind the others: it had its turn
            self._free.append(inspector)
            self._give()

    async def _wait(self, client: str) -> Inspector:
        waiting = self._waiting.setdefault(client, deque())
        if len(waiting) >= _WAITING:
            raise TooManyWaiting
        place: asyncio.Future[Inspector] = asyncio.get_running_loop().create_future()
        waiting.append(place)
        self._give()
        try:
            return await place
        except asyncio.CancelledError:
            if place.done() and not place.cancelled():  # given at the same moment
                self._served.discard(client)
                self._free.append(place.result())
                self._give()
            raise

    def _give(self) -> None:
        """Hand free inspectors to clients that have none, in turn."""
        while self._free:
            client = next((one for one in self._waiting if one not in self._served), None)
            if client is None:
                return
            places = self._waiting.pop(client)
            place = places.popleft()
            if places:
                self._waiting[client] = places  # behind the others
            if not place.cancelled():
                self._served.add(client)
                place.set_result(self._free.pop())

    def close(self) -> None:
        """End the processes."""
        for inspector in self._all:
            inspector.close()
