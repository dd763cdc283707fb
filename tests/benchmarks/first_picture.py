"""How soon a scene shows its first picture, and what it needs in memory, in processes of their own.

    python -m tests.benchmarks.first_picture SCENE WIDTH [SECONDS]

`fresh`: a new process with no kernel compiled ever. `cold`: a new process, kernels compiled by an earlier one. `warm`:
the same process again, with another seed. Imports and loading count for the first two.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[2]


def first_picture(name: str, width: int, seconds: float) -> dict[str, float]:
    """Seconds to the first picture by the three ways, and the peak memory in bytes of rendering for `seconds`."""
    with tempfile.TemporaryDirectory() as home:  # Dr.Jit keeps its kernels there
        command = [sys.executable, "-m", "tests.benchmarks.first_picture", name, str(width), str(seconds)]
        runs = []
        for _ in range(2):
            done = subprocess.run(
                command, cwd=ROOT, env=os.environ | {"HOME": home}, capture_output=True, text=True, timeout=600
            )
            if done.returncode != 0:
                raise RuntimeError(f"{name}: {done.stderr.strip()[-400:]}")
            runs.append(json.loads(done.stdout.splitlines()[-1]))
    return {
        "first_picture_fresh": runs[0]["cold"],
        "first_picture_cold": runs[1]["cold"],
        "first_picture_warm": runs[1]["warm"],
        "peak_bytes": runs[1]["peak_bytes"],
    }


def _measure(name: str, width: int, seconds: float) -> dict[str, float]:
    began = time.perf_counter()
    import renderer
    from tests.benchmarks.scenes import source_of

    scene = renderer.load_scene(source_of(name), settings=renderer.Settings(width=width))
    settings = renderer.Settings(scene.width, scene.height)
    next(renderer.progressive(scene, renderer.Target(seconds=seconds), settings))
    cold = time.perf_counter() - began
    began = time.perf_counter()
    next(renderer.progressive(scene, renderer.Target(seconds=seconds), renderer.Settings(scene.width, scene.height, 1)))
    warm = time.perf_counter() - began
    renderer.render(scene, renderer.Target(seconds=seconds), settings)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    return {"cold": cold, "warm": warm, "peak_bytes": peak}


if __name__ == "__main__":
    print(json.dumps(_measure(sys.argv[1], int(sys.argv[2]), float(sys.argv[3]) if len(sys.argv) > 3 else 1.0)))
