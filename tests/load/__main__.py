"""`make load`: a real service on loopback under more clients than it will ever like, measured in one run.

    python -m tests.load [--minutes M] [--threads N] [--database URL] [--json FILE]

A service with 200 jobs of which most wait, 50 open event streams, 20 clients that poll frames twice a second, and one
that asks all kinds of things three times a second; then ten big jobs and, again and again, a small new one.

What it renders is compared in stretches of some seconds that take turns, so that a machine whose speed changes favours
none of them; they wait for other programs that take more than a twentieth of a processor, up to a minute each:

- *jobs*: the 200 jobs without clients,
- *burn*: the same, while this process takes as much of the processors as the clients do, and asks nothing,
- *load*: with all clients.

From *jobs* to *load* is the raw fall. The clients run on the renderer's own processors here, and on other machines
elsewhere: from *burn* to *load* is what the service itself takes, with the clients' share taken out. Before and after
all that one big job has the service for itself (*alone*): what 16 jobs that take turns cost without any client.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import random
import signal
import statistics
import sys
import tempfile
import time
from collections.abc import AsyncIterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import httpx
from rich.console import Console
from rich.table import Table

from tests.load.clients import POLLERS, STREAMS, Answers, Clients
from tests.load.phases import Fall, Rate, burning, figures, rate, total, undisturbed
from tests.service.service_process import Server

BIG = {"width": 256, "height": 256}
SMALL = {"width": 64, "height": 64}
JOBS, RUNNING = 200, 16
PREVIEWS = 6
# More of these than needed for a figure would only make a long run longer.
MOST_CYCLES = 12
KINDS = ("jobs", "burn", "load")


def body_of(target: dict[str, Any], settings: dict[str, Any]) -> dict[str, Any]:
    settings = settings | {"seed": random.randrange(10**9)}
    return {"scene": {"gallery": "cornell-box"}, "target": target, "settings": settings}


@dataclass
class Memory:
    """Resident bytes of each process while the load lasts, every few seconds."""

    seconds: list[float] = field(default_factory=list)
    bytes: dict[str, list[float]] = field(default_factory=lambda: {"service": [], "render": []})

    @contextlib.asynccontextmanager
    async def watched(self, client: httpx.AsyncClient) -> AsyncIterator[None]:
        task = asyncio.create_task(self._watch(client))
        try:
            yield
        finally:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task

    async def _watch(self, client: httpx.AsyncClient, pause: float = 5.0) -> None:
        while True:
            found = await figures(client)
            self.seconds.append(time.perf_counter())
            for name, some in self.bytes.items():
                some.append(found[f'fredholm_memory_bytes{{process="{name}"}}'])
            await asyncio.sleep(pause)

    def of(self, name: str) -> dict[str, Any]:
        """First and last in bytes; growth in bytes per minute over the later two thirds, when caches are full."""
        some, slope = self.bytes[name], None
        later = slice(len(some) // 3, None)
        if len(some[later]) > 2:
            slope = 60 * statistics.linear_regression(self.seconds[later], some[later]).slope
        return {"first": some[0], "last": some[-1], "slope": slope, "all": some}


async def end_all(client: httpx.AsyncClient) -> None:
    for state in ("queued", "running"):
        while some := await listed(client, state):
            for job in some:
                await client.post(f"/api/jobs/{job['id']}/cancel", timeout=60)


async def start_jobs(client: httpx.AsyncClient, count: int, running: int, frames: int = 1) -> list[str]:
    """Queue jobs that never end, until some run and have pictures; ids of those that run."""
    for _ in range(count):
        await client.post("/api/jobs", json=body_of({"seconds": 3600}, BIG))
    while True:
        ids = [job["id"] for job in await listed(client, "running") if job["frame_seq"] >= frames]
        if len(ids) >= running:
            return ids
        await asyncio.sleep(0.2)


async def alone(client: httpx.AsyncClient, server: Server, stretch: float) -> Rate:
    """What one job renders that has the service for itself."""
    await start_jobs(client, 1, 1, frames=5)
    found = await undisturbed(client, server, stretch)
    await end_all(client)
    return found


async def compare(
    client: httpx.AsyncClient, server: Server, minutes: float, stretch: float, answers: Answers, memory: Memory
) -> tuple[dict[str, list[Rate]], int]:
    """What is rendered in each stretch of each kind, and how many jobs waited in the end."""
    rates: dict[str, list[Rate]] = {kind: [] for kind in KINDS}
    cycles = max(1, min(MOST_CYCLES, round(60 * minutes / stretch)))
    shown = await start_jobs(client, JOBS, RUNNING)

    def clients() -> Clients:
        return Clients(server.port, shown, lambda: body_of({"seconds": 600}, BIG), answers)

    async with clients():  # what is made on first use is made, and the clients' share is known
        share = (await rate(client, server, 0.5 * stretch)).shares["load"]
    for cycle in range(cycles):
        for kind in KINDS if cycle % 2 == 0 else KINDS[::-1]:
            async with contextlib.AsyncExitStack() as stack:
                if kind == "burn":
                    await stack.enter_async_context(burning(share))
                if kind == "load":
                    await stack.enter_async_context(clients())
                    await stack.enter_async_context(memory.watched(client))
                rates[kind].append(await undisturbed(client, server, stretch))
            print(f"{kind}: {rates[kind][-1].per_second / 1e6:.3f} million samples a second", flush=True)
        share = total(rates["load"]).shares["load"]
    if (left := 60 * minutes - cycles * stretch) > 0:
        async with clients(), memory.watched(client):
            await asyncio.sleep(left)
    waiting = len(await listed(client, "queued"))
    await end_all(client)
    return rates, waiting


async def measure(server: Server, minutes: float, stretch: float) -> dict[str, Any]:
    answers, memory = Answers(), Memory()
    # A connection that was quiet for long is closed by the time that it is wanted.
    limits = httpx.Limits(max_keepalive_connections=0)
    async with httpx.AsyncClient(base_url=server.url, timeout=30, limits=limits) as client:
        before = await alone(client, server, stretch)
        rates, waiting = await compare(client, server, minutes, stretch, answers, memory)
        rates["alone"] = [before, await alone(client, server, stretch)]
        await start_jobs(client, 10, 10)
        previews = [await first_preview(client) for _ in range(PREVIEWS)]
        await end_all(client)
    whole = {kind: total(some) for kind, some in rates.items()}
    falls = {
        "throughput_fall": Fall.between(rates["jobs"], rates["load"]),
        "throughput_fall_without_generator": Fall.between(rates["burn"], rates["load"]),
        "fall_by_burning": Fall.between(rates["jobs"], rates["burn"]),
        "fall_by_taking_turns": Fall.between(rates["alone"], rates["jobs"], is_paired=False),
    }
    calm, loaded = whole["jobs"], whole["load"]
    return {
        "falls": falls,
        "render_time_fall": 1 - loaded.shares["render"] / calm.shares["render"],
        "throughput_fall_per_processor_second": 1 - loaded.per_processor_second / calm.per_processor_second,
        "samples_per_second": {kind: one.per_second for kind, one in whole.items()},
        "samples_per_processor_second": {kind: one.per_processor_second for kind, one in whole.items()},
        "processors_used": {kind: one.shares for kind, one in whole.items()},
        "stretches": {kind: [one.per_second for one in some] for kind, some in rates.items()},
        "jobs_waiting": waiting,
        "requests": sum(len(some) for some in answers.seconds.values()),
        "events_told": answers.events,
        "p95_seconds": answers.p95(),
        "p95_by_kind": {kind: answers.p95(kind) for kind in answers.seconds if len(answers.seconds[kind]) > 1},
        "failures": answers.failures[:5],
        "first_preview_seconds": previews,
        "memory": {name: memory.of(name) for name in memory.bytes},
    }


async def listed(client: httpx.AsyncClient, state: str | None = None) -> list[dict[str, Any]]:
    params = {"limit": 1000} | ({"state": state} if state else {})
    return (await client.get("/api/jobs", params=params)).json()["jobs"]


async def first_preview(client: httpx.AsyncClient) -> float:
    """Seconds from submitting a small job to its first frame."""
    began = time.perf_counter()
    job_id = (await client.post("/api/jobs", json=body_of({"seconds": 60}, SMALL))).json()["id"]
    while (await client.get(f"/api/jobs/{job_id}")).json()["frame_seq"] == 0:
        await asyncio.sleep(0.02)
    took = time.perf_counter() - began
    await client.post(f"/api/jobs/{job_id}/cancel")
    return took


def show(found: dict[str, Any], minutes: float) -> None:
    table = Table(
        "what", "measured", "aim", title=f"{JOBS} jobs, {STREAMS} streams, {POLLERS} pollers, {minutes:g} min"
    )
    table.add_row("p95 of API answers", f"{1000 * found['p95_seconds']:.0f} ms", "< 100 ms")
    for kind, seconds in found["p95_by_kind"].items():
        table.add_row(f"  {kind}", f"{1000 * seconds:.0f} ms", "")
    falls = found["falls"]
    table.add_row("fall of samples per second, raw", str(falls["throughput_fall"]), "")
    table.add_row("  without the clients' own share", str(falls["throughput_fall_without_generator"]), "< 10 %")
    table.add_row("  by that share alone", str(falls["fall_by_burning"]), "")
    table.add_row("  of the renderer's processor time", f"{100 * found['render_time_fall']:.1f} %", "")
    own = f"{100 * found['throughput_fall_per_processor_second']:.1f} %"
    table.add_row("  per processor second of rendering", own, "")
    table.add_row("  from one job to many in turns, no clients", str(falls["fall_by_taking_turns"]), "")
    for kind, shares in found["processors_used"].items():
        told = ", ".join(f"{name} {share:.3f}" for name, share in shares.items())
        table.add_row(f"processors used, {kind}", told, "")
    worst = max(found["first_preview_seconds"])
    table.add_row("first preview beside ten big jobs, worst", f"{worst:.2f} s", "< 3 s")
    for name, told in found["memory"].items():
        growth = "" if told["slope"] is None else f", {told['slope'] / 2**20:+.2f} MiB a minute"
        text = f"{told['first'] / 2**20:.0f} → {told['last'] / 2**20:.0f} MiB{growth}"
        table.add_row(f"memory of the {name} process", text, "stable")
    table.add_row("requests, failed", f"{found['requests']}, {len(found['failures'])}", "none failed")
    Console().print(table)
    for failure in found["failures"]:
        print(failure)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.load", description="The service under load.")
    parser.add_argument(
        "--minutes", type=float, default=1.0, help="of load (from 5 on, memory tells whether it is stable)"
    )
    parser.add_argument("--stretch", type=float, default=5.0, help="seconds of one stretch")
    parser.add_argument("--threads", type=int, help="of the renderer; one per processor by default")
    parser.add_argument("--database", help="URL; SQLite by default")
    parser.add_argument("--json", type=Path, help="write the figures here too")
    given = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # the server is to end with this
    with tempfile.TemporaryDirectory(prefix="fredholm-load-") as folder:
        environment = {"FREDHOLM_MAX_WAITING_JOBS": "1000", "FREDHOLM_LOG_LEVEL": "info"}
        if given.threads:
            environment["FREDHOLM_THREADS"] = str(given.threads)
        if given.database:
            environment["FREDHOLM_DATABASE_URL"] = given.database
        server = Server(Path(folder) / "data", environment).start()
        try:
            found = asyncio.run(measure(server, given.minutes, given.stretch))
        finally:
            server.stop()
    show(found, given.minutes)
    if given.json:
        falls = {name: asdict(fall) for name, fall in found["falls"].items()}
        given.json.write_text(json.dumps(found | {"falls": falls}, indent=1))


if __name__ == "__main__":
    main()
