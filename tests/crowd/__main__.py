"""`make crowd`: a real service with a hostile client of each kind at once, and what an honest one sees of that.

    python -m tests.crowd [--seconds S] [--side PIXELS] [--kind KIND]… [--json FILE]

Every client has a key of its own, as strangers on a network would; honest ones ask for all kinds of things ten times a
second and, again and again, submit a small picture and wait for its first preview: first alone, then in the crowd. The
crowd is a process of its own on the same processors. Exit code 1 where an aim is missed.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import httpx
from rich.console import Console
from rich.table import Table

from service.clients import Keys
from service.settings import MEBIBYTE
from service.store import Database
from service.store.keys import KeyStore
from tests.load.phases import figures
from tests.service.service_process import ROOT, Server

FINISHED, SIDE = 5, 1024
SMALL = {"width": 64, "height": 64}
_PATIENCE_SECONDS = 120.0
AIMS = {"p95": 0.1, "preview": 3.0, "service": 1 << 30}


@dataclass
class Seen:
    """What was measured. memory: highest resident bytes of each process."""

    answers: list[float] = field(default_factory=list)
    previews: list[float] = field(default_factory=list)
    memory: dict[str, float] = field(default_factory=lambda: {"service": 0.0, "render": 0.0})
    budget: float = 0.0
    failures: list[str] = field(default_factory=list)  # of honest requests
    hostile_failures: list[str] = field(default_factory=list)  # what the crowd could not do
    hostile: dict[str, int] = field(default_factory=dict)

    def verdicts(self) -> list[tuple[str, str, str, bool]]:
        """What was measured, what was aimed at, and whether it is met."""
        p95 = statistics.quantiles(self.answers, n=20)[-1] if len(self.answers) > 1 else float("inf")
        worst = max(self.previews, default=float("inf"))
        service, render = self.memory["service"], self.memory["render"]
        rows = [("p95 of API answers", f"{1000 * p95:.0f} ms", "< 100 ms", p95 < AIMS["p95"])]
        rows += [("first preview, worst", f"{worst:.2f} s", "< 3 s", worst < AIMS["preview"])]
        rows += [("memory of the service", f"{service / MEBIBYTE:.0f} MiB", "< 1024 MiB", service < AIMS["service"])]
        within = f"< {self.budget / MEBIBYTE:.0f} MiB"
        rows += [("memory of the renderer", f"{render / MEBIBYTE:.0f} MiB", within, render < self.budget)]
        rows += [("honest requests that failed", f"{len(self.failures)}", "0", not self.failures)]
        return rows


def new_key(server: Server, client: str, role: str = "submit") -> str:
    """A key of the service."""
    with contextlib.closing(Database(f"sqlite:///{server.data_dir / 'fredholm.sqlite'}")) as database:
        return Keys(KeyStore(database), server.data_dir / "secret").create(client, role)[1]


def client_of(server: Server, key: str) -> httpx.AsyncClient:
    limits = httpx.Limits(max_connections=100)
    return httpx.AsyncClient(base_url=server.url, headers={"Authorization": f"Bearer {key}"}, timeout=60, limits=limits)


async def finish_jobs(client: httpx.AsyncClient, count: int, size: dict[str, int]) -> list[str]:
    """Large pictures that are there before the crowd comes."""
    body = {"scene": {"gallery": "cornell-box"}, "target": {"spp": 1}, "settings": size}
    ids = [(await client.post("/api/jobs", json=body)).json()["id"] for _ in range(count)]
    for job_id in ids:
        while (await client.get(f"/api/jobs/{job_id}")).json()["state"] != "succeeded":
            await asyncio.sleep(0.2)
    return ids


async def ask(client: httpx.AsyncClient, seen: Seen) -> None:
    """What a page and its operator ask, one after the other."""
    while True:
        for path in ("/api/jobs", "/healthz", "/api/gallery", "/api/session", "/api/scenes"):
            began = time.perf_counter()
            try:
                answer = await client.get(path)
                if answer.status_code != 200:
                    seen.failures.append(f"{path}: {answer.status_code} {answer.text[:200]}")
            except httpx.TransportError as error:
                seen.failures.append(f"{path}: {type(error).__name__}")
            seen.answers.append(time.perf_counter() - began)
            await asyncio.sleep(0.1)


async def preview(client: httpx.AsyncClient, seen: Seen) -> None:
    """Small pictures, one after the other, each until its first frame."""
    body = {"scene": {"gallery": "cornell-box"}, "target": {"seconds": 60}, "settings": SMALL}
    while True:
        began = time.perf_counter()
        try:
            answer = await client.post("/api/jobs", json=body)
            answer.raise_for_status()
            job_id = answer.json()["id"]
            while (await client.get(f"/api/jobs/{job_id}/frames/latest")).status_code != 200:
                await asyncio.sleep(0.05)
            seen.previews.append(time.perf_counter() - began)
            await client.post(f"/api/jobs/{job_id}/cancel")
        except httpx.HTTPError as error:
            seen.failures.append(f"preview: {error!r}")
        await asyncio.sleep(1.0)


async def watch(client: httpx.AsyncClient, seen: Seen) -> None:
    """Memory, as the service itself tells it."""
    while True:
        with contextlib.suppress(httpx.TransportError, KeyError, ValueError):
            found = await figures(client)
            for name in seen.memory:
                seen.memory[name] = max(seen.memory[name], found[f'fredholm_memory_bytes{{process="{name}"}}'])
            seen.budget = found['fredholm_budget_bytes{of="renderer"}']
        await asyncio.sleep(0.5)


async def measure(
    server: Server,
    keys: dict[str, str],
    seconds: float,
    side: int = SIDE,
    previews: int = 0,
    kinds: Sequence[str] = (),
) -> tuple[Seen, Seen]:
    """What is seen of the service without and with the crowd, in so many seconds and until so many previews came."""
    calm, seen = Seen(), Seen()
    async with contextlib.AsyncExitStack() as stack:
        honest, hostile, admin = [
            await stack.enter_async_context(client_of(server, keys[name])) for name in ("honest", "hostile", "admin")
        ]
        finished = await finish_jobs(hostile, FINISHED, {"width": side, "height": side})
        await look(honest, admin, calm, seconds / 4, min(previews, 1))
        command = [sys.executable, "-m", "tests.crowd.hostile", str(server.port), keys["hostile"]]
        command += [",".join(finished), *kinds]
        crowd = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE)
        try:
            await asyncio.sleep(min(5.0, seconds))  # until all of them are there
            await look(honest, admin, seen, seconds, previews)
        finally:
            crowd.terminate()
            told, _ = await asyncio.to_thread(crowd.communicate)
    found = json.loads(told)
    seen.hostile = found["done"]
    seen.hostile_failures = found["failures"]
    return calm, seen


async def look(honest: httpx.AsyncClient, admin: httpx.AsyncClient, seen: Seen, seconds: float, previews: int) -> None:
    """Ask for some time, and until so many previews have come."""
    tasks = [asyncio.create_task(one) for one in (ask(honest, seen), preview(honest, seen), watch(admin, seen))]
    await asyncio.sleep(seconds)
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(_PATIENCE_SECONDS):
            while len(seen.previews) < previews:
                await asyncio.sleep(0.2)
    for task in tasks:
        task.cancel()
    for ended in await asyncio.gather(*tasks, return_exceptions=True):
        if isinstance(ended, Exception):
            seen.failures.append(repr(ended))


def show(calm: Seen, seen: Seen) -> bool:
    """Print the figures; whether all aims are met."""
    table = Table("what", "alone", "in the crowd", "aim", "", title="a hostile client of each kind at once")
    rows = seen.verdicts()
    for (what, measured, aim, is_met), (_, before, *_) in zip(rows, calm.verdicts(), strict=True):
        table.add_row(what, before, measured, aim, "ok" if is_met else "NOT OK")
    Console().print(table)
    print(f"{len(seen.answers)} answers, {len(seen.previews)} previews; hostile: {seen.hostile}")
    for failure in [*seen.failures[:10], *seen.hostile_failures[:10]]:
        print(failure)
    return all(is_met for *_, is_met in rows)


def started(folder: Path, environment: dict[str, str] | None = None) -> tuple[Server, dict[str, str]]:
    """A service that asks for keys, and those of its clients."""
    server = Server(folder / "data", {"FREDHOLM_API_KEYS": "on"} | (environment or {}))
    server.start()
    roles = {"honest": "submit", "hostile": "submit", "admin": "admin"}
    return server, {name: new_key(server, name, role) for name, role in roles.items()}


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.crowd", description="The service among hostile clients.")
    parser.add_argument("--seconds", type=float, default=60.0, help="among the crowd")
    parser.add_argument("--side", type=int, default=SIDE, help="of the finished pictures that are asked for, pixels")
    parser.add_argument(
        "--kind", action="append", default=[], help="of hostile client, instead of all; repeat for more"
    )
    parser.add_argument("--json", type=Path, help="write the figures here too")
    given = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # the server is to end with this
    with tempfile.TemporaryDirectory(prefix="fredholm-crowd-") as folder:
        server, keys = started(Path(folder))
        try:
            calm, seen = asyncio.run(measure(server, keys, given.seconds, given.side, kinds=given.kind))
        finally:
            server.stop()
    is_met = show(calm, seen)
    if given.json:
        given.json.write_text(json.dumps({"alone": calm.__dict__, "crowd": seen.__dict__}, indent=1))
    sys.exit(0 if is_met else 1)


if __name__ == "__main__":
    main()
