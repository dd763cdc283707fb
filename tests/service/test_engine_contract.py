"""What every engine keeps to, whatever it is made of."""

from __future__ import annotations

import asyncio
import operator
import os
import signal
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager

import pytest
from service_process import is_alive

from service.engine.embedded import EmbeddedEngine
from service.engine.interface import Engine, Lost, run_within

ENGINES: list[Callable[[], Engine]] = [lambda: EmbeddedEngine(("one", "two"))]


@asynccontextmanager
async def started(make: Callable[[], Engine]) -> AsyncIterator[Engine]:
    engine = make()
    await engine.start()
    try:
        yield engine
    finally:
        await engine.close()


@pytest.fixture(params=ENGINES, ids=["embedded"])
def on_engine(request: pytest.FixtureRequest) -> Callable[[Callable[[Engine], Awaitable[None]]], None]:
    """Runs a scenario on a fresh engine."""

    def run(scenario: Callable[[Engine], Awaitable[None]]) -> None:
        async def whole() -> None:
            async with started(request.param) as engine:
                await scenario(engine)

        asyncio.run(whole())

    return run


def test_values_come_back_and_errors_too(on_engine: Callable[..., None]) -> None:
    async def scenario(engine: Engine) -> None:
        good, bad = engine.submit(operator.add, 2, 3), engine.submit(int, "x")
        assert await engine.fetch(good) == 5
        with pytest.raises(ValueError, match="invalid literal"):
            await engine.fetch(bad)

    on_engine(scenario)


def test_slots_are_named_tagged_and_can_be_chosen(on_engine: Callable[..., None]) -> None:
    async def scenario(engine: Engine) -> None:
        slots = engine.slots()
        assert len({slot.name for slot in slots}) == len(slots) == 2
        assert all(slot.tags for slot in slots)
        pids = [await engine.fetch(engine.submit(os.getpid, slot=slot.name)) for slot in slots for _ in range(2)]
        assert pids[0] == pids[1] != pids[2] == pids[3]

    on_engine(scenario)


def test_arguments_may_be_handles_whose_values_never_travel(on_engine: Callable[..., None]) -> None:
    async def scenario(engine: Engine) -> None:
        first = engine.submit(operator.add, [1], [2])
        second = engine.submit(operator.add, first, [3])
        assert second.slot == first.slot
        assert await engine.fetch(second) == [1, 2, 3]

    on_engine(scenario)


def test_a_value_that_is_brought_waits_for_no_other_call(on_engine: Callable[..., None]) -> None:
    async def scenario(engine: Engine) -> None:
        slot = engine.slots()[0].name
        brought = engine.submit(operator.add, 2, 3, slot=slot, is_brought=True)
        await engine.wait([brought])
        busy = engine.submit(time.sleep, 3, slot=slot)
        began = time.perf_counter()
        assert await engine.fetch(brought) == 5
        assert time.perf_counter() - began < 1
        bad = engine.submit(int, "x", slot=engine.slots()[1].name, is_brought=True)
        with pytest.raises(ValueError, match="invalid literal"):
            await engine.fetch(bad)
        await engine.cancel(busy, hard=True)

    on_engine(scenario)


def test_wait_returns_with_the_first_or_when_time_is_up(on_engine: Callable[..., None]) -> None:
    async def scenario(engine: Engine) -> None:
        one, two = (slot.name for slot in engine.slots())
        slow, quick = engine.submit(time.sleep, 1.5, slot=one), engine.submit(abs, -1, slot=two)
        assert await engine.wait([slow, quick]) == {quick}
        assert await engine.wait([slow], 0.05) == set()
        assert await engine.wait([slow], 20) == {slow}

    on_engine(scenario)


def test_higher_priority_is_begun_first(on_engine: Callable[..., None]) -> None:
    async def scenario(engine: Engine) -> None:
        slot = engine.slots()[0].name
        await engine.fetch(engine.submit(abs, 1, slot=slot))
        engine.submit(time.sleep, 0.3, slot=slot)
        await asyncio.sleep(0.05)
        low = engine.submit(time.monotonic, slot=slot)
        high = engine.submit(time.monotonic, slot=slot, priority=5)
        assert await engine.fetch(high) < await engine.fetch(low)

    on_engine(scenario)


