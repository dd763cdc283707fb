"""Drives the jobs: claim, let each have its turn, record what came of it, start again what was lost.

One task does all of it, one turn after the other. Everyone else only leaves wishes (a cancel, a save) and
wakes it.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Literal

import structlog

from service.dispatch import Candidate, next_job, seconds_left, seconds_until_start
from service.engine import worker
from service.engine.local import LocalEngine, Lost
from service.engine.turn import Failure, Saved, Turn, TurnResult
from service.estimates import EstimateFiles
from service.hub import Hub
from service.messages import ProgressMessage
from service.settings import ServiceSettings
from service.states import IllegalStep, State, Step
from service.store import JobRecord, JobStore, Progress
from service.store.records import iso

# Frames after the last saved one are forgotten when the server dies; their numbers must not come again.
_SEQ_GAP = 1000
_CURVE_LIMIT = 400
_STOP_SECONDS = 1.2  # whoever presses Ctrl-C waits for this; what is not saved by then is rendered again
_TOLD_SECONDS = 7 * 86400.0
_NOT_RUNNING = frozenset({*State} - {State.RUNNING})


@dataclass(slots=True)
class LiveJob:
    """A running job: what is known of it beyond its row."""

    record: JobRecord
    progress: Progress
    checkpoint: str | None
    curve: list[dict[str, float]]
    display_path: Path
    seq: int
    has_picture: bool
    last_turn: int = 0
    wish: Literal[Step.PAUSE, Step.CANCEL] | None = None
    wants_save: bool = False
    changed: asyncio.Event = field(default_factory=asyncio.Event)


class Runner:
    """The running jobs of this server."""

    def __init__(
        self,
        settings: ServiceSettings,
        store: JobStore,
        engine: LocalEngine,
        hub: Hub,
        files: EstimateFiles,
        scene_path: Callable[[JobRecord], str],
    ) -> None:
        self._settings = settings
        self._store = store
        self._engine = engine
        self._hub = hub
        self._files = files
        self._scene_path = scene_path
        self._live: dict[str, LiveJob] = {}
        self._wake = asyncio.Event()
        self._turns = 0
        self._is_stopping = False
        self._task: asyncio.Task[None] | None = None
        self._log = structlog.get_logger("service.runner")
        self.renderer_state: Literal["warm", "starting", "down"] = "starting"

    def live(self, job_id: str) -> LiveJob | None:
        """A running job, or None."""
        return self._live.get(job_id)

    def live_jobs(self) -> list[LiveJob]:
        """All running jobs."""
        return list(self._live.values())

    def wake(self) -> None:
        """Something was queued."""
        self._wake.set()

    def expected_start(self, queue_position: int | None) -> str | None:
        """About when a queued job will start, ISO 8601 in UTC; None while it cannot be told."""
        if queue_position is None:
            return None
        remaining = [_seconds_left(live) for live in self._live.values()]
        seconds = seconds_until_start(queue_position, remaining, self._settings.max_running_jobs)
        if seconds is None or seconds > _TOLD_SECONDS:
            return None
        return iso(datetime.now(UTC) + timedelta(seconds=seconds))

    async def cancel(self, job_id: str) -> None:
        """End a job and keep its picture. Returns once it has ended. Raises JobNotFound, IllegalStep."""
        await self._leave_or_move(job_id, Step.CANCEL, stopped_by="cancelled")

    async def pause(self, job_id: str) -> None:
        """Take a job from the renderer until it is resumed. Raises JobNotFound, IllegalStep."""
        await self._leave_or_move(job_id, Step.PAUSE)

    async def move(self, job_id: str, step: Step, **changes: Any) -> None:
        """A step of a job that does not run. Raises JobNotFound, IllegalStep."""
        await asyncio.to_thread(self._store.move, job_id, step, **changes)
        await self._hub.tell_transitions()
        self._wake.set()

    async def delete(self, job_id: str) -> None:
        """Forget a job and its files. Raises JobNotFound, StillRunning."""
        await asyncio.to_thread(self._store.delete, job_id)
        await self._hub.tell_transitions()
        await asyncio.to_thread(self._files.remove, job_id)

    async def _leave_or_move(self, job_id: str, step: Literal[Step.PAUSE, Step.CANCEL], **changes: Any) -> None:
        while True:
            if (live := self._live.get(job_id)) is not None:
                live.wish = step if live.wish is not Step.CANCEL else Step.CANCEL
                self._wake.set()
                while self._live.get(job_id) is live and not self._is_stopping:
                    await live.changed.wait()
                return
            try:
                await asyncio.to_thread(self._store.move, job_id, step, only_from=_NOT_RUNNING, **changes)
            except IllegalStep as error:
                if error.state is not State.RUNNING:
                    raise
                # It was claimed this very moment: it will be among the live ones in the next.
                await asyncio.sleep(0.02)
            else:
                await self._hub.tell_transitions()
                return

    async def save_now(self, job_id: str) -> None:
        """Have a running job's estimate saved with its next turn, and wait for that."""
        live = self._live.get(job_id)
        if live is None:
            return
        live.wants_save = True
        while live.wants_save and self._live.get(job_id) is live and not self._is_stopping:
            await live.changed.wait()

    async def start(self) -> None:
        """Take up what an earlier server left running, then run."""
        for job in await asyncio.to_thread(self._store.running):
            await asyncio.to_thread(self._store.move, job.id, Step.GIVE_BACK)
            self._log.info("job continues after a restart", job=job.id, spp=round(job.progress.spp, 1))
        await asyncio.to_thread(lambda: self._files.sweep(self._store.checkpoints()))
        self._task = asyncio.create_task(self._run(), name="runner")

    async def stop(self) -> None:
        """Stop after the turn in flight and save what is live; the jobs stay marked as running."""
        self._is_stopping = True
        self._wake.set()
        for live in self._live.values():
            live.changed.set()
        if self._task is not None:
            with contextlib.suppress(TimeoutError, asyncio.CancelledError):
                await asyncio.wait_for(self._task, _STOP_SECONDS)
        self._engine.close()
        self._files.remove_displays()

    async def _run(self) -> None:
        if self._settings.warm_up:
            await self._warm_up()
        else:
            self.renderer_state = "warm"
        while not self._is_stopping:
            try:
                await self._step()
            except Exception:
                # One job's bad luck (a full disk, a locked database) must not end the service.
                self._log.exception("turn failed, going on")
                await asyncio.sleep(1.0)
        for live in self.live_jobs():
            with contextlib.suppress(Lost):
                result = await self._engine.submit(worker.retire, self._turn(live), deadline=_STOP_SECONDS)
                _absorb(live, result)
                if result.saved is not None:
                    await self._save(live, result.saved)

    async def _warm_up(self) -> None:
        try:
            await self._engine.submit(worker.warm_up, deadline=self._settings.turn_deadline_seconds)
            self.renderer_state = "warm"
        except Exception as error:
            # The first job will say what is wrong, to whoever asked for it.
            self.renderer_state = "down"
            self._log.error("renderer did not warm up", cause=str(error))

    async def _step(self) -> None:
        """Let the next job have its turn, or wait until there is one."""
        self._wake.clear()
        for live in self.live_jobs():
            if live.wish is not None:
                await self._leave(live, live.wish)
        if len(self._live) < self._settings.max_running_jobs:
            await self._claim()
        candidates = (
            Candidate(job_id, live.record.number, live.has_picture, live.last_turn)
            for job_id, live in self._live.items()
        )
        job_id = next_job(candidates)
        if job_id is None:
            await self._wake.wait()
        else:
            await self._take_turn(self._live[job_id])

    async def _claim(self) -> None:
        record = await asyncio.to_thread(self._store.claim)
        if record is None:
            return
        self._live[record.id] = LiveJob(
            record=record,
            progress=record.progress,
            checkpoint=record.checkpoint,
            curve=list(record.curve),
            display_path=self._files.display_path(record),
            seq=record.progress.frame_seq + (_SEQ_GAP if record.attempt > 1 else 0),
            has_picture=record.checkpoint is not None,
        )
        self._log.info("job started", job=record.id, scene=record.scene_name, attempt=record.attempt)
        await self._hub.tell_transitions()

    async def _take_turn(self, live: LiveJob) -> None:
        self._turns += 1
        live.last_turn = self._turns
        try:
            result = await self._engine.submit(
                worker.advance, self._turn(live), deadline=self._settings.turn_deadline_seconds
            )
        except Lost as lost:
            await self._start_again(live, str(lost))
            return
        self.renderer_state = "warm"
        if result.failure is not None:
            await self._fail(live, result.failure)
            return
        _absorb(live, result)
        live.has_picture = True
        if result.stopped_by is not None:
            await self._end(live, Step.FINISH, stopped_by=result.stopped_by)
            return
        if result.saved is not None:
            await self._save(live, result.saved)
        self._hub.tell_progress(ProgressMessage.of(live.record, live.progress))
        _notify(live)

    def _turn(self, live: LiveJob) -> Turn:
        record = live.record
        return Turn(
            job_id=record.id,
            attempt=record.attempt,
            scene=self._scene_path(record),
            is_gallery=record.scene_kind == "gallery",
            target=record.target,
            settings=record.settings,
            checkpoint=str(self._files.path(live.checkpoint)) if live.checkpoint else None,
            display_path=str(live.display_path),
            estimates_dir=str(self._files.folder),
            next_seq=live.seq + 1,
            seconds=self._settings.turn_seconds,
            checkpoint_seconds=self._settings.checkpoint_seconds,
            save=live.wants_save,
        )

    async def _save(self, live: LiveJob, saved: Saved) -> None:
        """Name the newly saved estimate together with the progress it holds."""
        curve = [point for point in live.curve if point["seconds"] <= saved.progress.seconds]
        await asyncio.to_thread(self._store.save, live.record, saved.progress, curve, saved.name)
        await asyncio.to_thread(self._files.prune, live.record.id)

    async def _leave(self, live: LiveJob, step: Literal[Step.PAUSE, Step.CANCEL]) -> None:
        """Take a job from the renderer with all that was rendered."""
        try:
            _absorb(live, await self._engine.submit(worker.retire, self._turn(live), deadline=10.0))
        except Lost:
            self._log.warning("job keeps its last saved picture only", job=live.record.id, step=step.value)
        await self._end(live, step, **({"stopped_by": "cancelled"} if step is Step.CANCEL else {}))

    async def _start_again(self, live: LiveJob, why: str) -> None:
        """After a crash: the same job from its last saved estimate, unless it is to blame too often."""
        live.record = await asyncio.to_thread(self._store.count_crash, live.record)
        crashes, limit = live.record.crashes, self._settings.crash_limit
        self._log.warning("job lost its render process", job=live.record.id, crashes=crashes, why=why)
        if crashes < limit:
            return
        failure = Failure(
            title="The render process died",
            detail=f"Rendering was tried {crashes} times, and each time {why}. Other jobs are not affected.",
            hint="The scene may be damaged or too large for the memory: try fewer pixels or a simpler scene.",
        )
        await self._fail(live, failure)

    async def _fail(self, live: LiveJob, failure: Failure) -> None:
        self._log.error("job failed", job=live.record.id, cause=failure.detail, trace=failure.trace)
        cause = {name: text for name, text in asdict(failure).items() if name != "trace"}
        await self._end(live, Step.FAIL, cause=cause)

    async def _end(self, live: LiveJob, step: Step, **changes: Any) -> None:
        """Record that a job runs no longer, with all that is known of it, and let go of it."""
        record = live.record
        changes |= {"progress": live.progress, "curve": live.curve, "checkpoint": live.checkpoint}
        ended = await asyncio.to_thread(self._store.move, record.id, step, warnings=list(record.warnings), **changes)
        del self._live[record.id]
        self._log.info(
            "job left the renderer",
            job=record.id,
            state=ended.state.value,
            stopped_by=ended.stopped_by,
            error=ended.progress.error,
            spp=round(ended.progress.spp, 1),
            seconds=round(ended.progress.seconds, 2),
        )
        await self._hub.tell_transitions()
        _notify(live)
        await asyncio.to_thread(self._files.prune, record.id)
        live.display_path.unlink(missing_ok=True)


def _absorb(live: LiveJob, result: TurnResult) -> None:
    """Note what a turn told."""
    if result.progress is not None:
        live.progress = result.progress
        live.seq = result.progress.frame_seq
    if result.saved is not None:
        live.checkpoint = result.saved.name
        live.wants_save = live.wants_save and result.saved.progress.seconds < live.progress.seconds
    if result.warnings and result.warnings != live.record.warnings:
        live.record = replace(live.record, warnings=result.warnings)
    live.curve.extend(result.curve)
    if len(live.curve) > _CURVE_LIMIT:
        # The convergence chart is logarithmic: of the older points every other one is enough.
        half = len(live.curve) // 2
        live.curve = live.curve[:half:2] + live.curve[half:]


def _seconds_left(live: LiveJob) -> float | None:
    told = live.progress.forecast
    forecast = told.get("seconds_left") if told else None
    return seconds_left(live.record.target, live.progress.seconds, live.progress.spp, forecast)


def _notify(live: LiveJob) -> None:
    """Wake those who wait for this job now; whoever waits later waits for the next change."""
    live.changed.set()
    live.changed.clear()
