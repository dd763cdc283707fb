"""How the light of a shadow ray that a grid lets pass is best estimated: variance times cost of unbiased estimators.

    python -m tests.benchmarks.transmittance [--rays N] [--estimates N]

Rays from side to side of three grids (the gallery's plume, sparse puffs, and a nearly even one), at several optical
depths: those of the densest voxel over the whole width. The cost is the number of grid values asked for, and of cells
walked through, of which CELL count as one value. NumPy alone: the same mathematics as in `equation/media.py`, written
apart from it.

- *one majorant*: ratio tracking at the rate of the densest voxel.
- *lattice*: ratio tracking at the rate of each cell's densest voxel.
- *least*, *mean*, *between*: residual ratio tracking. A control, the least or the mean extinction of a cell, is taken
  off analytically; the rate is that of the furthest from it. Between: the mean in cells that differ by an optical depth
  of up to 1 across, and nearer to the least in others. That is what the renderer does.
- *marching*: unbiased ray marching (Kettunen et al. 2021): M evenly spaced values with one common offset make an
  optical depth; N + 1 of those, a power series around each of them, with Bhanot and Kennedy's roulette on its length
  (of order 0 with probability 0.9); M follows from the optical depth of the majorant. Without matching of end points.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

Array = NDArray[np.float64]

DEPTHS = (0.25, 1.0, 4.0, 16.0, 64.0)
CELL = 0.25  # of the cost of a value
VOXELS, LEAST_DEPTH = 4, 0.25  # along an edge of a cell; of the thickest one
FINE = 1024  # midpoints of the truth
FAINT, LONG_WALK = 0.1, 512
BOUNDS: tuple[Callable[..., Any], ...] = (np.max, np.min, np.mean)
ZERO_ORDER, ORDERS = 0.9, 2  # of the power series: probability of stopping at once, and orders without roulette
MEAN_ORDER = 0.31945  # of the series that follows from both


@dataclass(frozen=True)
class Volume:
    """A grid on the unit cube, values from 0 to 1, and what is known of the extinction in the cells of a lattice:
    greatest, least and mean. scale: extinction of a value of 1."""

    values: Array
    scale: float
    most: Array
    least: Array
    mean: Array

    @classmethod
    def of(cls, values: Array, scale: float) -> Volume:
        """values: (n, n, n). Thin grids have fewer cells: see `equation/lattice.py`."""
        n = len(values)
        m = max(1, min(n // VOXELS, int(math.sqrt(3) * scale / LEAST_DEPTH)))
        padded = np.pad(values, 1, mode="edge") * scale
        edges = [slice(c * n // m, -(-(c + 1) * n // m) + 2) for c in range(m)]
        blocks = [padded[a, b, c] for a in edges for b in edges for c in edges]
        most, least, mean = (np.array([f(b) for b in blocks], np.float64).reshape(m, m, m) for f in BOUNDS)
        return cls(values, scale, most, least, mean)

    def at(self, p: Array) -> Array:
        """Extinction at (n, 3) places, interpolated."""
        n = len(self.values)
        s = p * n - 0.5
        low = np.floor(s)
        share = s - low
        found = np.zeros(len(p))
        for corner in np.ndindex(2, 2, 2):
            index = np.clip(low.astype(int) + corner, 0, n - 1)
            found += self.values[tuple(index.T)] * np.prod(np.where(corner, share, 1 - share), axis=1)
        return self.scale * found


@dataclass
class Cost:
    """values: of the grid that were asked for; cells: that were walked through. Both over all rays."""

    values: int = 0
    cells: int = 0


Estimator = Callable[[Volume, Array, Array, np.random.Generator, Cost], Array]


def tracked(
    volume: Volume, o: Array, d: Array, rng: np.random.Generator, cost: Cost, control: Array, spread: Array
) -> Array:
    """Residual ratio tracking from o to o + d; control, spread: (m, m, m), on a lattice."""
    n, m, length = len(o), len(control), np.linalg.norm(d, axis=1)
    t, passed, steps = np.zeros(n), np.ones(n), np.zeros(n, int)
    cell = np.clip(np.floor(o * m).astype(int), 0, m - 1)
    left = rng.exponential(size=n)
    active = np.arange(n)
    with np.errstate(divide="ignore", invalid="ignore"):
        while len(active):
            a = active
            faces = np.where(d[a] != 0, ((cell[a] + (d[a] > 0)) / m - o[a]) / d[a], np.inf)
            leaves = np.minimum(np.maximum(faces.min(1), t[a]), 1)
            thin, rate = control[tuple(cell[a].T)], spread[tuple(cell[a].T)]
            room = rate * (leaves - t[a]) * length[a]
            is_here = left[a] < room
            reached = np.where(is_here, t[a] + left[a] / (rate * length[a]), leaves)
            passed[a] *= np.exp(-thin * (reached - t[a]) * length[a])
            t[a] = reached
            left[a] -= room
            ended = ~is_here & (leaves >= 1)
            crossing = (~is_here)[:, None] & (faces <= leaves[:, None])
            cell[a] = np.clip(cell[a] + crossing * np.where(d[a] > 0, 1, -1), 0, m - 1)
            cost.cells += len(a) if m > 1 else 0
            hit = a[is_here]
            cost.values += len(hit)
            passed[hit] *= 1 - (volume.at(o[hit] + t[hit, None] * d[hit]) - thin[is_here]) / rate[is_here]
            steps[hit] += 1
            survival = np.minimum(np.abs(passed[hit]) / FAINT, 1) * np.where(steps[hit] % LONG_WALK, 1, 0.5)
            survives = rng.random(len(hit)) < survival
            passed[hit] = np.where(survives, passed[hit] / np.where(survival > 0, survival, 1), 0)
            left[hit] = rng.exponential(size=len(hit))
            active = a[~ended & (passed[a] != 0)]
    return passed


def one_majorant(volume: Volume, o: Array, d: Array, rng: np.random.Generator, cost: Cost) -> Array:
    """Ratio tracking at one rate."""
    rate = np.full((1, 1, 1), volume.most.max())
    return tracked(volume, o, d, rng, cost, 0 * rate, rate)


def lattice(volume: Volume, o: Array, d: Array, rng: np.random.Generator, cost: Cost) -> Array:
    """Ratio tracking at the rate of each cell."""
    return tracked(volume, o, d, rng, cost, 0 * volume.most, volume.most)


def least(volume: Volume, o: Array, d: Array, rng: np.random.Generator, cost: Cost) -> Array:
    """Residual ratio tracking, the control being the least extinction of a cell."""
    return tracked(volume, o, d, rng, cost, volume.least, volume.most - volume.least)


def mean(volume: Volume, o: Array, d: Array, rng: np.random.Generator, cost: Cost) -> Array:
    """Residual ratio tracking, the control being the mean extinction of a cell."""
    spread = np.maximum(volume.most - volume.mean, volume.mean - volume.least)
    return tracked(volume, o, d, rng, cost, volume.mean, spread)


def between(volume: Volume, o: Array, d: Array, rng: np.random.Generator, cost: Cost) -> Array:
    """Residual ratio tracking, the control being the mean in thin cells, and towards the least in thick ones."""
    depth = np.maximum(volume.most - volume.least, 1e-9) / len(volume.most)
    control = volume.least + np.minimum(1 / depth, 1) * (volume.mean - volume.least)
    spread = np.maximum(volume.most - control, control - volume.least)
    return tracked(volume, o, d, rng, cost, control, spread)


def marching(volume: Volume, o: Array, d: Array, rng: np.random.Generator, cost: Cost) -> Array:
    """Unbiased ray marching."""
    n, length = len(o), np.linalg.norm(d, axis=1)
    control = volume.most.max() * length
    wanted = np.ceil(np.cbrt((0.015 + control) * (0.65 + control) * (60.3 + control)))
    count = np.maximum(np.round(wanted / (MEAN_ORDER + 1)), 1).astype(int)
    order, weight = np.zeros(n, int), [np.ones(n)]
    going = rng.random(n) >= ZERO_ORDER
    chance = np.where(going, 1 - ZERO_ORDER, 1.0)
    while going.any():
        k = len(weight)
        if k > ORDERS:
            going &= rng.random(n) < ORDERS / k
            chance *= ORDERS / k
        order += going
        weight.append(np.where(going, 1 / chance, 0))
    passed = np.zeros(n)
    for k in np.unique(order):
        these = np.flatnonzero(order == k)
        depths = np.stack(
            [_combed(volume, o[these], d[these], length[these], count[these], rng, cost) for _ in range(k + 1)]
        )
        for pivot in range(k + 1):
            others = np.delete(depths[pivot] - depths, pivot, axis=0)
            symmetric = [np.ones(len(these))] + [np.zeros(len(these)) for _ in range(k)]
            for x in others:
                for i in range(k, 0, -1):
                    symmetric[i] = symmetric[i] + symmetric[i - 1] * x
            series = sum(weight[i][these] * symmetric[i] / math.perm(k, i) for i in range(k + 1))
            passed[these] += np.exp(-depths[pivot]) * series / (k + 1)
    return passed


def _combed(
    volume: Volume, o: Array, d: Array, length: Array, count: NDArray[np.int64], rng: np.random.Generator, cost: Cost
) -> Array:
    """An unbiased optical depth from evenly spaced values."""
    offset, total = rng.random(len(o)), np.zeros(len(o))
    cost.values += int(count.sum())
    for j in range(count.max(initial=0)):
        a = np.flatnonzero(count > j)
        t = (j + offset[a]) / count[a]
        total[a] += volume.at(o[a] + t[:, None] * d[a])
    return total * length / count


ESTIMATORS: dict[str, Estimator] = {
    "one majorant": one_majorant,
    "lattice": lattice,
    "least": least,
    "mean": mean,
    "between": between,
    "marching": marching,
}


def grids() -> dict[str, Array]:
    """Values from 0 to 1 on 48³ voxels."""
    from renderer.scene.gallery.smoke import plume

    density = plume()[0][..., 0].astype(np.float64)
    rng = np.random.default_rng(1)
    x = (np.stack(np.meshgrid(*[np.arange(48)] * 3, indexing="ij"), -1) + 0.5) / 48
    centres = 0.2 + 0.6 * rng.random((5, 3))
    puffs = np.sum([np.exp(-np.sum((x - c) ** 2, -1) / 0.003) for c in centres], axis=0)
    puffs[puffs < 0.01] = 0
    even = 0.8 + 0.2 * rng.random((48, 48, 48))
    return {"plume": density[:, 12:60], "puffs": puffs / puffs.max(), "nearly even": even}


def truth(volume: Volume, o: Array, d: Array) -> Array:
    """By the midpoint rule."""
    total = np.zeros(len(o))
    for j in range(FINE):
        total += volume.at(o + (j + 0.5) / FINE * d)
    return np.exp(-total / FINE * np.linalg.norm(d, axis=1))


def measure(volume: Volume, name: str, o: Array, d: Array, estimates: int) -> tuple[float, float, float, Array, Array]:
    """Values and cells per estimate, variance relative to the mean square of what passes, and mean and variance of
    the estimates of each ray."""
    cost, rng = Cost(), np.random.default_rng(7)
    n = len(o)
    found = ESTIMATORS[name](volume, np.repeat(o, estimates, 0), np.repeat(d, estimates, 0), rng, cost)
    each = found.reshape(n, estimates)
    variance = each.var(1, ddof=1)
    square = float(np.mean(each.mean(1) ** 2))
    relative = float(variance.mean()) / square if square > 0 else math.nan
    return cost.values / len(found), cost.cells / len(found), relative, each.mean(1), variance


def chords(n: int) -> tuple[Array, Array]:
    """Rays from the left to the right of the unit cube: from where, and how far."""
    rng = np.random.default_rng(3)
    left, right = rng.random((n, 3)), rng.random((n, 3))
    left[:, 0], right[:, 0] = 0, 1
    return left, right - left


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.transmittance", description=__doc__)
    parser.add_argument("--rays", type=int, default=512)
    parser.add_argument("--estimates", type=int, default=32)
    asked = parser.parse_args()
    o, d = chords(asked.rays)
    table = Table(title="variance × cost (values asked for + cells walked through)")
    for column in ("grid", "optical depth", "passes", *ESTIMATORS):
        table.add_column(column, justify="left" if column == "grid" else "right")
    for grid, values in grids().items():
        for depth in DEPTHS:
            volume = Volume.of(values, depth)
            passes = float(truth(volume, o, d).mean())
            cells = []
            for name in ESTIMATORS:
                asked_for, walked, variance, *_ = measure(volume, name, o, d, asked.estimates)
                product = variance * (asked_for + CELL * walked)
                said = f"{product:.2g}" if math.isfinite(product) else "–"
                cells.append(f"{said} ({asked_for:.1f} + {walked:.0f})")
            table.add_row(grid, f"{depth:g}", f"{passes:.2g}", *cells)
    Console(width=160).print(table)


if __name__ == "__main__":
    main()
