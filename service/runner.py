"""Drives the jobs: claim, let each have its turn, record what came of it, start again what was lost.

One task does all of it, one turn after the other. Everyone else only leaves wishes (a cancel, a save) and
wakes it.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Awaitable, Callable, Iterable
from datetime import UTC, datetime
from typing import Any, Literal

import structlog
from sqlalchemy.exc import SQLAlchemyError

from service.admission import Admission
from service.crashes import failure_of_losses, failure_of_surprises, turn_deadline
from service.dispatch import Shares, may_start, next_job
from service.engine import worker
from service.engine.interface import Engine, Lost
from service.engine.turn import Failure, OnCluster, Turn, TurnResult
from service.estimates import EstimateFiles
from service.hub import Hub
from service.lease import Lease
from service.live import LiveJob
from service.metrics import Metrics
from service.questions import Busy, Question, Questions
from service.recorder import Recorder
from service.render_process import LEAVE_SECONDS, RenderProcess
from service.room import Disk, is_full
from service.running import RunningJobs
from service.settings import ServiceSettings
from service.states import IllegalStep, State, Step
from service.store import (
    DatabaseReplaced,
    JobNotFound,
    JobRecord,
    JobStore,
    SceneDamaged,
    Superseded,
)
from service.store.threads import reading, writing

_LOOK_FOR_ROOM_SECONDS, _TRY_AGAIN_SECONDS = 1.0, 5.0
_NOT_RUNNING = frozenset({*State} - {State.RUNNING})
_QUESTION_SECONDS = 60.0  # that a question may wait for its turn


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
        scene_path: Callable[[JobRecord], Awaitable[str]],
        disk: Disk,
        admission: Admission,
    ) -> None:
        self._settings = settings
        self._store = store
        self._renderer = RenderProcess(engine, metrics)
        self._hub = hub
        self._files = files
        gate = str(files.displays / "gate")
        self._cluster = None if settings.cluster is None else OnCluster(gate, str(settings.scenes_dir))
        self._lease = lease
        self._metrics = metrics
        self._scene_path = scene_path
        self._disk = disk
        self._admission = admission
        self._running = RunningJobs()
        self._recorder = Recorder(store, files, hub, metrics, self._running)
        # Jobs, with their attempts, that only one of database and memory took for running when they were last compared.
        self._astray: frozenset[tuple[str, int]] = frozenset()
        self._questions = Questions()
        self._shares = Shares()
        self._wake = asyncio.Event()
        self._turns = 0
        self._passing_on: asyncio.Task[None] | None = None  # of what the latest turn led to, while the next one renders
        self._is_stopping = False
        self._task: asyncio.Task[None] | None = None
        self._log = structlog.get_logger("service.runner")

    @property
    def renderer_state(self) -> Literal["warm", "starting", "down"]:
        """How the render process is."""
        return self._renderer.state

    def live(self, job_id: str) -> LiveJob | None:
        """A running job, or None."""
        return self._running.get(job_id)

    def live_jobs(self) -> list[LiveJob]:
        """All running jobs."""
        return self._running.all()

    def wake(self, client_id: str | None = None) -> None:
        """Something was queued, by this client if one is given."""
        # Where that client must wait for a slot, there is nothing to look for in a long queue.
        if client_id is None or may_start(client_id, self._running.by_client(), self._settings.max_running_jobs):
            self._running.may_claim = True
            self._wake.set()

    def renew_renderer(self) -> None:
        """Have the render process replaced: an unexpected exception was raised in it."""
        self._renderer.is_spoilt = True
        self._wake.set()

    async def ask(self, client_id: str, seconds: float, call: Callable[..., Any], *args: object) -> Any:
        """Run a call beside the jobs, in a turn of its own that is charged to the client. Raises Busy, Lost."""
        question = Question(client_id, seconds, call, args, asyncio.get_running_loop().create_future())
        if client_id not in self._questions.clients() and self._running.by_client()[client_id] == 0:
            self._shares.enter(client_id, self._running.by_client())
        self._questions.add(question, self._running.least_seconds(client_id))
        self._wake.set()
        try:
            async with asyncio.timeout(_QUESTION_SECONDS + seconds):
                return await question.answer
        except TimeoutError:
            raise Busy from None

    async def _answer(self, question: Question) -> None:
        """Let a question have its turn."""
        began = time.perf_counter()
        try:
            value = await self._renderer.call(question.seconds, question.call, *question.args)
        except Exception as error:
            if not question.answer.done():
                question.answer.set_exception(error)
        else:
            if not question.answer.done():
                question.answer.set_result(value)
        finally:
            seconds = time.perf_counter() - began
            self._shares.charge(question.client_id, seconds)
            self._questions.charge(question.client_id, seconds)

    def expected_start(self, queue_position: int | None) -> str | None:
        """About when a queued job will start, ISO 8601 in UTC; None while it cannot be told."""
        return None if queue_position is None else self.expected_starts([queue_position])[queue_position]

    def expected_starts(self, queue_positions: Iterable[int]) -> dict[int, str | None]:
        """The same for many at once."""
        return self._running.expected_starts(queue_positions, self._settings.max_running_jobs)

    async def cancel(self, job_id: str) -> None:
        """End a job and keep its picture. Returns once it has ended. Raises JobNotFound, IllegalStep."""
        await self._leave_or_move(job_id, Step.CANCEL, stopped_by="cancelled")

    async def pause(self, job_id: str) -> None:
        """Take a job from the renderer until it is resumed. Raises JobNotFound, IllegalStep."""
        await self._leave_or_move(job_id, Step.PAUSE)

    async def move(self, job_id: str, step: Step, **changes: Any) -> None:
        """A step of a job that does not run. Raises JobNotFound, IllegalStep."""
        await writing(self._store.move, job_id, step, **changes)
        await self._hub.tell_transitions()
        self.wake()

    async def delete(self, job_id: str) -> None:
        """Forget a job and its files. Raises JobNotFound, StillRunning."""
        await writing(self._store.delete, job_id)
        await self._hub.tell_transitions()
        await asyncio.to_thread(self._files.remove, job_id)

    async def _leave_or_move(self, job_id: str, step: Literal[Step.PAUSE, Step.CANCEL], **changes: Any) -> None:
        while True:
            if (live := self._running.get(job_id)) is not None:
                live.wish = step if live.wish is not Step.CANCEL else Step.CANCEL
                if step is Step.CANCEL:
                    live.given_up.set()  # a turn that takes long is ended
                self._wake.set()
                while self._running.get(job_id) is live and not self._is_stopping:
                    await live.changed.wait()
                return
            try:
                await writing(self._store.move, job_id, step, only_from=_NOT_RUNNING, **changes)
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
        live = self._running.get(job_id)
        if live is None:
            return
        live.wants_save = True
        while live.wants_save and live.unsaved is None and self._running.get(job_id) is live and not self._is_stopping:
            await live.changed.wait()

    async def start(self) -> None:
        """Take up what an earlier server left running, then run."""
        for job in await asyncio.to_thread(self._lease.take_up_own):
            self._log.info("job continues after a restart", job=job.id, spp=round(job.progress.spp, 1))
        await asyncio.to_thread(lambda: self._files.sweep(self._store.checkpoints()))
        await self._renderer.start()
        self._task = asyncio.create_task(self._run(), name="runner")

    async def stop(self) -> None:
        """Stop after the turn in flight and save what is live; the jobs are queued for the next server."""
        self._is_stopping = True
        self._wake.set()
        for live in self._running.all():
            live.changed.set()
        if self._task is not None:
            try:
                with contextlib.suppress(TimeoutError, asyncio.CancelledError):
                    await asyncio.wait_for(self._task, self._settings.stop_seconds)
            except Exception as error:  # the database is gone: what ran keeps its last recorded estimate
                self._log.error("what ran could not be recorded at the end", cause=f"{type(error).__name__}: {error}")
        await self._renderer.close()
        self._files.remove_displays()

    async def keep_leases(self) -> None:
        """Renew what runs here, queue what others have lost, and mend where database and memory disagree.

        They do if an answer of the database was lost on its way, or if another server has taken a job up. What is
        only on its way agrees the next time.
        """
        held = await writing(self._lease.renew)
        here = {live.record.id: live.record.attempt for live in self._running.all()}
        astray = frozenset(held.items() ^ here.items())
        for job_id, attempt in astray & self._astray:
            if here.get(job_id) == attempt:
                if (live := self._running.get(job_id)) is not None:
                    self._recorder.abandon(live)
            else:
                self._log.warning("job was started, and the answer lost: it is queued again", job=job_id)
                with contextlib.suppress(JobNotFound, IllegalStep, Superseded):
                    await writing(self._store.move, job_id, Step.GIVE_BACK, attempt=attempt)
        self._astray = astray
        if given := await writing(self._lease.take_up_expired):
            self._log.warning("jobs of a lost server are queued again", jobs=[job.id for job in given])
        await self._hub.tell_transitions()
        # Others may have queued something in the same database.
        self.wake()

    async def _run(self) -> None:
        if self._settings.warm_up:
            await self._renderer.warm_up(self._settings.turn_deadline_seconds)
        else:
            self._renderer.state = "warm"
        while not self._is_stopping:
            try:
                await self._step()
            except DatabaseReplaced:
                # What is rendered now could not be recorded.
                await asyncio.sleep(1.0)
            except Exception as error:
                # One job's bad luck (a full disk, a locked database) must not end the service.
                if is_full(error):
                    self._log.warning("no room to record what was rendered, going on once there is", cause=str(error))
                    await asyncio.sleep(_LOOK_FOR_ROOM_SECONDS)
                    continue
                self._log.exception("turn failed, going on")
                self._metrics.errors.labels("turn").inc()
                await asyncio.sleep(1.0)
        await self._settle()
        for live in self._running.all():
            with contextlib.suppress(Lost, Superseded, IllegalStep, JobNotFound, SQLAlchemyError):
                live.absorb(await self._renderer.call(self._settings.stop_seconds, worker.retire, self._turn(live)))
                await self._recorder.let_go(live, Step.GIVE_BACK)

    async def _step(self) -> None:
        """Let the next job have its turn, or wait until there is one."""
        self._wake.clear()
        self._store.check_presence()
        # The renderer waits for nothing but what decides whose turn it is.
        if self._renderer.is_spoilt or any(live.wish is not None for live in self._running.all()):
            await self._settle()
        if self._renderer.is_spoilt:
            await self._replace_renderer()
        for live in self._running.all():
            if live.wish is not None:
                await self._leave(live, live.wish)
        if self._running.may_claim or self._admission.is_due:
            try:
                await self._claim()
            except SQLAlchemyError as error:
                if is_full(error):
                    raise
                # Those that run need no database; housekeeping wakes this once it answers again.
                self._log.warning("no job can be started: the database does not answer", cause=type(error).__name__)
        may_go_on = [live for live in self._running.all() if not self._waits(live)]
        jobs = [live.candidate(self._renderer.loaded) for live in may_go_on]
        priorities: dict[str, int] = {}
        for job in jobs:
            priorities[job.client_id] = max(job.priority, priorities.get(job.client_id, job.priority))
        chosen = next_job([*jobs, *self._questions.candidates(priorities)], self._shares)
        if chosen is None:
            await self._settle()
            # Nobody tells when there is room again.
            is_waiting = self._admission.waits or len(may_go_on) < len(self._running.all())
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._wake.wait(), _LOOK_FOR_ROOM_SECONDS if is_waiting else None)
            return
        self._turns += 1
        if (question := self._questions.take(chosen, self._turns)) is not None:
            await self._answer(question)
        else:
            await self._take_turn(self._running.of(chosen))

    async def _claim(self) -> None:
        """Start the next queued job, if there is one that may start now."""
        self._running.may_claim = False
        found = await reading(self._admission.look, self.clients())
        if found.job is None:
            return
        running, client_id = self._running.by_client(), found.job.client_id
        record = await writing(self._lease.claim, client_id, frozenset(found.passed))
        self._running.may_claim = True  # there may be more
        if record is None:
            return
        if running[client_id] == 0 and client_id not in self._questions.clients():
            self._shares.enter(client_id, running)
        seconds = self._running.least_seconds(client_id)
        live = LiveJob.of(record, self._files.display_path(record))
        self._running.add(live)
        live.seconds = seconds
        try:
            live.scene = await self._scene_path(record)
        except SQLAlchemyError:
            self._recorder.abandon(live)  # housekeeping finds that nobody runs it, and queues it again
            raise
        except SceneDamaged as damaged:
            hint = "Upload the same scene again, which puts its files back; then continue this job."
            await self._recorder.fail(live, Failure("The scene's files are damaged", f"{damaged}.".capitalize(), hint))
            return
        if record.progress.frame_seq == 0:
            self._metrics.waits.observe(_seconds_since(record.created_at))
        self._log.info(
            "job started", job=record.id, scene=record.scene_name, attempt=record.attempt, client=client_id or None
        )
        await self._hub.tell_transitions()

    def _waits(self, live: LiveJob) -> bool:
        """Whether a job must wait for room to save what it has."""
        if live.unsaved is None:
            return False
        live.shortage = self._disk.shortage(live.unsaved.needed_bytes)
        # Room that a quota or another limit still denies: it is tried again now and then.
        return live.shortage is not None or time.monotonic() < live.tried_at + _TRY_AGAIN_SECONDS

    def waits_for(self, job: JobRecord) -> str | None:
        """What a job waits for, beside its turn: room on disk or memory; None if nothing is in its way."""
        if (live := self._running.get(job.id)) is not None:
            if live.unsaved is None:
                return None
            return live.shortage.waits_for if live.shortage else f"waits to be saved: {live.unsaved.reason}"
        shortage = self._admission.shortage_of(job.id) if job.state is State.QUEUED else None
        return shortage.waits_for if shortage is not None else None

    def clients(self) -> dict[str, str]:
        """Whose the running jobs are, by job."""
        return self._running.clients()

    async def _take_turn(self, live: LiveJob) -> None:
        live.last_turn = self._turns
        before, began = live.progress, time.perf_counter()
        # Not what is left over of a turn that was lost: it says nothing about the next one.
        deadline = turn_deadline(self._settings.turn_deadline_seconds, live.turn_seconds)
        live.turn_seconds = None
        try:
            result: TurnResult = await self._renderer.call(
                deadline, worker.advance, self._turn(live), given_up=live.given_up
            )
        except Lost as lost:
            if live.wish is not Step.CANCEL:
                await self._start_again(live, lost)
            return
        finally:
            seconds = time.perf_counter() - began
            live.seconds += seconds
            self._shares.charge(live.record.client_id, seconds)
        live.turn_seconds = seconds
        await self._settle()
        if self._running.get(live.record.id) is not live:
            return  # another server has taken it up meanwhile
        self._renderer.state = "warm"
        self._renderer.loaded.add(live.record.loaded_scene)
        if result.failure is not None:
            await (self._try_elsewhere if result.failure.is_unexpected else self._recorder.fail)(live, result.failure)
            return
        if result.start is not None and (losses := live.begin(result.start)):
            await self._recorder.note_losses(live, result.start, losses)
        live.absorb(result)
        if live.unsaved is not None:
            live.tried_at = time.monotonic()
            reason = live.unsaved.reason
            self._log.warning("job waits for room to be saved", job=live.record.id, reason=reason)
        self._metrics.turn(seconds, live.progress.samples - before.samples)
        if result.progress is not None and not live.has_picture:
            self._metrics.first_pictures.observe(_seconds_since(live.record.created_at))
            live.has_picture = True
        if not live.has_picture:
            live.wants_save = False  # there is nothing to save yet, and whoever waits for it is told so
        if result.stopped_by is not None:
            await self._recorder.end(live, Step.FINISH, stopped_by=result.stopped_by)
            return
        self._passing_on = asyncio.create_task(self._recorder.pass_on(live, result.saved), name="pass on a turn")

    async def _settle(self) -> None:
        """Wait until the latest turn is passed on, before anything else befalls a job."""
        if self._passing_on is not None:
            await self._passing_on

    def _turn(self, live: LiveJob) -> Turn:
        record, size = live.record, live.progress.replicate_size
        return Turn(
            job_id=record.id,
            attempt=record.attempt,
            scene=live.scene,
            is_gallery=record.scene_kind == "gallery",
            target=record.target,
            settings=record.settings | ({} if size is None else {"replicate_size": size}),
            kept=live.kept,
            display_path=str(live.display_path),
            estimates_dir=str(self._files.folder),
            next_seq=live.seq + 1,
            seconds=self._settings.turn_seconds,
            checkpoint_seconds=self._settings.checkpoint_seconds,
            save=live.wants_save,
            cluster=self._cluster,
        )

    async def _leave(self, live: LiveJob, step: Literal[Step.PAUSE, Step.CANCEL]) -> None:
        """Take a job from the renderer with all that was rendered."""
        try:
            result: TurnResult = await self._renderer.call(LEAVE_SECONDS, worker.retire, self._turn(live))
            why = result.failure.detail if result.failure is not None else None
            live.absorb(result)
        except Lost as lost:
            why = str(lost)
        if why is not None:
            self._log.warning("job keeps its last saved picture only", job=live.record.id, step=step.value, why=why)
            live.lose_unsaved(why)
        await self._recorder.end(live, step, **({"stopped_by": "cancelled"} if step is Step.CANCEL else {}))

    async def _start_again(self, live: LiveJob, lost: Lost) -> None:
        """After a crash: the same job from its last saved estimate, unless it is to blame too often."""
        try:
            live.record = await writing(self._store.count_crash, live.record)
        except Superseded:
            self._recorder.abandon(live)
            return
        crashes, limit = live.record.crashes, self._settings.crash_limit
        self._log.warning("job lost its render process", job=live.record.id, crashes=crashes, why=str(lost))
        if (failure := failure_of_losses(crashes, limit, lost)) is not None:
            await self._recorder.fail(live, failure)

    async def _try_elsewhere(self, live: LiveJob, failure: Failure) -> None:
        """After an unexpected exception: the same job in a fresh process, from its last saved estimate, once."""
        self._renderer.is_spoilt = True
        try:
            live.record = await writing(self._store.count_crash, live.record)
        except Superseded:
            self._recorder.abandon(live)
            return
        crashes = live.record.crashes
        self._log.error("job raised an unexpected exception", job=live.record.id, crashes=crashes, trace=failure.trace)
        if (final := failure_of_surprises(crashes, self._settings.crash_limit, failure)) is not None:
            await self._recorder.fail(live, final)

    async def _replace_renderer(self) -> None:
        """Save what runs, end the render process; the next call starts another, where all go on as after a pause."""
        self._log.warning("render process is replaced after an unexpected exception")
        for live in self._running.all():
            with contextlib.suppress(Lost):  # then it goes on from what was saved before
                result: TurnResult = await self._renderer.call(LEAVE_SECONDS, worker.retire, self._turn(live))
                live.absorb(result)
                if result.saved is not None:
                    await self._recorder.save(live)
        await self._renderer.end()


def _seconds_since(moment: str) -> float:
    return max(0.0, (datetime.now(UTC) - datetime.fromisoformat(moment)).total_seconds())
