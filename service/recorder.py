"""What becomes of running jobs, written down: saved estimates, ends, losses, and who is told.

Whatever the database refuses, because another server has the job by now, makes the job here count no more.
"""

from __future__ import annotations

import asyncio
from dataclasses import asdict
from typing import Any

import structlog
from sqlalchemy.exc import SQLAlchemyError

from service.engine.turn import Failure, Start
from service.estimates import EstimateFiles
from service.hub import Hub
from service.live import LiveJob
from service.messages import ProgressMessage
from service.metrics import Metrics
from service.room import is_full
from service.running import RunningJobs
from service.shown import shown
from service.states import ENDED, IllegalStep, Step, destination
from service.store import JobNotFound, JobRecord, JobStore, Kept, Progress, Superseded
from service.store.threads import writing


class Recorder:
    """Writes what came of turns into the database, and tells all who listen."""

    def __init__(self, store: JobStore, files: EstimateFiles, hub: Hub, metrics: Metrics, running: RunningJobs) -> None:
        self._store = store
        self._files = files
        self._hub = hub
        self._metrics = metrics
        self._running = running
        self._log = structlog.get_logger("service.recorder")

    async def save(self, live: LiveJob) -> None:
        """Name the newest saved estimate together with the progress it holds."""
        saved, earlier = (*live.kept, None, None)[:2]
        anew = Progress(frame_seq=live.seq, replicate_size=live.progress.replicate_size)
        progress = saved.progress if saved is not None else anew
        curve = [point for point in live.curve if point["spp"] <= progress.spp]
        named = (saved.name, saved.digest) if saved is not None else (None, None)
        if await writing(self._store.save, live.record, progress, curve, *named, earlier):
            await asyncio.to_thread(self._files.prune, live.record.id)
        else:
            self.abandon(live)

    async def pass_on(self, live: LiveJob, saved: Kept | None) -> None:
        """Record what a turn has saved and tell all who listen."""
        try:
            if saved is not None:
                await self.save(live)
        except Exception as error:
            # The next one that is saved says all that this one did.
            if is_full(error):
                self._log.warning("no room to record a saved estimate, going on", job=live.record.id)
            elif isinstance(error, SQLAlchemyError):
                cause = type(error).__name__
                self._log.warning("saved estimate was not recorded, going on", job=live.record.id, cause=cause)
            else:
                self._log.exception("saved estimate was not recorded, going on", job=live.record.id)
            self._metrics.errors.labels("turn").inc()
        self._hub.tell_progress(ProgressMessage.of(live.record, live.progress), live.record.client_id)
        live.notify()

    async def note_losses(self, live: LiveJob, start: Start, losses: tuple[str, ...]) -> None:
        """A run began from less than was saved: say so in the job, and put away what was damaged."""
        self._log.error("saved estimates are damaged", job=live.record.id, losses=losses)
        # First the row, which must not name what is gone.
        await self.save(live)
        for kept, why in start.damaged:
            await asyncio.to_thread(self._files.put_away, kept.name, why)

    async def fail(self, live: LiveJob, failure: Failure) -> None:
        """End a job with a cause that people can read."""
        self._log.error("job failed", job=live.record.id, cause=failure.detail, trace=failure.trace)
        cause = {name: shown(text) for name, text in asdict(failure).items() if name != "trace"}
        await self.end(live, Step.FAIL, cause=cause)

    async def end(self, live: LiveJob, step: Step, **changes: Any) -> None:
        """Record that a job runs no longer, and remove the files it needs no more."""
        try:
            ended = await self.let_go(live, step, **changes)
        except (Superseded, IllegalStep, JobNotFound):
            self.abandon(live)
            return
        self._metrics.ended.labels(ended.state.value).inc()
        self._log.info(
            "job left the renderer",
            job=ended.id,
            state=ended.state.value,
            stopped_by=ended.stopped_by,
            error=ended.progress.error,
            spp=round(ended.progress.spp, 1),
            seconds=round(ended.progress.seconds, 2),
        )
        await asyncio.to_thread(self._files.keep_only, ended.id, {one.name for one in ended.kept})
        live.display_path.unlink(missing_ok=True)

    async def let_go(self, live: LiveJob, step: Step, **changes: Any) -> JobRecord:
        """Record a step together with all that is known of the job. Raises Superseded."""
        record = live.record
        lasting = live.lasting()
        newest, earlier = (*live.kept, None, None)[:2]
        changes |= {"progress": lasting, "curve": [point for point in live.curve if point["spp"] <= lasting.spp]}
        changes |= {"checkpoint": newest and newest.name, "checkpoint_digest": newest and newest.digest}
        # What has ended is on disk as a whole; what goes on may need the one before.
        changes["earlier"] = None if destination(step) in ENDED else earlier
        changes |= {"warnings": list(record.warnings), "losses": list(record.losses) or None}
        moved = await writing(self._store.move, record.id, step, attempt=record.attempt, **changes)
        self._running.drop(live)
        await self._hub.tell_transitions()
        live.notify()
        return moved

    def abandon(self, live: LiveJob) -> None:
        """The database has it otherwise, often because another server has taken it up: what is here counts no more."""
        self._log.warning("job is not this server's any more", job=live.record.id)
        self._running.drop(live)
        live.notify()
