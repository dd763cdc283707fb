"""Monte Carlo in one dimension, step by step: what `renderer.integrate` does with a function that somebody typed in.

    ⟨I⟩ = 1/n Σ f(xj)/p(xj)      V = 1/(n−1) Σ (f(xj)/p(xj) − ⟨I⟩)²      σ = √(V/n)

Enters: f and the density p as expressions, or a density by name, and the limits. Leaves: the integral by quadrature,
whether p is a density at all, the points that are drawn, and estimates of many runs for ever more points. All estimates
are those of `integrate`; points are drawn by inverting p's cumulative distribution, tabulated in CELLS cells.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from renderer.errors import SettingsError
from renderer.integral import Integral, integrate
from renderer.lesson.expression import function_of

Array = NDArray[np.float64]

CELLS = 1 << 14
PIECES = 8  # of the density that follows f roughly
FLOOR = 0.1  # of that density's mean: it stays positive wherever f may not be zero
LARGEST = 1e100  # of limits and values: squares of them are still finite
UNIFORM, ROUGH, BEST = "uniform", "rough", "best"
MOST_POINTS = 1 << 20


@dataclass(frozen=True, slots=True)
class Conditions:
    """Whether p is a density with which f may be sampled. mass: ∫ p as it was given; p is divided by it.

    unseen: share of ∫ |f| where p is zero, which no point ever sees. negative_at: where p is below zero.
    """

    mass: float
    is_positive: bool
    negative_at: float | None
    unseen: float


class Problem:
    """The integral of f over [a, b] with a density: expressions of x, or `uniform`, `rough` (a step in each of PIECES,
    as high as |f| is in the mean) and `best` (|f|/∫|f|). Raises SettingsError, with what to change.
    """

    def __init__(self, f: str, a: float, b: float, density: str = UNIFORM) -> None:
        if not (math.isfinite(a) and math.isfinite(b) and a < b and max(abs(a), abs(b)) < LARGEST):
            raise SettingsError(f"the limits are {a!r} and {b!r}; they must be finite, the first below the second")
        self.f, self.a, self.b, self.density = function_of(f), a, b, density
        self.edges = np.linspace(a, b, CELLS + 1)
        self.middles = 0.5 * (self.edges[1:] + self.edges[:-1])
        values = self.f(self.middles)
        bad = ~(np.abs(values) < LARGEST)
        if bad.any():
            where = float(self.middles[np.flatnonzero(bad)[0]])
            raise SettingsError(f"f({where:.4g}) is {values[bad][0]:.3g}; between the limits f must be finite")
        self.values = values
        self._shape = self._shape_of(density)

    def _shape_of(self, density: str) -> Callable[[Array], Array]:
        """The density before it is divided by its mass."""
        if density == UNIFORM:
            return lambda x: np.full_like(x, 1 / (self.b - self.a))
        if density == BEST:
            return lambda x: np.abs(self.f(x))
        if density == ROUGH:
            heights = np.abs(self.values).reshape(PIECES, -1).mean(axis=1)
            heights = heights + FLOOR * max(heights.mean(), 1e-300)
            width = (self.b - self.a) / PIECES
            return lambda x: heights[np.clip(((x - self.a) / width).astype(np.int64), 0, PIECES - 1)]
        return function_of(density)

    @cached_property
    def truth(self) -> tuple[float, float]:
        """∫ f by quadrature, and how far off that may be: the midpoint rule on two grids, extrapolated."""
        h = (self.b - self.a) / CELLS
        fine, coarse = float(self.values.sum()) * h, float(self.f(self.edges[1:-1:2]).sum()) * 2 * h
        if not math.isfinite(coarse):
            return fine, abs(fine)
        return fine + (fine - coarse) / 3, abs(fine - coarse)

    @cached_property
    def _cells(self) -> Array:
        """∫ p over each cell before p is divided by its mass, (CELLS,)."""
        return self._shape(self.middles) * ((self.b - self.a) / CELLS)

    @cached_property
    def conditions(self) -> Conditions:
        """What a density must fulfil: p ≥ 0, ∫ p = 1, and p > 0 wherever f ≠ 0."""
        p = self._cells
        bad = ~(p >= 0) | ~np.isfinite(p)
        weight = np.abs(self.values)
        unseen = float(weight[p == 0].sum() / weight.sum()) if weight.any() else 0.0
        at = float(self.middles[np.flatnonzero(bad)[0]]) if bad.any() else None
        mass = float(p.sum()) if np.isfinite(p).all() else math.nan
        if self.density == UNIFORM:
            mass = 1.0
        elif self.density in (ROUGH, BEST):
            mass = 1.0 if mass > 0 else mass
        return Conditions(mass, at is None, at, unseen)

    @cached_property
    def _cumulative(self) -> Array:
        conditions = self.conditions
        if not conditions.is_positive:
            raise SettingsError(f"p is negative or has no value at x = {conditions.negative_at:.4g}; it must be ≥ 0")
        total = np.concatenate([[0.0], np.cumsum(self._cells)])
        if not 0 < total[-1] < math.inf:
            raise SettingsError("p is zero everywhere; there is nothing to draw points with")
        return total

    def pdf(self, x: Array) -> Array:
        """p(x), divided by its mass."""
        return self._shape(x) / self._cumulative[-1]

    def sample(self, u: Array) -> Array:
        """Points with density p from numbers in [0, 1): the inverse of the cumulative distribution, linear in a cell.

        Where p jumps to zero inside a cell, its points beyond the jump are moved to its middle.
        """
        cumulative = self._cumulative
        wanted = u * cumulative[-1]
        cell = np.clip(np.searchsorted(cumulative, wanted, side="right") - 1, 0, CELLS - 1)
        inside = self._cells[cell]
        share = np.where(inside > 0, (wanted - cumulative[cell]) / np.where(inside > 0, inside, 1), 0.5)
        x = self.edges[cell] + np.clip(share, 0, 1) * (self.b - self.a) / CELLS
        is_drawn = (self._shape(x) > 0) & (np.abs(self.f(x)) < LARGEST)
        return np.where(is_drawn, x, self.middles[cell])

    def estimate(self, n: int, seed: int = 0) -> Integral:
        """⟨I⟩ from n points, by `renderer.integrate`."""
        if not 1 <= n <= MOST_POINTS:
            raise SettingsError(f"n is {n}; it must be from 1 to {MOST_POINTS}")
        if self.density == UNIFORM:
            return integrate(self.f, self.a, self.b, n, seed=seed)
        return integrate(self.f, self.a, self.b, n, pdf=self.pdf, sample=self.sample, seed=seed)

    def points(self, n: int, seed: int = 0) -> tuple[Array, Array, Array]:
        """The first n points of `estimate`: x, f(x), p(x)."""
        x: list[Array] = []

        def f(at: Array) -> Array:
            x.append(at)
            return self.f(at)

        uniform = self.density == UNIFORM
        integrate(f, self.a, self.b, n, seed=seed, **({} if uniform else {"pdf": self.pdf, "sample": self.sample}))
        at = np.concatenate(x)
        return at, self.f(at), self.pdf(at)

    def runs(self, n: int, runs: int) -> tuple[list[int], Array]:
        """Estimates of many runs, seeds 1, 2, …, for 1, 4, 16, … points up to n: (counts, (runs, counts))."""
        counts = [4**k for k in range(32) if 4**k <= n]
        values = [[self.estimate(count, seed).value for count in counts] for seed in range(1, runs + 1)]
        return counts, np.array(values)
