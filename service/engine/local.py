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
import time
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import TypeVar

import structlog

from service.engine import worker
from service.engine.interface import Lost
from service.engine.reserve import RESERVE

__all__ = ["LocalEngine", "Lost"]

T = TypeVar("T")
_WORDS_BYTES = 4096
_REAP_SECONDS = 2.0


class LocalEngine:
    """A pool of one spawned process. displays: folder that it removes should its server die."""

    def __init__(self, name: str, displays: Path | None = None) -> None:
        self._name = name
        self._displays = displays
        self._pool: ProcessPoolExecutor | None = None
        self._one_at_a_time = asyncio.Lock()
        self._log = structlog.get_logger("service.engine").bind(engine=name)
        self._words: Path | None = None
        self._heard = 0
        self.pid: int | None = None
        self.restarts = -1

    async def submit(self, call: Callable[..., T], *args: object, deadline: float) -> T:
        """Run `call(*args)` in the process, within `deadline` seconds.

        Raises Lost, or what the call raised.
        """
        async with self._one_at_a_time:
            try:
                running = asyncio.wrap_future(await self._begin(call, *args))
                # Shielded: on a timeout the process is killed, and the future ends by that.
                value = await asyncio.wait_for(asyncio.shield(running), deadline)
            except BrokenProcessPool:
                how, words = await asyncio.to_thread(self._how_it_ended), self._new_words()
                self._log.warning("render process died", pid=self.pid, how=how, last_words=words)
                self._discard()
                raise Lost(f"the render process died ({how})", words, was_killed=how == "signal SIGKILL") from None
            except TimeoutError:
                words = self._new_words()
                self._log.warning("render process missed its deadline", pid=self.pid, deadline=deadline)
                self._discard()
                raise Lost(f"the render process gave no answer within {deadline:g} s", words) from None
            if words := self._new_words():
                self._log.warning("render process says", pid=self.pid, words=words)
            return value

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
        self.restarts += 1
        self._heard = 0
        self._words = self._displays / f"{self._name}-{self.restarts}.words" if self._displays else None
        how = {"initializer": worker.begin, "initargs": (self._displays, self._words)}
        pool = self._pool = RESERVE.spending(lambda: ProcessPoolExecutor(1, mp_context=context, **how))
        self.pid = await asyncio.wrap_future(pool.submit(os.getpid))
        self._log.info("render process started", pid=self.pid)
        return pool

    def _processes(self) -> list[BaseProcess]:
        return list((getattr(self._pool, "_processes", None) or {}).values())

    def _how_it_ended(self) -> str:
        """By which signal or exit code."""
        ends = time.monotonic() + _REAP_SECONDS
        for process in self._processes():
            process.join(_REAP_SECONDS)
            # Its pool waits for it too, and only one of the two is told at once.
            while (code := process.exitcode) is None and time.monotonic() < ends:
                time.sleep(0.01)
            if code is not None:
                return f"signal {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
        return "for an unknown reason"

    def _new_words(self) -> str:
        """What the process has written to its error stream since this was last asked, at most its last part."""
        if self._words is None:
            return ""
        with contextlib.suppress(OSError), self._words.open("rb") as file:
            size = file.seek(0, os.SEEK_END)
            if size > self._heard:
                file.seek(max(self._heard, size - _WORDS_BYTES))
                self._heard = size
                return file.read().decode(errors="replace").strip()
        return ""

    def kill(self) -> None:
        """Kill the process, whatever it is doing: the call in it is lost."""
        # Not by self.pid: a process that is still starting has not told it yet.
        for process in self._processes():
            with contextlib.suppress(ProcessLookupError, AttributeError, ValueError):
                process.kill()

    def _discard(self) -> None:
        """Kill the process and forget the pool."""
        self.kill()
        pool, self._pool = self._pool, None
        self.pid = None
        if pool is not None:
            pool.shutdown(wait=False, cancel_futures=True)
        if self._words is not None:
            self._words.unlink(missing_ok=True)

    def close(self) -> None:
        """End the process at once."""
        self._discard()
