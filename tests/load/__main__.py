"""`make load`: a real service on loopback under more clients than it will ever like, measured in one run.

    python -m tests.load [--minutes M] [--threads N] [--database URL] [--json FILE]

First one big job alone, which tells how fast this machine renders; then 200 jobs of which most wait, 50 open event
streams, 20 clients that poll frames twice a second, and one that asks all kinds of things; then ten big jobs and, again
and again, a small new one. The load comes from the same machine: what it takes from a renderer that uses all of it is
in the figures too. With fewer `--threads` for the renderer there is room for the others, as on a server of its own.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import os
import random
import statistics
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
from rich.console import Console
from rich.table import Table

from tests.service.service_process import Server

BIG = {"width": 256, "height": 256}
SMALL = {"width": 64, "height": 64}
JOBS, STREAMS, POLLERS = 200, 50, 20
PREVIEWS = 6


@dataclass
class Answers:
    """Seconds of each answer by kind of request, and what went wrong."""

    seconds: dict[str, list[float]] = field(default_factory=dict)
    failures: list[str] = field(default_factory=list)

    async def ask(self, client: httpx.AsyncClient, kind: str, method: str, path: str, **more: Any) -> httpx.Response:
        began = time.perf_counter()
        request = client.build_request(method, path, **more)
        answer = await client.send(request, stream=True)
        # Unpacking a frame is a browser's work, not the service's.
        body = b"".join([chunk async for chunk in answer.aiter_raw()])
        await answer.aclose()
        self.seconds.setdefault(kind, []).append(time.perf_counter() - began)
        if answer.status_code >= 400:
            self.failures.append(f"{kind}: {answer.status_code} {body[:200]!r}")
        return httpx.Response(answer.status_code, content=body)

    def p95(self, kind: str | None = None) -> float:
        all_of = [s for name, some in self.seconds.items() if kind in (None, name) for s in some]
        return statistics.quantiles(all_of, n=20)[-1]


def body_of(target: dict[str, Any], settings: dict[str, Any]) -> dict[str, Any]:
    settings = settings | {"seed": random.randrange(10**9)}
    return {"scene": {"gallery": "cornell-box"}, "target": target, "settings": settings}


async def figures(client: httpx.AsyncClient) -> dict[str, float]:
    """What /metrics says, by name with labels."""
    lines = (await client.get("/metrics")).text.splitlines()
    return {name: float(value) for name, _, value in (line.rpartition(" ") for line in lines if line[0] != "#")}


@dataclass(frozen=True)
class Rate:
    """Samples over some time, and processor seconds of each who took part in it, by name."""

    samples: float
    seconds: float
    processor: dict[str, float]

    @property
    def per_second(self) -> float:
        return self.samples / self.seconds

    @property
    def per_processor_second(self) -> float:
        """Of the render process: what the load takes away from it on the same cores does not count."""
        return self.samples / self.processor["render"]


def processor_seconds(server: Server) -> dict[str, float]:
    assert server.process is not None
    pids = {"load": os.getpid(), "service": server.process.pid, "render": server.render_pids()[-1]}
    fields = {name: Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split() for name, pid in pids.items()}
    return {name: (int(some[11]) + int(some[12])) / os.sysconf("SC_CLK_TCK") for name, some in fields.items()}


async def rate(client: httpx.AsyncClient, server: Server, seconds: float) -> Rate:
    """Samples of the whole service over some time."""
    began, used, before = time.perf_counter(), processor_seconds(server), await figures(client)
    await asyncio.sleep(seconds)
    samples = (await figures(client))["fredholm_samples_total"] - before["fredholm_samples_total"]
    after = processor_seconds(server)
    return Rate(samples, time.perf_counter() - began, {name: after[name] - used[name] for name in used})


@dataclass
class Memory:
    """Resident bytes of each process while the load lasts, every few seconds."""

    seconds: list[float] = field(default_factory=list)
    bytes: dict[str, list[float]] = field(default_factory=lambda: {"service": [], "render": []})

    async def watch(self, client: httpx.AsyncClient, pause: float = 5.0) -> None:
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


async def watch_stream(url: str, told: list[int]) -> None:
    async with httpx.AsyncClient(base_url=url, timeout=httpx.Timeout(30, read=None)) as client:
        async with client.stream("GET", "/api/events") as stream:
            async for chunk in stream.aiter_raw():
                told[0] += chunk.count(b"event:")


async def poll_frames(client: httpx.AsyncClient, answers: Answers, ids: list[str]) -> None:
    job_id, after = random.choice(ids), 0
    while True:
        path = f"/api/jobs/{job_id}/frames/latest?after={after}"
        answer = await answers.ask(client, "frame", "GET", path, headers={"Accept-Encoding": "zstd"})
        after = after + 1 if answer.status_code == 200 else after
        await asyncio.sleep(0.5)


async def ask_around(client: httpx.AsyncClient, answers: Answers, ids: list[str]) -> None:
    while True:
        job_id = random.choice(ids)
        await answers.ask(client, "job", "GET", f"/api/jobs/{job_id}")
        await answers.ask(client, "list", "GET", "/api/jobs?limit=100")
        await answers.ask(client, "pixel", "GET", f"/api/jobs/{ids[0]}/pixel?x=9&y=9")
        made = await answers.ask(client, "submit", "POST", "/api/jobs", json=body_of({"seconds": 600}, BIG))
        await answers.ask(client, "cancel", "POST", f"/api/jobs/{made.json()['id']}/cancel")
        await asyncio.sleep(0.2)


async def measure(server: Server, minutes: float) -> dict[str, Any]:
    seconds = 60 * minutes
    limits = httpx.Limits(max_connections=100)
    async with httpx.AsyncClient(base_url=server.url, timeout=30, limits=limits) as client:
        alone = (await client.post("/api/jobs", json=body_of({"seconds": 3600}, BIG))).json()["id"]
        while (await client.get(f"/api/jobs/{alone}")).json()["frame_seq"] < 5:
            await asyncio.sleep(0.1)
        calm = await rate(client, server, min(20.0, seconds))

        for _ in range(JOBS - 1):
            await client.post("/api/jobs", json=body_of({"seconds": 3600}, BIG))
        while len(running := [job for job in await listed(client, "running") if job["frame_seq"] > 0]) < 16:
            await asyncio.sleep(0.2)
        answers, told = Answers(), [0]
        shown = [job["id"] for job in running]
        tasks = [asyncio.create_task(watch_stream(server.url, told)) for _ in range(STREAMS)]
        tasks += [asyncio.create_task(poll_frames(client, answers, shown)) for _ in range(POLLERS)]
        tasks += [asyncio.create_task(ask_around(client, answers, shown))]
        await asyncio.sleep(3)
        memory = Memory()
        watching = asyncio.create_task(memory.watch(client))
        loaded = await rate(client, server, seconds)
        watching.cancel()
        for task in tasks:
            task.cancel()
        for task in [*tasks, watching]:
            with contextlib.suppress(asyncio.CancelledError):
                await task
        waiting = len(await listed(client, "queued"))
        await end_all(client)

        for _ in range(10):
            await client.post("/api/jobs", json=body_of({"seconds": 3600}, BIG))
        while sum(job["frame_seq"] > 0 for job in await listed(client, "running")) < 10:
            await asyncio.sleep(0.1)
        previews = [await first_preview(client) for _ in range(PREVIEWS)]
        await end_all(client)
        return {
            "samples_per_second_alone": calm.per_second,
            "samples_per_second_loaded": loaded.per_second,
            "throughput_fall": 1 - loaded.per_second / calm.per_second,
            "throughput_fall_per_processor_second": 1 - loaded.per_processor_second / calm.per_processor_second,
            "processors_used": {name: used / loaded.seconds for name, used in loaded.processor.items()},
            "processors_used_alone": {name: used / calm.seconds for name, used in calm.processor.items()},
            "jobs_waiting": waiting,
            "requests": sum(len(some) for some in answers.seconds.values()),
            "events_told": told[0],
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
    fall = f"{100 * found['throughput_fall']:.1f} %"
    table.add_row("fall of samples per second", fall, "< 10 % with cores to spare")
    own = f"{100 * found['throughput_fall_per_processor_second']:.1f} %"
    table.add_row("  per processor second of rendering", own, "< 10 %")
    shares = ", ".join(f"{name} {share:.2f}" for name, share in found["processors_used"].items())
    table.add_row("processors used", shares, "")
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
    parser.add_argument("--threads", type=int, help="of the renderer; one per processor by default")
    parser.add_argument("--database", help="URL; SQLite by default")
    parser.add_argument("--json", type=Path, help="write the figures here too")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="fredholm-load-") as folder:
        environment = {"FREDHOLM_MAX_WAITING_JOBS": "1000", "FREDHOLM_LOG_LEVEL": "info"}
        if given.threads:
            environment["FREDHOLM_THREADS"] = str(given.threads)
        if given.database:
            environment["FREDHOLM_DATABASE_URL"] = given.database
        server = Server(Path(folder) / "data", environment).start()
        try:
            found = asyncio.run(measure(server, given.minutes))
        finally:
            server.stop()
    show(found, given.minutes)
    if given.json:
        given.json.write_text(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
