"""The loop that gives turns, with an engine that renders nothing."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator, Callable, Iterable, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy.exc import OperationalError
from test_store import NEW

from service import dispatch
from service.accountant import Accountant, Need
from service.admission import Admission
from service.engine import interface, worker
from service.engine.interface import Handle, Lost, Slot
from service.engine.turn import Turn, TurnResult
from service.estimates import EstimateFiles
from service.hub import Hub
from service.lease import Lease
from service.metrics import Metrics
from service.quarantine import Quarantine
from service.room import Disk
from service.runner import Runner
from service.settings import ServiceSettings
from service.states import State
from service.store import Database, JobRecord, JobStore, Kept, Progress

_ENDS_AFTER = 3
SETTINGS = {"width": 4, "height": 4, "seed": 1, "max_depth": None, "technique": "mis"}


class Rendering:
    """Implements `service.engine.interface.Engine`: every turn saves an estimate, the third one ends the job."""

    def __init__(self) -> None:
        self.turns: list[Turn] = []
        self._values: dict[Handle, TurnResult] = {}

    async def start(self) -> None:
        pass

    def slots(self) -> Sequence[Slot]:
        return []

    def submit(self, call: Callable[..., Any], *args: Any, **_: Any) -> Handle:
        handle, result = Handle(len(self._values), "fake"), TurnResult()
        if call is worker.advance:
            self.turns.append(turn := args[0])
            progress = Progress(samples=len(self.turns), frame_seq=turn.next_seq, replicate_size=4)
            stopped_by = "spp" if len(self.turns) == _ENDS_AFTER else None
            result = TurnResult(
                progress, saved=Kept(f"{turn.job_id}/{turn.next_seq}.exr", None, progress), stopped_by=stopped_by
            )
        self._values[handle] = result
        return handle

    async def wait(self, handles: Iterable[Handle], seconds: float | None = None) -> set[Handle]:
        await asyncio.sleep(0)
        return {*handles}

    async def fetch(self, handle: Handle) -> Any:
        return self._values[handle]

    async def cancel(self, handle: Handle, *, hard: bool = False) -> None:
        pass

    async def close(self) -> None:
        pass


class Hanging(Rendering):
    """Turns never come back: each ends by its deadline, or once it is given up."""

    def __init__(self) -> None:
        super().__init__()
        self.deadlines: list[float] = []
        self.hangs = asyncio.Event()

    async def wait(self, handles: Iterable[Handle], seconds: float | None = None) -> set[Handle]:
        assert seconds is not None
        self.deadlines.append(seconds)
        self.hangs.set()
        await asyncio.sleep(seconds)
        return set()


class Endless(Rendering):
    """Jobs never end, and every call takes a few milliseconds."""

    def submit(self, call: Callable[..., Any], *args: Any, **_: Any) -> Handle:
        handle = super().submit(call, *args)
        if call is worker.advance:
            self._values[handle] = replace(self._values[handle], saved=None, stopped_by=None)
        return handle

    async def wait(self, handles: Iterable[Handle], seconds: float | None = None) -> set[Handle]:
        await asyncio.sleep(0.005)
        return {*handles}


@asynccontextmanager
async def running(
    folder: Path, jobs: JobStore, engine: Rendering, metrics: Metrics, **more: Any
) -> AsyncIterator[Runner]:
    """A runner over a store; more: settings of its service."""
    hub = Hub(jobs)
    await hub.start()
    settings = ServiceSettings.model_validate({"data_dir": folder, "warm_up": False} | more)
    files = EstimateFiles(folder / "estimates", Quarantine(folder / "quarantine"))
    files.prepare()
    lease = Lease(jobs, "here", "test", 60.0)
    disk = Disk(folder, 0)
    admission = Admission(jobs, disk, Accountant(settings), 16, lambda job: Need.of(job.settings, job.scene_ref, 0))

    async def path_of(job: JobRecord) -> str:
        return job.scene_ref

    runner = Runner(settings, jobs, engine, hub, files, lease, metrics, path_of, disk, admission)
    await runner.start()
    try:
        yield runner
    finally:
        await runner.stop()


def store_in(folder: Path) -> JobStore:
    database = Database(f"sqlite:///{folder}/runner.sqlite")
    database.create_tables()
    return JobStore(database)


def run(
    folder: Path, watch: Callable[[Rendering, JobStore, Metrics], Callable[..., Any]]
) -> tuple[JobStore, str, Metrics]:
    """One job until it has ended; `watch` makes what saves in place of the store."""
    jobs, engine, metrics = store_in(folder), Rendering(), Metrics()
    job_id = jobs.add(replace(NEW, settings=SETTINGS))[0].id
    setattr(jobs, "save", watch(engine, jobs, metrics))  # noqa: B010 - a method of this one store alone

    async def until_ended() -> None:
        async with running(folder, jobs, engine, metrics):
            while jobs.get(job_id).state is not State.SUCCEEDED:
                await asyncio.sleep(0.01)

    asyncio.run(asyncio.wait_for(until_ended(), 20))
    return jobs, job_id, metrics


def test_the_next_turn_begins_before_the_last_one_is_recorded(tmp_path: Path) -> None:
    """The renderer must not wait for a disk."""
    seen: list[int] = []

    def watch(engine: Rendering, jobs: JobStore, _metrics: Metrics) -> Callable[..., Any]:
        save = jobs.save

        def slow(*args: Any) -> bool:
            for _ in range(500):
                if len(engine.turns) > len(seen) + 1:
                    break
                threading.Event().wait(0.01)
            seen.append(len(engine.turns))
            return save(*args)

        return slow

    jobs, job_id, _ = run(tmp_path, watch)
    assert seen == [2, 3], "turns begun by the time that the first and the second were recorded"
    assert jobs.get(job_id).progress.samples == _ENDS_AFTER


def test_an_estimate_that_cannot_be_recorded_stops_no_turn(tmp_path: Path) -> None:
    def watch(*_: Any) -> Callable[..., Any]:
        def fail(*_: Any) -> bool:
            raise OperationalError("UPDATE", {}, Exception("the disk is full"))

        return fail

    jobs, job_id, metrics = run(tmp_path, watch)
    assert jobs.get(job_id).progress.samples == _ENDS_AFTER
    assert metrics.registry.get_sample_value("fredholm_errors_total", {"where": "turn"}) == _ENDS_AFTER - 1


def test_a_job_that_begins_anew_keeps_the_replicate_size_that_its_first_turn_resolved(tmp_path: Path) -> None:
    turns: list[Turn] = []

    def watch(engine: Rendering, jobs: JobStore, _metrics: Metrics) -> Callable[..., Any]:
        turns_of, save = engine.turns, jobs.save

        def noting(*args: Any) -> bool:
            turns[:] = turns_of
            return save(*args)

        return noting

    jobs, job_id, _ = run(tmp_path, watch)
    assert "replicate_size" not in turns[0].settings
    assert [turn.settings["replicate_size"] for turn in turns[1:]] == [4] * (len(turns) - 1)
    assert len(turns) > 1
    assert jobs.get(job_id).progress.replicate_size == 4


def test_a_turn_that_was_lost_gives_the_next_no_more_time(tmp_path: Path) -> None:
    """It was measured, and multiplied: turns that hang kept the renderer for ten times as long each time."""

    async def until_failed() -> list[float]:
        jobs, engine = store_in(tmp_path), Hanging()
        job_id = jobs.add(replace(NEW, settings=SETTINGS))[0].id
        async with running(tmp_path, jobs, engine, Metrics(), turn_deadline_seconds=0.1):
            while jobs.get(job_id).state is not State.FAILED:
                await asyncio.sleep(0.01)
        return engine.deadlines

    assert asyncio.run(asyncio.wait_for(until_failed(), 30)) == [0.1] * 3


def test_a_job_that_is_cancelled_ends_its_turn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(interface, "PATIENCE_SECONDS", 0.05)

    async def cancelled() -> State:
        jobs, engine = store_in(tmp_path), Hanging()
        job_id = jobs.add(replace(NEW, settings=SETTINGS))[0].id
        async with running(tmp_path, jobs, engine, Metrics(), turn_deadline_seconds=600, stop_seconds=0.1) as runner:
            await engine.hangs.wait()
            async with asyncio.timeout(20):
                await runner.cancel(job_id)
            return jobs.get(job_id).state

    assert asyncio.run(cancelled()) is State.CANCELLED


@pytest.mark.parametrize("asker", ["another", ""])
def test_who_asks_without_end_pays_for_it(asker: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Questions of another client, or of the job's own: the job has about every other turn."""
    monkeypatch.setattr(dispatch, "PREVIEW_CREDIT", 0.05)

    async def flooded() -> tuple[int, int]:
        jobs, engine = store_in(tmp_path), Endless()
        jobs.add(replace(NEW, settings=SETTINGS))
        answered = 0

        async def ask(runner: Runner) -> None:
            nonlocal answered
            while True:
                await runner.ask(asker, 1.0, int)
                answered += 1

        async with running(tmp_path, jobs, engine, Metrics()) as runner:
            while len(engine.turns) < 5:
                await asyncio.sleep(0.01)
            before, asking = len(engine.turns), [asyncio.create_task(ask(runner)) for _ in range(4)]
            while answered < 100:
                await asyncio.sleep(0.01)
            seen = len(engine.turns) - before, answered
            for task in asking:
                task.cancel()
                with suppress(asyncio.CancelledError, Lost):
                    await task
        return seen

    turns, answered = asyncio.run(asyncio.wait_for(flooded(), 60))
    assert turns > answered / 4
