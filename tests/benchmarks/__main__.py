"""`make bench`: Fredholm and Mitsuba's `path`, side by side in one run, as ratios.

    python -m tests.benchmarks [--scenes NAME …] [--width N] [--seconds S] [--samplers NAME …] [--json FILE] [--smoke]

Scenes are rendered as they were written, with their own film filter and depth: samples per processor second (ours with
variances, theirs without), and relMSE at equal processor time against a converged reference. Renders take turns, both
warm; medians of several rounds are shown, with the 95 % interval of the error ratio over them: where fireflies decide,
it is wide, and such a scene is measured again in renders of ten times the length (†). `99 %` is the same without the
worst hundredth of the pixels; `boxed` the same with a box filter for both. Beside them: rays per second, as a share of
what the same rays take when they are cast alone; the first picture of a new process and of a warm one; peak memory.
Scenes that nothing was tuned on come first. All shared surface scenes and the gallery by default: about two hours.
Results are kept line by line: the same command again goes on where it was stopped; `--again` starts over.
"""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from tests.benchmarks import scenes
from tests.benchmarks.compare import Effort, compare
from tests.benchmarks.peer import SAMPLERS

RESULTS = Path(__file__).parents[1] / "output" / "bench.jsonl"
SMOKE = Effort(width=32, seconds=0.1, rounds=1, reference_seconds=0.5, keep_reference=False)
TABLE_WIDTH = 168
KEYS = (
    "rate_ratio",
    "error_ratio",
    "typical_error_ratio",
    "boxed_error_ratio",
    "error_ratio_to_best",
)  # of the geometric means


def table_of(rows: list[dict[str, Any]]) -> Table:
    """The results for people."""
    table = Table(title="Fredholm against Mitsuba `path` (ratios above 1: Fredholm is better)")
    table.add_column("scene")
    columns = (
        "Msamples/s",
        "path",
        "rate ×",
        "Mrays/s",
        "limit %",
        "relMSE",
        "path",
        "error² ×",
        "(95 %)",
        "99 %",
        "boxed",
        "best",
        "error² ×",
    )
    for column in (*columns, "cold s", "warm s", "MiB"):
        table.add_column(column, justify="right")
    for row in rows:
        table.add_row(
            row["scene"] + ("†" if row["seconds"] > row["asked_seconds"] else ""),
            f"{row['samples_per_second'] / 1e6:.2f}",
            f"{row['path_samples_per_second'] / 1e6:.2f}",
            f"{row['rate_ratio']:.2f}",
            f"{row['rays_per_second'] / 1e6:.1f}",
            f"{100 * row['ray_limit_share']:.0f}",
            f"{row['rel_mse']:.2e}",
            f"{next(iter(row['path_rel_mse'].values())):.2e}",
            f"{row['error_ratio']:.2f}" + ("*" if row["reference_share"] > 0.3 else ""),
            "{:.2f}–{:.2f}".format(*row["error_ratio_interval"]),
            f"{row['typical_error_ratio']:.2f}",
            f"{row['boxed_error_ratio']:.2f}",
            row["best_sampler"],
            f"{row['error_ratio_to_best']:.2f}",
            f"{row['first_picture_cold']:.2f}",
            f"{row['first_picture_warm']:.2f}",
            f"{row['peak_bytes'] / 2**20:.0f}",
        )
    judged = [row for row in rows if row["scene"] in scenes.JUDGED_ON]
    for title, some in (("geometric mean", rows), ("of those not tuned on", judged)):
        if len(some) < 2:
            continue
        means = {key: _geometric_mean(some, key) for key in KEYS}
        table.add_section()
        table.add_row(
            title,
            *("", "", f"{means['rate_ratio']:.2f}"),
            *("", "", "", "", f"{means['error_ratio']:.2f}"),
            *("", f"{means['typical_error_ratio']:.2f}", f"{means['boxed_error_ratio']:.2f}"),
            *("", f"{means['error_ratio_to_best']:.2f}"),
        )
    table.caption = (
        f"relMSE after {rows[0]['asked_seconds']:g} s († ten times as long), {rows[0]['width']} pixels wide, medians "
        f"of {rows[0]['rounds']}; * the reference itself is not much better than the images: take the ratio as a hint"
    )
    return table


def _geometric_mean(rows: list[dict[str, Any]], key: str) -> float:
    positive = [row[key] for row in rows if row[key] > 0]
    return math.exp(sum(map(math.log, positive)) / len(positive)) if positive else math.nan


def _kept(file: Path, effort: Effort) -> dict[str, dict[str, Any]]:
    """By scene, the newest result of an earlier run of the same effort."""
    rows = [json.loads(line) for line in file.read_text().splitlines()] if file.is_file() else []
    asked = (effort.width, effort.seconds, effort.rounds, list(effort.samplers))
    return {
        row["scene"]: row
        for row in rows
        if (row["width"], row.get("asked_seconds"), row["rounds"], list(row["path_rel_mse"])) == asked
        and "boxed_error_ratio" in row  # older ones were of another kind
    }


def main() -> None:
    """Measures and prints a table; JSON lines on request."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks", description=__doc__)
    parser.add_argument("--scenes", nargs="+", default=[], help="shared scenes, gallery/NAME or paths (default: all)")
    parser.add_argument("--width", type=int, default=Effort.width, help="pixels (default %(default)s)")
    parser.add_argument("--seconds", type=float, default=Effort.seconds, help="of each render (default %(default)s)")
    parser.add_argument("--rounds", type=int, default=Effort.rounds, help="renders of each (default %(default)s)")
    parser.add_argument(
        "--reference-seconds", type=float, default=Effort.reference_seconds, help="(default %(default)s; cached)"
    )
    parser.add_argument(
        "--samplers", nargs="+", default=SAMPLERS, help="of `path` (default: all; the first is compared)"
    )
    parser.add_argument("--smoke", action="store_true", help="tiny and quick: does it run at all?")
    parser.add_argument("--json", type=Path, default=RESULTS, help="JSON lines, kept and gone on from (%(default)s)")
    parser.add_argument("--again", action="store_true", help="measure again what the file already holds")
    asked = parser.parse_args()
    samplers = tuple(asked.samplers)
    effort = Effort(asked.width, asked.seconds, asked.rounds, asked.reference_seconds, samplers=samplers)
    names = asked.scenes or scenes.every_scene()
    if asked.smoke:
        effort, names = SMOKE, asked.scenes or scenes.SMOKE
    console = Console()
    console.width = max(console.width, TABLE_WIDTH)
    kept = {} if asked.again else _kept(asked.json, effort)
    rows = []
    for name in names:
        if name not in kept:
            with console.status(f"{name} …"):
                kept[name] = compare(name, effort)
            asked.json.parent.mkdir(parents=True, exist_ok=True)
            with asked.json.open("a") as lines:
                lines.write(json.dumps(kept[name]) + "\n")
        rows.append(kept[name])
    console.print(table_of(rows))


if __name__ == "__main__":
    main()