def test_a_call_that_waits_is_cancelled_and_one_that_runs_only_by_force(on_engine: Callable[..., None]) -> None:
    async def scenario(engine: Engine) -> None:
        slot = engine.slots()[0].name
        pid = await engine.fetch(engine.submit(os.getpid, slot=slot))
        running, waiting = engine.submit(time.sleep, 60, slot=slot), engine.submit(abs, 1, slot=slot)
        await asyncio.sleep(0.1)
        await engine.cancel(waiting)
        with pytest.raises(asyncio.CancelledError):
            await engine.fetch(waiting)
        await engine.cancel(running)
        assert await engine.wait([running], 0.2) == set()
        await engine.cancel(running, hard=True)
        with pytest.raises(Lost):
            await asyncio.wait_for(engine.fetch(running), 10)
        assert not is_alive(pid)
        assert await engine.fetch(engine.submit(abs, -7, slot=slot)) == 7

    on_engine(scenario)


def test_a_killed_worker_loses_its_call_and_its_values_and_is_replaced(on_engine: Callable[..., None]) -> None:
    async def scenario(engine: Engine) -> None:
        slot = engine.slots()[0].name
        pid = await engine.fetch(engine.submit(os.getpid, slot=slot))
        kept = engine.submit(operator.add, 1, 2, slot=slot)
        await engine.wait([kept])
        running = engine.submit(time.sleep, 60, slot=slot)
        await asyncio.sleep(0.1)
        os.kill(pid, signal.SIGKILL)
        with pytest.raises(Lost, match="SIGKILL"):
            await asyncio.wait_for(engine.fetch(running), 10)
        with pytest.raises(Lost):
            await engine.fetch(kept)
        assert await engine.fetch(engine.submit(operator.add, 1, 2, slot=slot)) == 3

    on_engine(scenario)


def test_a_call_that_hangs_is_ended_by_its_deadline(on_engine: Callable[..., None]) -> None:
    async def scenario(engine: Engine) -> None:
        began = time.monotonic()
        with pytest.raises(Lost, match=r"no answer within 0\.3 s"):
            await run_within(engine, 0.3, time.sleep, 60)
        assert time.monotonic() - began < 20
        assert await run_within(engine, 20, abs, -1) == 1

    on_engine(scenario)


def test_a_call_that_nobody_wants_any_more_is_ended_within_seconds(on_engine: Callable[..., None]) -> None:
    async def scenario(engine: Engine) -> None:
        given_up = asyncio.Event()
        asyncio.get_running_loop().call_later(0.2, given_up.set)
        began = time.monotonic()
        with pytest.raises(Lost, match="not wanted any more"):
            await run_within(engine, 100, time.sleep, 60, given_up=given_up)
        assert time.monotonic() - began < 50
        assert await run_within(engine, 100, abs, -1) == 1

    on_engine(scenario)


def test_a_slot_whose_call_runs_is_not_idle(on_engine: Callable[..., None]) -> None:
    async def scenario(engine: Engine) -> None:
        one, two = (slot.name for slot in engine.slots())
        for name in (one, two):
            await engine.fetch(engine.submit(abs, 1, slot=name))
        busy = engine.submit(time.sleep, 30, slot=one)
        await asyncio.sleep(0.1)
        assert engine.submit(abs, -1).slot == two
        await engine.cancel(busy, hard=True)

    on_engine(scenario)


def test_nothing_is_left_when_an_engine_is_closed() -> None:
    async def scenario() -> list[int]:
        async with started(ENGINES[0]) as engine:
            return [await engine.fetch(engine.submit(os.getpid, slot=slot.name)) for slot in engine.slots()]

    pids = asyncio.run(scenario())
    ends = time.monotonic() + 10
    while any(is_alive(pid) for pid in pids):
        assert time.monotonic() < ends
        time.sleep(0.05)
