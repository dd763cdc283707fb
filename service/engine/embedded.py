"""The engine that needs nothing installed: render processes of this machine, one per slot."""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from service.engine import kept
from service.engine.interface import Handle, Lost, Slot
from service.engine.local import LocalEngine

_FOR_EVER = 1e9


@dataclass(order=True, slots=True)
class _Call:
    """A call in the order in which it is begun."""

    rank: tuple[int, int]
    handle: Handle = field(compare=False)
    call: Callable[..., Any] = field(compare=False)
    args: tuple[object, ...] = field(compare=False)
    is_brought: bool = field(compare=False)


class _Worker:
    """One slot: its process, and the calls that wait for it."""

    def __init__(self, name: str, displays: Path | None) -> None:
        self.name = name
        self.process = LocalEngine(name, displays)
        self.waiting: asyncio.PriorityQueue[_Call] = asyncio.PriorityQueue()
        self.running: Handle | None = None
        self.load = 0
        self.task: asyncio.Task[None] | None = None


class EmbeddedEngine:
    """Implements `service.engine.interface.Engine`. displays: folder that a process removes should its server die."""

    def __init__(self, names: Sequence[str] = ("render",), displays: Path | None = None) -> None:
        self._workers = {name: _Worker(name, displays) for name in names}
        self._done: dict[Handle, asyncio.Future[Any]] = {}  # with their values, if those are brought
        self._brought: set[Handle] = set()
        self._numbers = itertools.count(1)

    async def start(self) -> None:
        """Begin to take calls; a process is spawned by its first one."""
        for worker in self._workers.values():
            worker.task = asyncio.create_task(self._work(worker), name=f"engine {worker.name}")

    def slots(self) -> Sequence[Slot]:
        """The processes of this machine."""
        return [Slot(name, frozenset({"local"})) for name in self._workers]

    def pids(self) -> list[int]:
        """Processes that live now."""
        return [worker.process.pid for worker in self._workers.values() if worker.process.pid is not None]

    def submit(
        self,
        call: Callable[..., Any],
        *args: object,
        slot: str | None = None,
        priority: int = 0,
        is_brought: bool = False,
    ) -> Handle:
        """Have a call run: on the slot named, where its handles lie, or on the one with least to do."""
        near = slot or next((arg.slot for arg in args if isinstance(arg, Handle)), None)
        worker = self._workers[near] if near else min(self._workers.values(), key=lambda one: one.load)
        handle = Handle(next(self._numbers), worker.name)
        self._done[handle] = asyncio.get_running_loop().create_future()
        if is_brought:
            self._brought.add(handle)
        worker.load += 1
        worker.waiting.put_nowait(_Call((-priority, handle.id), handle, call, args, is_brought))
        return handle

    async def wait(self, handles: Iterable[Handle], seconds: float | None = None) -> set[Handle]:
        """Those that are done; returns once there is one, or after `seconds`."""
        asked = {self._done[handle]: handle for handle in handles}
        done, _ = await asyncio.wait(asked, timeout=seconds, return_when=asyncio.FIRST_COMPLETED)
        return {asked[future] for future in done}

    async def fetch(self, handle: Handle) -> Any:
        """The value, which is then forgotten."""
        is_brought = handle in self._brought
        try:
            value = await self._done[handle]
        finally:
            self._done.pop(handle, None)
            self._brought.discard(handle)
        if is_brought:
            return value
        process = self._workers[handle.slot].process
        is_here, value = await process.submit(kept.take, handle.id, deadline=_FOR_EVER)
        if not is_here:
            raise Lost("the render process died before its result was fetched")
        return value

    async def cancel(self, handle: Handle, *, hard: bool = False) -> None:
        """Do not begin a call that waits; hard: kill the process that runs it too."""
        worker = self._workers[handle.slot]
        if worker.running == handle:
            if hard:
                worker.process.kill()
            return
        if handle in self._done and not self._done[handle].done():
            self._done[handle].cancel()

    async def close(self) -> None:
        """End the processes at once."""
        for worker in self._workers.values():
            worker.process.close()
            if worker.task is not None:
                worker.task.cancel()
        for future in self._done.values():
            future.cancel()

    async def _work(self, worker: _Worker) -> None:
        while True:
            call = await worker.waiting.get()
            try:
                await self._make(worker, call)
            finally:
                # Not before: a slot whose call runs has something to do.
                worker.load -= 1

    async def _make(self, worker: _Worker, call: _Call) -> None:
        done = self._done.get(call.handle)
        if done is None or done.done():
            return
        worker.running = call.handle
        args = tuple(kept.Ref(arg.id) if isinstance(arg, Handle) else arg for arg in call.args)
        try:
            how = (call.handle.id, call.call, args, call.is_brought)
            value = await worker.process.submit(kept.run, *how, deadline=_FOR_EVER)
        except Exception as error:
            if not done.done():
                done.set_exception(error)
                done.exception()  # whoever gave the call up need not fetch it
        else:
            if not done.done():
                done.set_result(value)
        finally:
            worker.running = None
