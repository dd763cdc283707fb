"""What is done from time to time: renew leases, forget old events, jobs and scenes."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Callable
from datetime import UTC, datetime, timedelta

import structlog
from sqlalchemy.exc import SQLAlchemyError

from service.metrics import Metrics
from service.quarantine import Quarantine
from service.runner import Runner
from service.settings import ServiceSettings
from service.store import DatabaseReplaced, JobNotFound, JobStore, StillRunning
from service.store.records import iso
from service.store.threads import at_leisure
from service.uploads import Uploads

_AT_ONCE = 100


class Housekeeping:
    """Two tasks that never end by themselves."""

    def __init__(
        self,
        settings: ServiceSettings,
        store: JobStore,
        uploads: Uploads,
        runner: Runner,
        metrics: Metrics,
        quarantine: Quarantine,
    ) -> None:
        self._settings = settings
        self._store = store
        self._uploads = uploads
        self._runner = runner
        self._metrics = metrics
        self._quarantine = quarantine
        self._tasks: list[asyncio.Task[None]] = []
        self._log = structlog.get_logger("service.housekeeping")

    def start(self) -> None:
        """Begin."""
        work = ((self._runner.keep_leases, self._settings.heartbeat_seconds), (self.forget_old, 600.0))
        self._tasks = [asyncio.create_task(self._again_and_again(*one)) for one in work]

    async def stop(self) -> None:
        """End."""
        for task in self._tasks:
            task.cancel()
        for task in self._tasks:
            with contextlib.suppress(asyncio.CancelledError):
                await task

    async def _again_and_again(self, work: Callable[[], Awaitable[None]], seconds: float) -> None:
        while True:
            try:
                await work()
            except DatabaseReplaced:
                pass  # said once, where it was noticed
            except SQLAlchemyError as error:
                self._log.warning("housekeeping waits: the database does not answer", cause=type(error).__name__)
            except Exception:
                self._log.exception("housekeeping failed, trying again later")
                self._metrics.errors.labels("housekeeping").inc()
            await asyncio.sleep(seconds)

    async def forget_old(self) -> None:
        """Delete what is older than its retention."""
        events = await at_leisure(self._store.forget_events, self._before(self._settings.keep_events_days))
        forgotten = 0
        if self._settings.keep_jobs_days is not None:
            before = self._before(self._settings.keep_jobs_days)
            while ids := await at_leisure(self._store.ended_before, before, _AT_ONCE):
                for job_id in ids:
                    # It may have been continued or deleted in between.
                    with contextlib.suppress(JobNotFound, StillRunning):
                        await self._runner.delete(job_id)
                        forgotten += 1
        scenes = 0
        if self._settings.keep_scenes_days is not None:
            scenes = await self._uploads.forget_before(self._before(self._settings.keep_scenes_days))
        days = self._settings.keep_quarantine_days
        put_away = await asyncio.to_thread(self._quarantine.forget_older, days)
        if events or forgotten or scenes or put_away:
            told = {"events": events, "jobs": forgotten, "scenes": scenes, "quarantine": put_away}
            self._log.info("old things forgotten", **told)

    def _before(self, days: float) -> str:
        return iso(datetime.now(UTC) - timedelta(days=days))
