"""`make extremes`: energy kept at every scale and distance, beside Mitsuba's own `path` and without the rewrite.

Each cell is the mean of the picture over that of the same scene at scale 1 and offset 0 (1 = nothing lost), rendered
with one seed, so that the same paths are compared.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

import renderer
from renderer.backend import mitsuba
from renderer.scene.compile import load_scene
from renderer.scene.rewrite import passes
from tests.extremes.extreme_scenes import SCENES, written

SCALES = [10.0**e for e in range(-6, 7)]
OFFSETS = [0.0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6]
SPP = 64


def ours(path: Path, *, rewritten: bool = True) -> float:
    """Mean of our picture."""
    rewrites = [name for name in passes.ALL if rewritten or name != passes.SIMILARITY]
    scene = load_scene(path, rewrites=rewrites)
    return float(renderer.render(scene, renderer.Target(spp=SPP), renderer.Settings(seed=1)).mean.mean())


def theirs(path: Path) -> float:
    """Mean of Mitsuba's."""
    mi = mitsuba()
    return float(np.nanmean(np.array(mi.render(mi.load_file(str(path)), spp=4 * SPP, seed=1))))


def main() -> None:
    """Prints one table per scene."""
    out = Console(width=100)
    with tempfile.TemporaryDirectory() as folder:
        for name in SCENES:
            base = written(Path(folder), name)
            whole = (ours(base), ours(base, rewritten=False), theirs(base))
            table = Table("scale", "offset", "ours", "without the rewrite", "Mitsuba path", title=name)
            for k, offset in [(k, 0.0) for k in SCALES] + [(1.0, offset) for offset in OFFSETS]:
                path = written(Path(folder), name, k, offset)
                found = (ours(path), ours(path, rewritten=False), theirs(path))
                shares = [f"{mean / of:.4f}" for mean, of in zip(found, whole, strict=True)]
                table.add_row(f"{k:g}", f"{offset:g}", *shares)
            out.print(table)


if __name__ == "__main__":
    sys.exit(main())
