"""`make coverage`: what the error bars, the stop rule, the forecast and adaptive sampling are worth, measured.

    python -m tests.coverage_study [coverage | stopping | adaptive …] [--scenes NAME …] [--runs N] [--quick]

Needs half an hour on two cores; --quick takes a few scenes and runs. See `bank.py` for what an independent run is.
"""

from __future__ import annotations

import argparse
import math

import numpy as np
from rich.console import Console
from rich.table import Table

from renderer.scene import gallery
from renderer.settings import Settings, Target, replicate_size_for
from tests.coverage_study import adaptive, coverage, rare_light, stopping
from tests.coverage_study.bank import fill, is_there

SHARED = (
    *("shared/veach-mis", "shared/veach-bidir", "shared/matpreview", "shared/thinlens", "shared/colour-cornell"),
    *("shared/room-manylights", "shared/cbox-glass-mirror", "shared/cornell-box"),
)
STOPPING = (
    *("cornell-box", "materials", "plates", "shared/matpreview", "shared/thinlens", "shared/colour-cornell"),
    *("shared/cornell-box", "shared/room-manylights"),
)
TARGETS = (0.10, 0.05, 0.02)
MORE_ADAPTIVE = (
    *("shared/caustic-ring", "shared/pool", "shared/veach-ajar"),
    *("shared/living-room", "shared/room-indirect", "shared/sdf-instance"),
)
OUT = Console(width=150)


def gallery_names() -> list[str]:
    """All built-in scenes."""
    return [scene.name for scene in gallery.list_scenes()]


def show_coverage(scenes: list[str], runs: int, quick: bool) -> None:
    """Coverage of trusted pixels by number of replicates; below, scenes whose light is hardly found."""
    counts = coverage.COUNTS
    table = Table(title=f"95 % intervals: trusted pixels (covered, of these), {runs} runs, replicates of 16 samples")
    for column in ("scene", *(f"n = {n}" for n in counts), "all n", "untested", "false"):
        table.add_column(column, justify="left" if column == "scene" else "right")
    for name in scenes:
        is_rare = name in rare_light.NAMES
        bank = fill(name, 2000 if is_rare else 600, 1024 if is_rare or quick else 2048)
        rows = coverage.measure(bank, runs)
        weight = sum(r.trusted for r in rows)
        pooled = sum(r.trusted * r.covered for r in rows) / weight if weight else math.nan
        cells = [f"{100 * r.trusted:.0f} % ({100 * r.covered:.1f})" if r.trusted > 1e-3 else "–" for r in rows]
        untested = sum(r.covered_untested for r in rows) / len(rows)
        false = max(r.false for r in rows)
        table.add_row(name, *cells, f"{100 * pooled:.1f}", f"{100 * untested:.1f}", f"{100 * false:.2f} %")
        OUT.print(f"[dim]{name}: {cells}, all {100 * pooled:.1f}, false {100 * false:.2f} %", highlight=False)
    OUT.print(table)
    OUT.print(
        "all n: covered, over all trusted pixels. untested: covered, over all pixels, trusted or not. false: trusted "
        "and more than two half widths off, of all pixels, at its worst n.",
        highlight=False,
    )


def show_stopping(scenes: list[str], runs: int, quick: bool) -> None:
    """Asked against true error."""
    table = Table(title=f"Stop at 95 % confidence: {runs} runs per target (20 at 2 % take as long as 500 at 10 %)")
    for column in (
        "scene",
        "asked",
        "runs",
        "reached",
        "spent/oracle",
        "spp",
        "size",
        "forecast",
        "within 25 %",
        "in interval",
    ):
        table.add_column(column, justify="left" if column == "scene" else "right")
    for name in scenes:
        for target in TARGETS:
            size = replicate_size_for(Settings(), Target(error=target))
            bank = fill(name, 2400, 512 if quick else 1024, size)
            row = stopping.measure(bank, target, max(20, runs // 2) if target < 0.04 else runs)
            cells = (
                *(f"{100 * target:g} %", str(row.runs), f"{100 * row.reached:.1f} %", f"{row.spent:.2f}"),
                *(f"{row.spp:.0f}", f"{size}", f"{100 * row.forecasts:.0f} %"),
                *(f"{100 * row.near:.0f} %", f"{100 * row.held:.0f} %"),
            )
            table.add_row(name, *cells)
            OUT.print(f"[dim]{name}: {cells}", highlight=False)
    OUT.print(table)


def show_adaptive(scenes: list[str], runs: int, quick: bool) -> None:
    """Gain of adaptive over uniform sampling."""
    table = Table(
        title=f"Adaptive over uniform sampling at {adaptive.SPP} spp: relMSE × processor time, mean of {runs}"
    )
    for column in ("scene", "gain at equal time", "at equal samples", "error of uniform"):
        table.add_column(column, justify="left" if column == "scene" else "right")
    gains = []
    for name in scenes:
        gain = adaptive.measure(name, 2500 if quick else 6000, runs)
        gains.append(gain.time)
        cells = (f"{gain.time:.2f}", f"{gain.samples:.2f}", f"{100 * gain.error:.1f} %")
        table.add_row(name, *cells)
        OUT.print(f"[dim]{name}: {cells}", highlight=False)
    table.add_section()
    table.add_row("geometric mean", f"{math.exp(float(np.mean(np.log(gains)))):.2f}", "", "")
    OUT.print(table)


def main() -> None:
    """Measures and prints."""
    parser = argparse.ArgumentParser(prog="python -m tests.coverage_study", description=__doc__)
    parser.add_argument("parts", nargs="*", choices=["coverage", "stopping", "adaptive", []], help="all by default")
    parser.add_argument(
        "--scenes", nargs="+", help="others than the usual ones; shared/NAME for those beside the checkout"
    )
    parser.add_argument("--runs", type=int, help="independent runs of each cell")
    parser.add_argument("--quick", action="store_true", help="smaller banks, fewer runs, a scene or two")
    asked = parser.parse_args()
    parts = asked.parts or ["coverage", "stopping", "adaptive"]
    usual = {
        "coverage": (show_coverage, [*gallery_names(), *SHARED, *rare_light.NAMES], 200),
        "stopping": (show_stopping, list(STOPPING), 100),
        "adaptive": (show_adaptive, [*gallery_names(), *SHARED, *MORE_ADAPTIVE], 3),
    }
    for part in parts:
        show, scenes, runs = usual[part]
        scenes = asked.scenes or (scenes[:1] if asked.quick else scenes)
        show(
            [s for s in scenes if is_there(s)], asked.runs or (max(2, runs // 10) if asked.quick else runs), asked.quick
        )


if __name__ == "__main__":
    main()
