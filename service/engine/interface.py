"""What the service needs of a place where rendering runs: seven methods.

A handle is opaque, and its value stays near the worker until it is fetched; arguments may be handles. A lost call may
be made again with the same inputs: what is rendered depends on nothing else. An engine keeps no truth: all that must
outlive it is in the store and in files.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol


class Lost(Exception):
    """The worker died or was killed during the call: the same call may be made again.

    last_words: what the worker wrote to its error stream before it died, for the log. was_killed: from outside, by who
    makes room or ends processes; nothing that it was given does that.
    """

    def __init__(self, message: str, last_words: str = "", *, was_killed: bool = False) -> None:
        self.last_words = last_words
        self.was_killed = was_killed
        super().__init__(message)


@dataclass(frozen=True, slots=True)
class Slot:
    """A worker that runs one call at a time. tags: what it is, such as its device; equal tags render equal bits."""

    name: str
    tags: frozenset[str]


@dataclass(frozen=True, slots=True)
class Handle:
    """A call and, once it is done, its value, which lies on a slot."""

    id: int
    slot: str


class Engine(Protocol):
    """Where calls run."""

    async def start(self) -> None:
        """Bring the workers up."""
        ...

    def slots(self) -> Sequence[Slot]:
        """The workers there are now."""
        ...

    def submit(
        self,
        call: Callable[..., Any],
        *args: object,
        slot: str | None = None,
        priority: int = 0,
        is_brought: bool = False,
    ) -> Handle:
        """Have `call(*args)` run, higher priority first, on a given slot or on any.

        is_brought: the value comes as soon as there is one instead of staying with the worker, which is quicker to
        fetch; the handle is then no argument for other calls.
        """
        ...

    async def wait(self, handles: Iterable[Handle], seconds: float | None = None) -> set[Handle]:
        """Those that are done, failed or lost; returns once there is one, or after `seconds`."""
        ...

    async def fetch(self, handle: Handle) -> Any:
        """The value, which the engine then forgets. Raises Lost, CancelledError, or what the call raised."""
        ...

    async def cancel(self, handle: Handle, *, hard: bool = False) -> None:
        """Do not begin a call that waits; hard: kill the worker that runs it too."""
        ...

    async def close(self) -> None:
        """End the workers at once."""
        ...


# How much longer a call may take once nobody wants its value any more.
PATIENCE_SECONDS = 3.0


async def run_within(
    engine: Engine,
    seconds: float,
    call: Callable[..., Any],
    *args: object,
    slot: str | None = None,
    given_up: asyncio.Event | None = None,
) -> Any:
    """The value of `call(*args)`; a call that takes longer is killed with its worker. Raises Lost.

    given_up: once it is set, the call has PATIENCE_SECONDS left.
    """
    handle = engine.submit(call, *args, slot=slot, is_brought=True)
    if not await _is_done(engine, handle, seconds, given_up):
        await engine.cancel(handle, hard=True)
        if given_up is not None and given_up.is_set():
            raise Lost("the render process was ended: its turn was not wanted any more")
        raise Lost(f"the render process gave no answer within {seconds:g} s")
    return await engine.fetch(handle)


async def _is_done(engine: Engine, handle: Handle, seconds: float, given_up: asyncio.Event | None) -> bool:
    if given_up is None:
        return bool(await engine.wait([handle], seconds))
    done = asyncio.ensure_future(engine.wait([handle], seconds))
    wished = asyncio.ensure_future(given_up.wait())
    try:
        await asyncio.wait({done, wished}, return_when=asyncio.FIRST_COMPLETED)
        if not done.done():
            await asyncio.wait({done}, timeout=PATIENCE_SECONDS)
        return done.done() and bool(done.result())
    finally:
        done.cancel()
        wished.cancel()
