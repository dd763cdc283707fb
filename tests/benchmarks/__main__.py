"""`make bench`: our kernel and Mitsuba's `path`, side by side in one run, as ratios.

    python -m tests.benchmarks [SCENE …] [--size N] [--seconds S] [--json FILE]

Samples per second, ours with variances, Mitsuba's without: interleaved, both warm, the median of several rounds.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

import renderer
from renderer.backend import mitsuba

SCENES = ("cornell-box", "veach-bidir")
SHARED = Path(__file__).parents[3] / "shared" / "scenes"
ROUNDS = 5


def source_of(name: str) -> str | Path:
    """A shared scene where there is one of that name, else the gallery's."""
    shared = SHARED / name / "scene.xml"
    return shared if shared.is_file() else name


def measure(name: str, size: int, seconds: float) -> dict[str, Any]:
    """One scene: rates of both, in one process, taking turns."""
    mi = mitsuba()
    settings = renderer.Settings(width=size, height=size, seed=1)
    scene = renderer.load_scene(source_of(name), settings=settings)
    needs = scene.requirements
    path: Any = mi.load_dict({"type": "path", "max_depth": needs.max_depth, "rr_depth": needs.rr_depth})

    def ours(budget: float, seed: int) -> tuple[renderer.Estimate, float]:
        began = time.perf_counter()
        estimate = renderer.render(scene, renderer.Target(seconds=budget), renderer.Settings(size, size, seed))
        return estimate, time.perf_counter() - began

    def theirs(spp: int, seed: int) -> tuple[np.ndarray, float]:
        began = time.perf_counter()
        image = np.array(mi.render(scene.mitsuba_scene, sensor=scene.sensor, integrator=path, spp=spp, seed=seed))
        return image[..., :3], time.perf_counter() - began

    ours(0.2, 0)
    theirs(4, 0)  # both warm
    _, took = theirs(16, 0)
    spp = max(4, round(16 * seconds / took))
    rates: list[tuple[float, float]] = []
    for turn in range(ROUNDS):
        estimate, our_seconds = ours(seconds, turn + 1)
        _, their_seconds = theirs(spp, turn + 1)
        rates.append((estimate.samples / our_seconds, spp * size * size / their_seconds))
    return {
        "scene": name,
        "size": size,
        "samples_per_second": statistics.median(r[0] for r in rates),
        "path_samples_per_second": statistics.median(r[1] for r in rates),
        "rate_ratio": statistics.median(a / b for a, b in rates),
    }


def main() -> None:
    """Measures and prints a table; JSON lines on request."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks", description=__doc__)
    parser.add_argument("scenes", nargs="*", default=list(SCENES))
    parser.add_argument("--size", type=int, default=256, help="pixels per side (default 256)")
    parser.add_argument("--seconds", type=float, default=2.0, help="of each render (default 2)")
    parser.add_argument("--json", type=Path, help="also write JSON lines to this file")
    asked = parser.parse_args()
    table = Table(title="Fredholm against Mitsuba `path` (ratios above 1: Fredholm is better)")
    for column in ("scene", "Msamples/s", "path Msamples/s", "rate ×"):
        table.add_column(column, justify="right" if column != "scene" else "left")
    rows = []
    for name in asked.scenes:
        row = measure(name, asked.size, asked.seconds)
        rows.append(row)
        table.add_row(
            name,
            f"{row['samples_per_second'] / 1e6:.2f}",
            f"{row['path_samples_per_second'] / 1e6:.2f}",
            f"{row['rate_ratio']:.2f}",
        )
    Console().print(table)
    if asked.json:
        asked.json.write_text("".join(json.dumps(row) + "\n" for row in rows))


if __name__ == "__main__":
    main()
