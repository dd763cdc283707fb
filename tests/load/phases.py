"""What a service renders in stretches of a few seconds that take turns: a machine that gets slower favours none."""

from __future__ import annotations

import asyncio
import contextlib
import os
import statistics
import time
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from pathlib import Path

import httpx

from tests.service.service_process import Server

_TICKS = os.sysconf("SC_CLK_TCK")
_BURN_PAUSE = 0.01
_LOOK_SECONDS = 0.03
_OTHERS, _PATIENCE_SECONDS = 0.05, 60.0


@dataclass(frozen=True)
class Rate:
    """Samples over some time, and processor seconds of each who took part in it, by name."""

    samples: float = 0.0
    seconds: float = 0.0
    processor: dict[str, float] = field(default_factory=dict)

    @property
    def per_second(self) -> float:
        return self.samples / self.seconds

    @property
    def per_processor_second(self) -> float:
        """Of the render process."""
        return self.samples / self.processor["render"]

    @property
    def shares(self) -> dict[str, float]:
        """Processors used."""
        return {name: used / self.seconds for name, used in self.processor.items()}


def total(rates: list[Rate]) -> Rate:
    """All of them in one."""
    names = rates[0].processor
    processor = {name: sum(one.processor[name] for one in rates) for name in names}
    return Rate(sum(one.samples for one in rates), sum(one.seconds for one in rates), processor)


@dataclass(frozen=True)
class Fall:
    """How much less one kind of stretch renders than another beside it. error: standard error over the cycles."""

    value: float
    error: float | None

    @classmethod
    def between(cls, before: list[Rate], after: list[Rate], *, is_paired: bool = True) -> Fall:
        value = 1 - total(after).per_second / total(before).per_second
        if not is_paired:
            return cls(value, None)
        each = [1 - two.per_second / one.per_second for one, two in zip(before, after, strict=True)]
        error = statistics.stdev(each) / len(each) ** 0.5 if len(each) > 2 else None
        return cls(value, error)

    def __str__(self) -> str:
        return f"{100 * self.value:.1f} %" + ("" if self.error is None else f" ± {100 * self.error:.1f}")


async def figures(client: httpx.AsyncClient) -> dict[str, float]:
    """What /metrics says, by name with labels."""
    lines = (await client.get("/metrics")).text.splitlines()
    return {name: float(value) for name, _, value in (line.rpartition(" ") for line in lines if line[0] != "#")}


def processor_seconds(server: Server) -> dict[str, float]:
    """Used so far by this process, by those of the service, and by all others of this machine."""
    assert server.process is not None
    pids = {"load": os.getpid(), "service": server.process.pid, "render": server.render_pids()[-1]}
    fields = {name: Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split() for name, pid in pids.items()}
    used = {name: (int(some[11]) + int(some[12])) / _TICKS for name, some in fields.items()}
    user, nice, system, _idle, _waiting, *more = map(int, Path("/proc/stat").read_text().split("\n", 1)[0].split()[1:])
    # More: interrupts, and what the host of a virtual machine took for others.
    used["others"] = (user + nice + system + sum(more[:3])) / _TICKS - sum(used.values())
    return used


async def rate(client: httpx.AsyncClient, server: Server, seconds: float) -> Rate:
    """Samples of the whole service over some time, from the end of a turn to the end of a turn."""
    began, before, used = await _end_of_turn(client, server)
    await asyncio.sleep(seconds)
    ended, samples, after = await _end_of_turn(client, server)
    return Rate(samples - before, ended - began, {name: after[name] - used[name] for name in used})


async def _end_of_turn(client: httpx.AsyncClient, server: Server) -> tuple[float, float, dict[str, float]]:
    """When it was, to a few hundredths of a second, samples until then, and processor seconds."""
    first = await figures(client)
    while True:
        await asyncio.sleep(_LOOK_SECONDS)
        found = await figures(client)
        if found["fredholm_turns_total"] > first["fredholm_turns_total"]:
            return time.perf_counter(), found["fredholm_samples_total"], processor_seconds(server)


async def undisturbed(client: httpx.AsyncClient, server: Server, seconds: float) -> Rate:
    """The same, begun when other programs of this machine are quiet, and again where they have not stayed so.

    After a minute of them it is what it is.
    """
    patience = time.perf_counter() + _PATIENCE_SECONDS
    while True:
        while await _others(server) > _OTHERS and time.perf_counter() < patience:
            pass
        found = await rate(client, server, seconds)
        if found.shares["others"] <= _OTHERS or time.perf_counter() > patience:
            return found


async def _others(server: Server, seconds: float = 1.0) -> float:
    """Processors that other programs take now."""
    before = processor_seconds(server)["others"]
    await asyncio.sleep(seconds)
    return (processor_seconds(server)["others"] - before) / seconds


@contextlib.asynccontextmanager
async def burning(processors: float) -> AsyncIterator[None]:
    """Takes as much of a processor as the clients would, for nothing, while the block lasts."""
    task = asyncio.create_task(_burn(processors))
    try:
        yield
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task


async def _burn(processors: float) -> None:
    began, used = time.perf_counter(), time.process_time()
    while True:
        while time.process_time() - used < processors * (time.perf_counter() - began):
            pass
        await asyncio.sleep(_BURN_PAUSE)
