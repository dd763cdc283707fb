"""`make coverage`: what the error bars, the stop rule, the forecast and adaptive sampling are worth, measured.

    python -m tests.coverage_study [coverage | stopping | adaptive | partial | rare | meters | media …]
        [--scenes NAME …] [--runs N] [--targets ERROR …] [--quick]

Needs half an hour on two cores; --quick takes a few scenes and runs. See `bank.py` for what an independent run is.
"""

from __future__ import annotations

import argparse
import math
from functools import partial as partial_of

import numpy as np
from rich.console import Console
from rich.table import Table

from renderer.audit.behind import lights_behind
from renderer.scene import gallery
from renderer.settings import Settings, Target, replicate_size_for
from tests.coverage_study import adaptive, coverage, hidden, hidden_light, meters, partial, rare_light, stopping
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
PARTIAL = ("shared/matpreview", "shared/living-room", "shared/veach-ajar", "shared/room-manylights")
MEDIA = ("shared/vol-cbox", "smoke", "cloudy-glass")  # even, a grid, and behind glass
PARTS = ("coverage", "stopping", "adaptive", "partial", "rare", "meters", "media")
METER_TARGETS = (0.05, 0.01)
LARGE = ("cornell-box", "materials", "shared/matpreview")  # that are rendered at all sizes
RARE = [*hidden_light.NAMES, *hidden_light.MORE_NAMES, *hidden_light.REACHABLE]
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


def show_partial(scenes: list[str], runs: int, quick: bool) -> None:
    """Said and true error of pictures that a time ends, alone and beside other renders; what is off is marked."""
    table = Table(title=f"Said over true error after so many seconds; off where not {partial.LOW} … {partial.HIGH}")
    for column in ("scene", "size", "beside", "seconds", "spp", "replicate", "two", "said", "true", "ratio", ""):
        table.add_column(column, justify="left" if column == "scene" else "right")
    rows = []
    for name in scenes:
        for width, height in partial.SIZES[: 1 if quick or name not in LARGE else None]:
            scene = partial.sized(name, width, height)
            reference = partial.reference_of(scene, 5.0 if quick else 30.0)
            for others in (0, partial.BESIDE):
                with partial.beside(others):
                    cases = [(s, run) for s in partial.BUDGETS[width][: 2 if quick else None] for run in range(runs)]
                    found = [partial.measure(scene, reference, seconds, 500 + run) for seconds, run in cases]
                for row in found:
                    cells = (
                        *(f"{width}×{height}", str(others), f"{row.seconds:g}", f"{row.spp:.1f}", str(row.size)),
                        f"{100 * row.two:.1f} %",
                        "–" if row.said is None else f"{100 * row.said:.1f} %",
                        *(f"{100 * row.true:.1f} %", "–" if row.ratio is None else f"{row.ratio:.2f}"),
                        "off" if row.is_off else "",
                    )
                    table.add_row(name, *cells)
                    OUT.print(f"[dim]{name}: {cells}", highlight=False)
                rows += found
    OUT.print(table)
    said = [row for row in rows if row.said is not None]
    OUT.print(f"{len(said)} of {len(rows)} said, {sum(row.is_off for row in said)} of them off", highlight=False)


def show_rare(scenes: list[str], runs: int, quick: bool, targets: tuple[float, ...]) -> None:
    """Light that is hardly ever found: targets called reached, pixels trusted, and whether the cause is named."""
    table = Table(title=f"Light that is hardly ever found: {runs} runs, each to its target or {hidden.MOST_SPP} spp")
    for column in ("scene", "asked", "reached", "wrong", "trusted", "far", "named", "inspect", "means / truth"):
        table.add_column(column, justify="left" if column == "scene" else "right")
    for name in scenes:
        truth, scene = hidden.reference_of(name, 2.0 if quick else 8.0), hidden.loaded(name)
        is_named = bool(lights_behind(scene, scene.resolved(Settings(), 16)))
        for target in targets:
            row = hidden.measure(scene, truth, target, runs)
            cells = (
                *(f"{100 * target:g} %", str(row.reached), str(row.wrong), f"{100 * row.trusted:.1f} %"),
                *(f"{100 * row.far:.1f} %", str(row.named), "yes" if is_named else "no"),
                f"{row.mean[0]:.2f} … {row.mean[1]:.2f}",
            )
            table.add_row(name, *cells)
            OUT.print(f"[dim]{name}: {cells}", highlight=False)
    OUT.print(table)
    OUT.print(
        "wrong: reached, and the mean of the image more than twice the said error off. far: of trusted pixels, those "
        "more than three half widths off. named: runs whose health names the light; inspect: whether it does.",
        highlight=False,
    )


def show_meters(names: list[str], runs: int, quick: bool) -> None:
    """Readings of meters against the truth."""
    table = Table(title=f"Meters, stopped at 95 % confidence: {runs} runs per target")
    for column in ("meter", "asked", "within it", "interval covers", "samples", "truth"):
        table.add_column(column, justify="left" if column == "meter" else "right")
    for name in names:
        for target in METER_TARGETS[:1] if quick else METER_TARGETS:
            row = meters.measure(name, target, runs)
            shares = f"{100 * row.below:.1f} %", f"{100 * row.covered:.1f} %"
            table.add_row(name, f"{100 * target:g} %", *shares, f"{row.spp:.0f}", f"{row.truth:.5g}")
    OUT.print(table)


def show_media(scenes: list[str], runs: int, quick: bool) -> None:
    """Error bars and stop rule of scenes with participating media."""
    show_coverage(scenes, runs, quick)
    show_stopping(scenes, runs, quick)


def main() -> None:
    """Measures and prints."""
    parser = argparse.ArgumentParser(prog="python -m tests.coverage_study", description=__doc__)
    parser.add_argument("parts", nargs="*", choices=[*PARTS, []], help="all by default")
    parser.add_argument(
        "--scenes", nargs="+", help="others than the usual ones; shared/NAME for those beside the checkout"
    )
    parser.add_argument("--runs", type=int, help="independent runs of each cell")
    parser.add_argument("--targets", nargs="+", type=float, default=hidden.TARGETS, help="errors, for rare light")
    parser.add_argument("--quick", action="store_true", help="smaller banks, fewer runs, a scene or two")
    asked = parser.parse_args()
    parts = asked.parts or list(PARTS)
    usual = {
        "coverage": (show_coverage, [*gallery_names(), *SHARED, *rare_light.NAMES], 200),
        "stopping": (show_stopping, list(STOPPING), 100),
        "adaptive": (show_adaptive, [*gallery_names(), *SHARED, *MORE_ADAPTIVE], 3),
        "partial": (show_partial, [*gallery_names(), *PARTIAL], 1),
        "rare": (partial_of(show_rare, targets=tuple(asked.targets)), RARE, 20),
        "meters": (show_meters, list(meters.scenes()), 200),
        "media": (show_media, list(MEDIA), 200),
    }
    for part in parts:
        show, scenes, runs = usual[part]
        scenes = asked.scenes or (scenes[:1] if asked.quick else scenes)
        kept = [s for s in scenes if part in ("rare", "meters") or is_there(s)]
        show(kept, asked.runs or (max(2, runs // 10) if asked.quick else runs), asked.quick)


if __name__ == "__main__":
    main()
