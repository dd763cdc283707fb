"""What looking at a scene costs: loading it with Fredholm, beside plain `mi.load_file`, as a ratio within one run.

    python -m tests.benchmarks.loading [SCENE …] [--rounds N]

Ours parses, vets, measures, hashes and rewrites the scene as well, and ends with the same Mitsuba scene. Both take
turns in one process, files in the system's cache; medians over the rounds, the first of which is not counted.
"""

from __future__ import annotations

import argparse
import statistics
import time
from typing import Any

from rich.console import Console
from rich.table import Table

from renderer.backend import mitsuba
from renderer.scene.compile import load_scene
from tests.benchmarks.scenes import SHARED, source_of

ROUNDS = 7
TABLE_WIDTH = 100


def compare(path: str, rounds: int) -> dict[str, Any]:
    """Median seconds of both, and the median and the range of their ratio over the rounds."""
    ours, theirs = [], []
    for _ in range(rounds + 1):
        theirs.append(_seconds(lambda: mitsuba().load_file(path)))
        ours.append(_seconds(lambda: load_scene(path)))
    ratios = sorted(a / b for a, b in zip(ours[1:], theirs[1:], strict=True))
    return {
        "seconds": statistics.median(ours[1:]),
        "mitsuba_seconds": statistics.median(theirs[1:]),
        "ratio": statistics.median(ratios),
        "range": (ratios[0], ratios[-1]),
    }


def _seconds(load: Any) -> float:
    began = time.perf_counter()
    made = load()
    took = time.perf_counter() - began
    del made  # freeing a scene is not loading it
    return took


def main() -> None:
    """Prints a table."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.loading", description=__doc__)
    parser.add_argument("scenes", nargs="*", help="shared scenes or paths of .xml files; all shared ones by default")
    parser.add_argument("--rounds", type=int, default=ROUNDS, help="loads of each (default %(default)s)")
    asked = parser.parse_args()
    names = asked.scenes or sorted(path.parent.name for path in SHARED.glob("*/scene.xml"))
    table = Table("scene", title="Loading a scene, against plain mi.load_file")
    for column in ("Fredholm s", "Mitsuba s", "ratio", "(range)"):
        table.add_column(column, justify="right")
    out = Console()
    out.width = max(out.width, TABLE_WIDTH)
    for name in names:
        try:
            found = compare(str(source_of(name)), asked.rounds)
        except Exception as error:  # what one of the two refuses is no comparison
            table.add_row(name, f"[dim]{str(error).splitlines()[0][:60]}[/dim]")
            continue
        low, high = found["range"]
        seconds = (f"{found[key]:.3f}" for key in ("seconds", "mitsuba_seconds"))
        table.add_row(name, *seconds, f"{found['ratio']:.2f}", f"{low:.2f}–{high:.2f}")
    out.print(table)


if __name__ == "__main__":
    main()
