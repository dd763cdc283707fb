"""Which replicate size? Variance, time and interval quality for B = 1 … 64, from independent runs.

    python -m tests.benchmarks.replicate_size [SCENE …] [--width N] [--spp N] [--runs N] [--out FOLDER]

At equal samples per pixel a large B stratifies more samples together (less variance) but leaves fewer replicates for an
error bar (worse intervals). Coverage needs no reference: each run is held against the mean of the others, whose own
spread is allowed for. The sizes take turns, so that a busy machine slows all alike.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

import renderer
from renderer.estimate.error import pixel_rel_mse
from renderer.estimate.interval import t_quantile
from tests.benchmarks import scenes

SIZES = (1, 4, 8, 16, 32, 64)
SCENES = (
    *(f"gallery/{s.name}" for s in renderer.gallery.list_scenes()),
    *("cornell-box", "veach-mis", "veach-bidir", "matpreview", "living-room", "room-indirect", "room-manylights"),
)
MIN_SHARE = 0.05
RESULTS = Path(__file__).parent / "results"


def measure(name: str, width: int, spp: int, runs: int) -> list[dict[str, Any]]:
    """One row per replicate size."""
    scene = scenes.load(name, width)
    seconds: dict[int, list[float]] = {size: [] for size in SIZES}
    estimates: dict[int, list[renderer.Estimate]] = {size: [] for size in SIZES}
    for run in range(-1, runs):  # the first warms up
        for size in SIZES:
            settings = renderer.Settings(seed=1000 + run, replicate_size=size, adaptive=False)
            began = time.perf_counter()
            estimate = renderer.render(scene, renderer.Target(spp=spp if run >= 0 else size), settings)
            if run >= 0:
                seconds[size].append(time.perf_counter() - began)
                estimates[size].append(estimate)
    rows = []
    for size in SIZES:
        rel_mse = float(np.mean([pixel_rel_mse(e.moments).mean() for e in estimates[size]]))
        covered, covered_trusted, trusted = coverage(estimates[size])
        rows.append(
            {
                "scene": name,
                "replicate_size": size,
                "replicates": spp // size,
                "rel_mse": rel_mse,
                "seconds": float(np.median(seconds[size])),
                "variance_time": rel_mse * float(np.median(seconds[size])),
                "coverage": covered,
                "coverage_trusted": covered_trusted,
                "share_trusted": trusted,
            }
        )
    return rows


def coverage(runs: list[renderer.Estimate]) -> tuple[float, float, float]:
    """Share of 95 % intervals of luminance that hold the truth: of all lit pixels, of trusted ones; share trusted.

    A run's difference from the mean of the k others has the variance of both, (1 + 1/k) of its own.
    """
    y = np.array([e.moments.luminance() for e in runs])
    variance = np.array([e.moments.variance_of_mean()[:, 3] for e in runs])
    trust = np.array([e.trust.ravel() for e in runs])
    count = runs[0].moments.count
    k = len(runs) - 1
    others = (y.sum(axis=0) - y) / k
    quantile = t_quantile(0.975, np.maximum(count - 1, 1))
    # Rounding of constant pixels is no error.
    inside = np.abs(y - others) <= quantile * np.sqrt(variance * (1 + 1 / k)) + 1e-6 * np.abs(others)
    lit = np.broadcast_to(y.max(axis=0) > 0, y.shape)
    of_trusted = float(inside[trust & lit].mean()) if (trust & lit).any() else math.nan
    return float(inside[lit].mean()), of_trusted, float(trust.mean())


def markdown(rows: list[dict[str, Any]], note: str) -> str:
    """Variance × time over that of B = 1, and coverage, scene by scene."""
    head = "| scene | " + " | ".join(f"B = {size}" for size in SIZES) + " |"
    rule = "|---" * (len(SIZES) + 1) + "|"
    names = list(dict.fromkeys(row["scene"] for row in rows))
    of = {(row["scene"], row["replicate_size"]): row for row in rows}

    def table(title: str, cell: Any, last: Any) -> list[str]:
        lines = [f"\n**{title}**\n", head, rule]
        lines += [f"| {n} | " + " | ".join(cell(n, size) for size in SIZES) + " |" for n in names]
        return [*lines, "| " + last[0] + " | " + " | ".join(last[1](size) for size in SIZES) + " |"]

    def gain(key: str, name: str, size: int) -> float:
        return of[name, 1][key] / max(of[name, size][key], 1e-30)

    def mean_gain(key: str, size: int) -> str:
        gains = [gain(key, n, size) for n in names if of[n, size][key] > 1e-9]
        return f"**{math.exp(np.mean(np.log(gains))):.2f}**"

    def value(key: str, name: str, size: int) -> float:
        row = of[name, size]
        # A handful of trusted pixels says nothing of how often trust is deserved.
        is_known = key != "coverage_trusted" or row["share_trusted"] >= MIN_SHARE
        return row[key] if is_known else math.nan

    def say(share: float) -> str:
        return "–" if math.isnan(share) else f"{100 * share:.1f}"

    def covered(key: str) -> Any:
        return lambda n, size: say(value(key, n, size))

    def mean_covered(key: str) -> Any:
        def mean(size: int) -> str:
            known = [v for n in names if not math.isnan(v := value(key, n, size))]
            return f"**{say(sum(known) / len(known))}**" if known else "–"

        return mean

    lines = ["# Replicate size", "", note]
    for key, title in (("rel_mse", "Variance: that of B = 1 over that of B"), ("variance_time", "The same × time")):
        lines += table(
            title,
            lambda n, size, key=key: f"{gain(key, n, size):.2f}" if of[n, size][key] > 1e-9 else "exact",
            ("geometric mean", lambda size, key=key: mean_gain(key, size)),
        )
    for key, title in (
        ("coverage", "Coverage of 95 % intervals, all pixels, %"),
        ("coverage_trusted", "Coverage of 95 % intervals, trusted pixels, %"),
        ("share_trusted", "Pixels trusted, %"),
    ):
        lines += table(title, covered(key), ("mean", mean_covered(key)))
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measures, prints and keeps the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.replicate_size", description=__doc__)
    parser.add_argument("scenes", nargs="*", default=list(SCENES))
    parser.add_argument("--width", type=int, default=48)
    parser.add_argument("--spp", type=int, default=256)
    parser.add_argument("--runs", type=int, default=6)
    parser.add_argument("--add", action="store_true", help="keep the scenes that the folder holds already")
    parser.add_argument("--out", type=Path, default=RESULTS)
    asked = parser.parse_args()
    note = (
        f"`python -m tests.benchmarks.replicate_size --width {asked.width} --spp {asked.spp} --runs {asked.runs}`: "
        f"{asked.spp} samples per pixel, {asked.width} pixels wide, even sampling, {asked.runs} runs of each."
    )
    asked.out.mkdir(exist_ok=True)
    kept = asked.out / "replicate_size.json"
    rows: list[dict[str, Any]] = json.loads(kept.read_text()) if asked.add and kept.is_file() else []
    rows = [row for row in rows if row["scene"] not in asked.scenes]
    for name in asked.scenes:
        rows += measure(name, asked.width, asked.spp, asked.runs)
        kept.write_text(json.dumps(rows, indent=1) + "\n")
        (asked.out / "replicate_size.md").write_text(markdown(rows, note))
    Console().print(markdown(rows, note), markup=False)


if __name__ == "__main__":
    main()
