"""chi² of direction samples against a density, over cells of equal solid angle in a cone around an axis."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

Array = NDArray[np.float64]
ROWS = COLUMNS = 16
SUB = 48  # quadrature points per cell and axis
MIN_EXPECTED = 8.0
ROUNDING = 2e-3  # relative error granted to a density in float32


@dataclass(frozen=True)
class Cone:
    """Directions within a half angle of an axis; 1 − cos of the angle is kept, which stays exact for narrow ones."""

    axis: Array
    one_minus_cos: float

    @classmethod
    def around(cls, axis: tuple[float, float, float], angle: float) -> Cone:
        """angle: half angle in radians; π is the whole sphere."""
        return cls(np.array(axis, np.float64) / np.linalg.norm(axis), 2 * np.sin(angle / 2) ** 2)

    @property
    def frame(self) -> tuple[Array, Array]:
        other = np.eye(3)[np.argmin(np.abs(self.axis))]
        across = np.cross(self.axis, other).astype(np.float64)
        x = across / np.linalg.norm(across)
        return x, np.cross(self.axis, x).astype(np.float64)

    @property
    def cell_solid_angle(self) -> float:
        return 2 * np.pi * self.one_minus_cos / (ROWS * COLUMNS)

    def direction(self, u: Array, v: Array) -> Array:
        """Equal-area map of the unit square to (n, 3) directions."""
        drop, phi = u * self.one_minus_cos, 2 * np.pi * v
        sin = np.sqrt(drop * (2 - drop))
        x, y = self.frame
        return (sin * np.cos(phi))[:, None] * x + (sin * np.sin(phi))[:, None] * y + (1 - drop)[:, None] * self.axis

    def cell(self, d: Array) -> NDArray[np.int64]:
        """Index of the cell of each (n, 3) direction; ROWS · COLUMNS for those outside the cone."""
        x, y = self.frame
        sin_2 = np.square(d @ x) + np.square(d @ y)
        cos = d @ self.axis
        drop = np.where(cos > 0.5, sin_2 / (1 + np.sqrt(np.maximum(1 - sin_2, 0))), 1 - cos)
        row = np.floor(drop / self.one_minus_cos * ROWS).astype(np.int64)
        column = np.floor(np.arctan2(d @ y, d @ x) / (2 * np.pi) % 1 * COLUMNS).astype(np.int64)
        return np.where((row >= 0) & (row < ROWS), row * COLUMNS + np.clip(column, 0, COLUMNS - 1), ROWS * COLUMNS)

    def masses(self, density: Callable[[Array], Array]) -> tuple[Array, Array]:
        """(cells,) integral of a density over each cell, and its variance: a jittered grid, at most as good as that."""
        rows, columns = ROWS * SUB, COLUMNS * SUB
        jitter = np.random.default_rng(0).random((2, rows, columns))
        u = (np.arange(rows)[:, None] + jitter[0]) / rows
        v = (np.arange(columns) + jitter[1]) / columns
        values = density(self.direction(u.ravel(), v.ravel())).reshape(ROWS, SUB, COLUMNS, SUB)
        mean, variance = values.mean(axis=(1, 3)).ravel(), values.var(axis=(1, 3)).ravel() / SUB**2
        return mean * self.cell_solid_angle, variance * self.cell_solid_angle**2


def p_value(directions: Array, n: int, cone: Cone, density: Callable[[Array], Array]) -> float:
    """How likely samples at least this unlike the density are, if they are drawn from it.

    directions: (k, 3), those of n draws that gave something. All others, and those outside the cone, are one more cell.
    """
    masses, quadrature = cone.masses(density)
    observed = np.bincount(cone.cell(directions), minlength=ROWS * COLUMNS + 1)[: ROWS * COLUMNS].astype(np.float64)
    expected = n * masses
    small = expected < MIN_EXPECTED
    observed = np.append(observed[~small], [observed[small].sum(), n - observed.sum()])
    error = np.append(quadrature[~small], [quadrature[small].sum(), quadrature.sum()]) * n**2
    expected = np.append(expected[~small], [expected[small].sum(), n - expected.sum()])
    variance = expected + error + np.square(ROUNDING * expected)
    kept = variance > 0.5
    # The last two cells may hold nothing: all that is drawn there then counts against the density.
    stray = observed[~kept].sum()
    statistic = float((np.square(observed - expected)[kept] / variance[kept]).sum() + np.square(stray))
    return float(chi2.sf(statistic, max(int(kept.sum()) - 1, 1)))
