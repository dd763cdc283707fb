"""Drives the jobs: claim, let each have its turn, record what came of it, start again what was lost.

One task does all of it, one turn after the other. Everyone else only leaves wishes (a cancel, a save) and
wakes it.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import asdict, replace
from datetime import UTC, datetime, timedelta
from typing import Any, Literal

import structlog

from service.dispatch import Shares, may_start, next_job, seconds_until_start
from service.engine import worker
from service.engine.interface import Engine, Lost, run_within
from service.engine.turn import Failure, Saved, Turn, TurnResult
from service.estimates import EstimateFiles
from service.hub import Hub
from service.lease import Lease
from service.live import LiveJob
from service.messages import ProgressMessage
from service.metrics import Metrics
from service.settings import ServiceSettings
from service.states import IllegalStep, State, Step
from service.store import JobNotFound, JobRecord, JobStore, Superseded
from service.store.records import iso

_LEAVE_SECONDS = 10.0
_TOLD_SECONDS = 7 * 86400.0
_NOT_RUNNING = frozenset({*State} - {State.RUNNING})
# A turn that takes this many times as long as the one before hangs.
_DEADLINE_FACTOR = 10.0
# An exception that nobody foresaw may be the fault of what its process did before: the job is tried in another one.
_SURPRISES = 2
_MOST_QUESTIONS = 32


class Busy(Exception):
    """Too many ask the renderer beside its jobs."""


class Runner:
    """The running jobs of this server."""

    def __init__(
        self,
        settings: ServiceSettings,
        store: JobStore,
        engine: Engine,
        hub: Hub,
        files: EstimateFiles,
        lease: Lease,
        metrics: Metrics,
        scene_path: Callable[[JobRecord], str],
    ) -> None:
        self._settings = settings
        self._store = store
        self._engine = engine
        self._hub = hub
        self._files = files
        self._lease = lease
        self._metrics = metrics
        self._scene_path = scene_path
        self._live: dict[str, LiveJob] = {}
        # Jobs, with their attempts, that only one of database and memory took for running when they were last compared.
        self._astray: frozenset[tuple[str, int]] = frozenset()
        # A call's time begins when it begins: one that waits for another's end is not to be killed for it.
        self._renderer = asyncio.Lock()
        self._question = asyncio.Lock()
        self._questions = 0
        self._shares = Shares()
        self._loaded: set[str] = set()
        self._wake = asyncio.Event()
        self._may_claim = True  # something was queued, or a slot became free, since the queue was last looked at
        self._turns = 0
        self._passing_on: asyncio.Task[None] | None = None  # of what the latest turn led to, while the next one renders
        self._is_spoilt = False  # the render process: an unexpected exception was raised in it
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

    def wake(self, client_id: str | None = None) -> None:
        """Something was queued, by this client if one is given."""
        # Where that client must wait for a slot, there is nothing to look for in a long queue.
        if client_id is None or may_start(client_id, self._running(), self._settings.max_running_jobs):
            self._may_claim = True
            self._wake.set()

    def renew_renderer(self) -> None:
        """Have the render process replaced: an unexpected exception was raised in it."""
        self._is_spoilt = True
        self._wake.set()

    async def ask(self, seconds: float, call: Callable[..., Any], *args: object) -> Any:
        """Run a call beside the jobs: never two before a job has its turn. Raises Busy, Lost."""
        if self._questions >= _MOST_QUESTIONS:
            raise Busy
        self._questions += 1
        try:
            async with self._question:
                return await self._call(seconds, call, *args)
        finally:
            self._questions -= 1

    def expected_start(self, queue_position: int | None) -> str | None:
        """About when a queued job will start, ISO 8601 in UTC; None while it cannot be told."""
        return None if queue_position is None else self.expected_starts([queue_position])[queue_position]

    def expected_starts(self, queue_positions: Iterable[int]) -> dict[int, str | None]:
        """The same for many at once."""
        remaining = [live.seconds_left() for live in self._live.values()]
        at, slots = datetime.now(UTC), self._settings.max_running_jobs
        starts: dict[int, str | None] = {}
        for position in queue_positions:
            seconds = seconds_until_start(position, remaining, slots)
            if seconds is None or seconds > _TOLD_SECONDS:
                starts[position] = None
            else:
                starts[position] = iso(at + timedelta(seconds=seconds))
        return starts

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
        self.wake()

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
                if error.state is not State.RUNNING or self._is_stopping:
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
        for job in await asyncio.to_thread(self._lease.take_up_own):
            self._log.info("job continues after a restart", job=job.id, spp=round(job.progress.spp, 1))
        await asyncio.to_thread(lambda: self._files.sweep(self._store.checkpoints()))
        await self._engine.start()
        self._task = asyncio.create_task(self._run(), name="runner")

    async def stop(self) -> None:
        """Stop after the turn in flight and save what is live; the jobs are queued for the next server."""
        self._is_stopping = True
        self._wake.set()
        for live in self._live.values():
            live.changed.set()
        if self._task is not None:
            with contextlib.suppress(TimeoutError, asyncio.CancelledError):
                await asyncio.wait_for(self._task, self._settings.stop_seconds)
        await self._engine.close()
        self._files.remove_displays()

    async def keep_leases(self) -> None:
        """Renew what runs here, queue what others have lost, and mend where database and memory disagree.

        They do if an answer of the database was lost on its way, or if another server has taken a job up. What is
        only on its way agrees the next time.
        """
        held = await asyncio.to_thread(self._lease.renew)
        here = {live.record.id: live.record.attempt for live in self.live_jobs()}
        astray = frozenset(held.items() ^ here.items())
        for job_id, attempt in astray & self._astray:
            if here.get(job_id) == attempt:
                if (live := self._live.get(job_id)) is not None:
                    self._abandon(live)
            else:
                self._log.warning("job was started, and the answer lost: it is queued again", job=job_id)
                with contextlib.suppress(JobNotFound, IllegalStep, Superseded):
                    await asyncio.to_thread(self._store.move, job_id, Step.GIVE_BACK, attempt=attempt)
        self._astray = astray
        if given := await asyncio.to_thread(self._lease.take_up_expired):
            self._log.warning("jobs of a lost server are queued again", jobs=[job.id for job in given])
        await self._hub.tell_transitions()
        # Others may have queued something in the same database.
        self.wake()

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
                self._metrics.errors.labels("turn").inc()
                await asyncio.sleep(1.0)
        await self._settle()
        for live in self.live_jobs():
            with contextlib.suppress(Lost, Superseded, IllegalStep, JobNotFound):
                live.absorb(await self._call(self._settings.stop_seconds, worker.retire, self._turn(live)))
                await self._let_go(live, Step.GIVE_BACK)

    async def _warm_up(self) -> None:
        try:
            await self._call(self._settings.turn_deadline_seconds, worker.warm_up)
            self.renderer_state = "warm"
        except Exception as error:
            # The first job will say what is wrong, to whoever asked for it.
            self.renderer_state = "down"
            self._is_spoilt = True
            self._log.error("renderer did not warm up", cause=str(error))

    async def _call(self, seconds: float, call: Callable[..., Any], *args: object) -> Any:
        """Run a call in the render process. Raises Lost."""
        try:
            async with self._renderer:
                return await run_within(self._engine, seconds, call, *args)
        except Lost:
            self._loaded.clear()
            self._metrics.restarts.inc()
            raise

    async def _step(self) -> None:
        """Let the next job have its turn, or wait until there is one."""
        self._wake.clear()
        # The renderer waits for nothing but what decides whose turn it is.
        if self._is_spoilt or any(live.wish is not None for live in self._live.values()):
            await self._settle()
        if self._is_spoilt:
            await self._replace_renderer()
        for live in self.live_jobs():
            if live.wish is not None:
                await self._leave(live, live.wish)
        if self._may_claim:
            await self._claim()
        job_id = next_job((live.candidate(self._loaded) for live in self._live.values()), self._shares)
        if job_id is None:
            await self._settle()
            await self._wake.wait()
        else:
            await self._take_turn(self._live[job_id])

    async def _claim(self) -> None:
        """Start the next queued job, if its client may start one now."""
        self._may_claim = False
        queue = await asyncio.to_thread(self._store.queue)
        running = self._running()
        if not queue or not may_start(queue[0].client_id, running, self._settings.max_running_jobs):
            return
        client_id = queue[0].client_id
        record = await asyncio.to_thread(self._lease.claim, client_id)
        self._may_claim = True  # there may be more
        if record is None:
            return
        if running[client_id] == 0:
            self._shares.enter(client_id, running)
        scene = await asyncio.to_thread(self._scene_path, record)
        self._live[record.id] = LiveJob.of(record, self._files.display_path(record), scene)
        if record.progress.frame_seq == 0:
            self._metrics.waits.observe(_seconds_since(record.created_at))
        self._log.info(
            "job started", job=record.id, scene=record.scene_name, attempt=record.attempt, client=client_id or None
        )
        await self._hub.tell_transitions()

    def _running(self) -> Counter[str]:
        """How many jobs of each client run."""
        return Counter(live.record.client_id for live in self._live.values())

    async def _take_turn(self, live: LiveJob) -> None:
        self._turns += 1
        live.last_turn = self._turns
        before, began = live.progress, time.perf_counter()
        # A first turn loads and compiles the scene too: how long that takes is not known.
        expected = _DEADLINE_FACTOR * live.turn_seconds
        try:
            deadline = max(self._settings.turn_deadline_seconds, expected)
            result: TurnResult = await self._call(deadline, worker.advance, self._turn(live))
        except Lost as lost:
            await self._start_again(live, lost)
            return
        finally:
            live.turn_seconds = time.perf_counter() - began
            self._shares.charge(live.record.client_id, live.turn_seconds)
        await self._settle()
        if self._live.get(live.record.id) is not live:
            return  # another server has taken it up meanwhile
        self.renderer_state = "warm"
        self._loaded.add(live.record.scene_ref)
        if result.failure is not None:
            await (self._try_elsewhere if result.failure.is_unexpected else self._fail)(live, result.failure)
            return
        live.absorb(result)
        self._metrics.turn(live.turn_seconds, live.progress.samples - before.samples)
        if not live.has_picture:
            self._metrics.first_pictures.observe(_seconds_since(live.record.created_at))
        live.has_picture = True
        if result.stopped_by is not None:
            await self._end(live, Step.FINISH, stopped_by=result.stopped_by)
            return
        self._passing_on = asyncio.create_task(self._pass_on(live, result.saved), name="pass on a turn")

    async def _pass_on(self, live: LiveJob, saved: Saved | None) -> None:
        """Record what a turn has saved and tell all who listen."""
        try:
            if saved is not None:
                await self._save(live, saved)
        except Exception:
            # The next one that is saved says all that this one did.
            self._log.exception("saved estimate was not recorded, going on", job=live.record.id)
            self._metrics.errors.labels("turn").inc()
        self._hub.tell_progress(ProgressMessage.of(live.record, live.progress), live.record.client_id)
        live.notify()

    async def _settle(self) -> None:
        """Wait until the latest turn is passed on, before anything else befalls a job."""
        if self._passing_on is not None:
            await self._passing_on

    def _turn(self, live: LiveJob) -> Turn:
        record = live.record
        return Turn(
            job_id=record.id,
            attempt=record.attempt,
            scene=live.scene,
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
        curve = [point for point in live.curve if point["spp"] <= saved.progress.spp]
        if await asyncio.to_thread(self._store.save, live.record, saved.progress, curve, saved.name):
            await asyncio.to_thread(self._files.prune, live.record.id)
        else:
            self._abandon(live)

    async def _leave(self, live: LiveJob, step: Literal[Step.PAUSE, Step.CANCEL]) -> None:
        """Take a job from the renderer with all that was rendered."""
        try:
            result: TurnResult = await self._call(_LEAVE_SECONDS, worker.retire, self._turn(live))
            why = result.failure.detail if result.failure is not None else None
            live.absorb(result)
        except Lost as lost:
            why = str(lost)
        if why is not None:
            self._log.warning("job keeps its last saved picture only", job=live.record.id, step=step.value, why=why)
        await self._end(live, step, **({"stopped_by": "cancelled"} if step is Step.CANCEL else {}))

    async def _start_again(self, live: LiveJob, lost: Lost) -> None:
        """After a crash: the same job from its last saved estimate, unless it is to blame too often."""
        try:
            live.record = await asyncio.to_thread(self._store.count_crash, live.record)
        except Superseded:
            self._abandon(live)
            return
        crashes, limit = live.record.crashes, self._settings.crash_limit
        self._log.warning("job lost its render process", job=live.record.id, crashes=crashes, why=str(lost))
        if crashes < limit:
            return
        words = _shown_words(lost.last_words)
        failure = Failure(
            title="The render process died",
            detail=f"Rendering was tried {crashes} times, and each time {lost}. Other jobs are not affected."
            + (f" Its last words: {words}" if words else ""),
            hint="The scene may be damaged or too large for the memory: try fewer pixels or a simpler scene.",
        )
        await self._fail(live, failure)

    async def _try_elsewhere(self, live: LiveJob, failure: Failure) -> None:
        """After an unexpected exception: the same job in a fresh process, from its last saved estimate, once."""
        self._is_spoilt = True
        try:
            live.record = await asyncio.to_thread(self._store.count_crash, live.record)
        except Superseded:
            self._abandon(live)
            return
        crashes = live.record.crashes
        self._log.error("job raised an unexpected exception", job=live.record.id, crashes=crashes, trace=failure.trace)
        if crashes >= min(_SURPRISES, self._settings.crash_limit):
            detail = f"{failure.detail} It was tried {crashes} times, each time in a process of its own."
            await self._fail(live, replace(failure, detail=detail))

    async def _replace_renderer(self) -> None:
        """Save what runs, end the render process; the next call starts another, where all go on as after a pause."""
        self._log.warning("render process is replaced after an unexpected exception")
        for live in self.live_jobs():
            with contextlib.suppress(Lost):  # then it goes on from what was saved before
                result: TurnResult = await self._call(_LEAVE_SECONDS, worker.retire, self._turn(live))
                live.absorb(result)
                if result.saved is not None:
                    await self._save(live, result.saved)
        with contextlib.suppress(Lost):
            await self._call(_LEAVE_SECONDS, worker.end)
        self._is_spoilt = False

    async def _fail(self, live: LiveJob, failure: Failure) -> None:
        self._log.error("job failed", job=live.record.id, cause=failure.detail, trace=failure.trace)
        cause = {name: text for name, text in asdict(failure).items() if name != "trace"}
        await self._end(live, Step.FAIL, cause=cause)

    async def _end(self, live: LiveJob, step: Step, **changes: Any) -> None:
        """Record that a job runs no longer, and remove the files it needs no more."""
        try:
            ended = await self._let_go(live, step, **changes)
        except (Superseded, IllegalStep, JobNotFound):
            self._abandon(live)
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
        await asyncio.to_thread(self._files.keep_only, ended.id, ended.checkpoint)
        live.display_path.unlink(missing_ok=True)

    async def _let_go(self, live: LiveJob, step: Step, **changes: Any) -> JobRecord:
        """Record a step together with all that is known of the job. Raises Superseded."""
        record = live.record
        kept = live.kept()
        curve = [point for point in live.curve if point["spp"] <= kept.spp]
        changes |= {"progress": kept, "curve": curve, "checkpoint": live.checkpoint}
        changes["warnings"] = list(record.warnings)
        moved = await asyncio.to_thread(self._store.move, record.id, step, attempt=record.attempt, **changes)
        self._live.pop(record.id, None)
        self._may_claim = True
        await self._hub.tell_transitions()
        live.notify()
        return moved

    def _abandon(self, live: LiveJob) -> None:
        """The database has it otherwise, often because another server has taken it up: what is here counts no more."""
        self._log.warning("job is not this server's any more", job=live.record.id)
        if self._live.get(live.record.id) is live:
            del self._live[live.record.id]
        self._may_claim = True
        live.notify()


def _seconds_since(moment: str) -> float:
    return max(0.0, (datetime.now(UTC) - datetime.fromisoformat(moment)).total_seconds())


def _shown_words(words: str) -> str:
    """The last line with anything in it, short, without the folders of this machine."""
    lines = [line.strip() for line in words.splitlines() if line.strip()]
    kept = next((line for line in reversed(lines) if not line.startswith(("File ", "Thread ", "Extension "))), "")
    return " ".join(part.rpartition("/")[2] if "/" in part else part for part in kept.split())[:300]
