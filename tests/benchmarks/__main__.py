"""`make bench`: Fredholm and Mitsuba's `path`, side by side in one run, as ratios.

    python -m tests.benchmarks [SCENE …] [--all] [--width N] [--seconds S] [--json FILE] [--smoke]

Samples per second (ours with variances, theirs without) and relMSE at equal time against a converged reference, through
one box filter. Renders take turns, both warm; the medians of several rounds are shown. The range of the error ratio
over the rounds says how far to believe it: where fireflies decide, it is wide.
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

SMOKE = Effort(width=32, seconds=0.1, rounds=1, reference_seconds=0.5, keep_reference=False)
TABLE_WIDTH = 118


def table_of(rows: list[dict[str, Any]]) -> Table:
    """The results for people."""
    table = Table(title="Fredholm against Mitsuba `path` (ratios above 1: Fredholm is better)")
    table.add_column("scene")
    for column in ("Msamples/s", "path", "rate ×", "relMSE", "path", "error² ×", "(range)", "path's best", "error² ×"):
        table.add_column(column, justify="right")
    for row in rows:
        table.add_row(
            row["scene"],
            f"{row['samples_per_second'] / 1e6:.2f}",
            f"{row['path_samples_per_second'] / 1e6:.2f}",
            f"{row['rate_ratio']:.2f}",
            f"{row['rel_mse']:.2e}",
            f"{next(iter(row['path_rel_mse'].values())):.2e}",
            f"{row['error_ratio']:.2f}" + ("*" if row["reference_share"] > 0.3 else ""),
            "{:.2f}–{:.2f}".format(*row["error_ratio_range"]),
            row["best_sampler"],
            f"{row['error_ratio_to_best']:.2f}",
        )
    if len(rows) > 1:
        means = {key: _geometric_mean(rows, key) for key in ("rate_ratio", "error_ratio", "error_ratio_to_best")}
        table.add_section()
        table.add_row(
            "geometric mean",
            *("", "", f"{means['rate_ratio']:.2f}"),
            *("", "", f"{means['error_ratio']:.2f}"),
            *("", "", f"{means['error_ratio_to_best']:.2f}"),
        )
    table.caption = (
        f"relMSE after {rows[0]['seconds']:g} s, {rows[0]['width']} pixels wide, medians of {rows[0]['rounds']}"
        "; * the reference itself is not much better than the images: take the ratio as a hint"
    )
    return table


def _geometric_mean(rows: list[dict[str, Any]], key: str) -> float:
    positive = [row[key] for row in rows if row[key] > 0]
    return math.exp(sum(map(math.log, positive)) / len(positive)) if positive else math.nan


def main() -> None:
    """Measures and prints a table; JSON lines on request."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks", description=__doc__)
    parser.add_argument("scenes", nargs="*", help="shared scenes, gallery/NAME or paths")
    parser.add_argument("--all", action="store_true", help="every shared surface scene and the gallery")
    parser.add_argument("--width", type=int, default=Effort.width, help="pixels (default %(default)s)")
    parser.add_argument("--seconds", type=float, default=Effort.seconds, help="of each render (default %(default)s)")
    parser.add_argument("--rounds", type=int, default=Effort.rounds, help="renders of each (default %(default)s)")
    parser.add_argument(
        "--reference-seconds", type=float, default=Effort.reference_seconds, help="(default %(default)s; cached)"
    )
    parser.add_argument("--smoke", action="store_true", help="tiny and quick: does it run at all?")
    parser.add_argument("--json", type=Path, help="also write JSON lines to this file")
    asked = parser.parse_args()
    scenes.use_box_filters()
    effort = Effort(asked.width, asked.seconds, asked.rounds, asked.reference_seconds)
    names = asked.scenes or (scenes.every_scene() if asked.all else scenes.DEFAULT)
    if asked.smoke:
        effort, names = SMOKE, asked.scenes or scenes.SMOKE
    console = Console()
    console.width = max(console.width, TABLE_WIDTH)
    rows = []
    if asked.json:
        asked.json.write_text("")
    for name in names:
        with console.status(f"{name} …"):
            rows.append(compare(name, effort))
        if asked.json:
            with asked.json.open("a") as lines:
                lines.write(json.dumps(rows[-1]) + "\n")
    console.print(table_of(rows))


if __name__ == "__main__":
    main()
