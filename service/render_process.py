"""The render process as jobs use it: called, warmed up, ended, with what is known of it."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from typing import Any, Literal

import structlog

from service.engine import worker
from service.engine.interface import Engine, Lost, run_within
from service.metrics import Metrics

LEAVE_SECONDS = 10.0


class RenderProcess:
    """One call at a time, made by whoever gives the turns.

    loaded: scenes that it has compiled. is_spoilt: an unexpected exception was raised in it, and it is to be replaced.
    """

    def __init__(self, engine: Engine, metrics: Metrics) -> None:
        self._engine = engine
        self._metrics = metrics
        self._log = structlog.get_logger("service.renderer")
        self.state: Literal["warm", "starting", "down"] = "starting"
        self.loaded: set[str] = set()
        self.is_spoilt = False

    async def start(self) -> None:
        """Bring its engine up; the process itself is started by its first call."""
        await self._engine.start()

    async def close(self) -> None:
        """End it at once."""
        await self._engine.close()

    async def warm_up(self, seconds: float) -> None:
        """Have it import and compile what every job needs."""
        try:
            await self.call(seconds, worker.warm_up)
            self.state = "warm"
        except Exception as error:
            # The first job will say what is wrong, to whoever asked for it.
            self.state = "down"
            self.is_spoilt = True
            self._log.error("renderer did not warm up", cause=str(error))

    async def call(
        self, seconds: float, call: Callable[..., Any], *args: object, given_up: asyncio.Event | None = None
    ) -> Any:
        """Run a call in it. given_up: see `run_within`. Raises Lost."""
        try:
            return await run_within(self._engine, seconds, call, *args, given_up=given_up)
        except Lost:
            self.loaded.clear()
            self._metrics.restarts.inc()
            raise

    async def end(self) -> None:
        """End it; the next call starts another one."""
        with contextlib.suppress(Lost):
            await self.call(LEAVE_SECONDS, worker.end)
        self.is_spoilt = False
