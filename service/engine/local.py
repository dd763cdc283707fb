"""One render process on this machine: spawned, watched, replaced.

One call is in the process at a time, so that a crash or a missed deadline has one cause. A replacement is
started by the next call; it knows nothing of its predecessor, which is why every call carries all that it
needs.
"""

from __future__ import annotations

import asyncio
import contextlib
import multiprocessing
import os
import signal
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import TypeVar

import structlog

from service.engine import worker

T = TypeVar("T")


class Lost(Exception):
    """The render process died or was killed during the call: the same call may be made again."""


class LocalEngine:
    """A pool of one spawned process. displays: folder that it removes should its server die."""

    def __init__(self, name: str, displays: Path | None = None) -> None:
        self._displays = displays
        self._pool: ProcessPoolExecutor | None = None
        self._one_at_a_time = asyncio.Lock()
        self._log = structlog.get_logger("service.engine").bind(engine=name)
        self.pid: int | None = None

    async def submit(self, call: Callable[..., T], *args: object, deadline: float) -> T:
        """Run `call(*args)` in the process, within `deadline` seconds.

        Raises Lost, or what the call raised.
        """
        async with self._one_at_a_time:
            try:
                running = asyncio.wrap_future(await self._begin(call, *args))
                # Shielded: on a timeout the process is killed, and the future ends by that.
                return await asyncio.wait_for(asyncio.shield(running), deadline)
            except BrokenProcessPool:
                self._log.warning("render process died", pid=self.pid)
                self._discard()
                raise Lost("the render process died") from None
            except TimeoutError:
                self._log.warning("render process missed its deadline", pid=self.pid, deadline=deadline)
                self._discard()
                raise Lost(f"the render process gave no answer within {deadline:g} s") from None

    async def _begin(self, call: Callable[..., T], *args: object) -> Future[T]:
        """Hand a call to the process. One that died while it had nothing to do is nobody's fault."""
        pool = self._pool or await self._open()
        try:
            return pool.submit(call, *args)
        except BrokenProcessPool:
            self._log.warning("render process died while idle", pid=self.pid)
            self._discard()
            return (await self._open()).submit(call, *args)

    async def _open(self) -> ProcessPoolExecutor:
        context = multiprocessing.get_context("spawn")
        pool = self._pool = ProcessPoolExecutor(
            1, mp_context=context, initializer=worker.begin, initargs=(self._displays,)
        )
        self.pid = await asyncio.wrap_future(pool.submit(os.getpid))
        self._log.info("render process started", pid=self.pid)
        return pool

    def _discard(self) -> None:
        """Kill the process, whatever it is doing, and forget the pool."""
        pool, self._pool = self._pool, None
        pid, self.pid = self.pid, None
        if pid is not None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, getattr(signal, "SIGKILL", signal.SIGTERM))
        if pool is not None:
            pool.shutdown(wait=False, cancel_futures=True)

    def close(self) -> None:
        """End the process at once."""
        self._discard()
