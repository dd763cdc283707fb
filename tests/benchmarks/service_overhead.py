"""What the service costs a render: seconds of a job against `renderer.render` of the same picture, in one run.

    python -m tests.benchmarks.service_overhead [--size N] [--spp N] [--rounds N]

Both sides render the same samples, warm, in turns, each in a process of its own that is set up in the same way; the
job with frames shown, its progress streamed to one listener, and estimates saved on the way. What is reported is the
ratio, of wall-clock seconds and of processor seconds: the second hardly feels what else the machine does.
"""

from __future__ import annotations

import argparse
import contextlib
import multiprocessing
import os
import signal
import statistics
import sys
import tempfile
import threading
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import httpx

import renderer
from service.engine.worker import begin, kept_scene
from tests.service.service_process import Server

_TICKS = os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True)
class Cost:
    """Seconds: from start to end, of rendering as told, of processor time; and of processor time of the server."""

    wall: float
    told: float
    processor: float
    server: float = 0.0


def processor_seconds(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS


def job_cost(server: Server, spp: int, size: int, seed: int) -> Cost:
    assert server.process is not None
    pids = (server.render_pids()[-1], server.process.pid)
    before = [processor_seconds(pid) for pid in pids]
    job = server.submit({"spp": spp}, {"width": size, "height": size, "seed": seed, "adaptive": True})
    while (job := server.job(job["id"]))["state"] not in ("succeeded", "failed"):
        time.sleep(0.5)
    assert job["state"] == "succeeded", job
    render, service = (processor_seconds(pid) - old for pid, old in zip(pids, before, strict=True))
    started, finished = (datetime.fromisoformat(job[name]) for name in ("started_at", "finished_at"))
    return Cost((finished - started).total_seconds(), job["seconds"], render, service)


def alone_cost(spp: int, size: int, seed: int) -> Cost:
    """Runs in a process of its own, set up as the service sets up its render process."""
    scene = kept_scene("cornell-box", renderer.Settings())
    began, processor = time.perf_counter(), time.process_time()
    estimate = renderer.render(scene, renderer.Target(spp=spp), renderer.Settings(size, size, seed, adaptive=True))
    return Cost(time.perf_counter() - began, estimate.seconds, time.process_time() - processor)


def listen(url: str) -> None:
    """One page that is told of every turn."""
    with contextlib.suppress(httpx.TransportError), httpx.stream("GET", f"{url}/api/events", timeout=None) as stream:
        for _ in stream.iter_raw():
            pass


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.service_overhead", description=__doc__)
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--spp", type=int, default=128)
    parser.add_argument("--rounds", type=int, default=5)
    given = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # the server is to end with this
    context = multiprocessing.get_context("spawn")
    alone = ProcessPoolExecutor(1, mp_context=context, initializer=begin, initargs=(None,))
    found: list[tuple[Cost, Cost]] = []
    with tempfile.TemporaryDirectory(prefix="fredholm-bench-") as folder:
        server = Server(Path(folder) / "data", {"FREDHOLM_LOG_LEVEL": "info"}).start()
        try:
            threading.Thread(target=listen, args=(server.url,), daemon=True).start()
            job_cost(server, 16, given.size, 0)
            alone.submit(alone_cost, 16, given.size, 0).result()
            for turn in range(given.rounds):
                # In turns, also who goes first: a machine that gets slower favours nobody.
                work = (given.spp, given.size, turn + 1)
                mine = alone.submit(alone_cost, *work).result() if turn % 2 else None
                job = job_cost(server, *work)
                mine = mine or alone.submit(alone_cost, *work).result()
                found.append((job, mine))
                print(
                    f"job {job.wall:.2f} s ({job.told:.2f} rendering; processor {job.processor:.2f}, server "
                    f"{job.server:.2f}), alone {mine.wall:.2f} s ({mine.told:.2f}; processor {mine.processor:.2f})",
                    flush=True,
                )
        finally:
            server.stop()
            alone.shutdown()

    def ratio(name: str) -> float:
        return statistics.median(getattr(job, name) / getattr(mine, name) for job, mine in found)

    print(f"job / renderer.render, render seconds: {ratio('told'):.3f} (aim: at most 1.05)")
    print(f"job / renderer.render, from start to end: {ratio('wall'):.3f}")
    print(f"job / renderer.render, processor seconds of the render process: {ratio('processor'):.3f}")
    server_share = statistics.median(job.server / mine.processor for job, mine in found)
    print(f"processor seconds of the server besides: {server_share:.3f}")


if __name__ == "__main__":
    main()
