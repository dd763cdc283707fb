"""What the service costs a render: seconds of a job against `renderer.render` of the same picture, in one run.

    python -m tests.benchmarks.service_overhead [--size N] [--spp N] [--rounds N]

Both sides count wall-clock seconds of the same work, warm, in turns: the job from its start to its end as the service
records them, with frames shown and estimates saved on the way. The ratio is what is reported.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from datetime import datetime
from pathlib import Path

import renderer
from tests.service.service_process import Server


def job_seconds(server: Server, spp: int, size: int, seed: int) -> tuple[float, float]:
    """From start to end, and of rendering alone, as the job tells."""
    settings = {"width": size, "height": size, "seed": seed}
    job = server.wait_ended(server.submit({"spp": spp}, settings)["id"], 600)
    assert job["state"] == "succeeded", job
    started, finished = (datetime.fromisoformat(job[name]) for name in ("started_at", "finished_at"))
    return (finished - started).total_seconds(), job["seconds"]


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.service_overhead", description=__doc__)
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--spp", type=int, default=512)
    parser.add_argument("--rounds", type=int, default=5)
    given = parser.parse_args()
    scene = renderer.load_scene("cornell-box")
    walls: list[float] = []
    renders: list[float] = []
    with tempfile.TemporaryDirectory(prefix="fredholm-bench-") as folder:
        server = Server(Path(folder) / "data", {"FREDHOLM_LOG_LEVEL": "warning"}).start()
        try:
            job_seconds(server, 32, given.size, 0)
            renderer.render(scene, renderer.Target(spp=32), renderer.Settings(given.size, given.size, 0))
            for turn in range(given.rounds):
                wall, told = job_seconds(server, given.spp, given.size, turn + 1)
                began = time.perf_counter()
                settings = renderer.Settings(given.size, given.size, turn + 1)
                estimate = renderer.render(scene, renderer.Target(spp=given.spp), settings)
                alone = time.perf_counter() - began
                walls.append(wall / alone)
                renders.append(told / estimate.seconds)
                print(f"job {wall:.2f} s ({told:.2f} s rendering), alone {alone:.2f} s ({estimate.seconds:.2f} s)")
        finally:
            server.stop()
    print(f"job / renderer.render, render seconds: {statistics.median(renders):.3f} (aim: at most 1.05)")
    print(f"job / renderer.render, from start to end: {statistics.median(walls):.3f}")


if __name__ == "__main__":
    main()
