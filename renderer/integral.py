"""The estimator itself, in one dimension: the integral of any f over [a, b] from n random points.

    ⟨I⟩ = 1/n Σ f(xj)/p(xj)      V = 1/(n−1) Σ (f(xj)/p(xj) − ⟨I⟩)²      standard error = √(V/n) ∝ 1/√n

Enters: f, the limits, n, and a density p with a way to draw from it (uniform if none is given). Leaves: an `Integral`.
The renderer does the same with paths in place of points. The variance is zero exactly where p = f/I: the best density
is the answer itself, and every technique of the renderer is an attempt at it.
Source: Kalos & Whitlock 1986, chapters 3 and 4; Chan, Golub & LeVeque 1979 for the merge.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from renderer.errors import MergeError, SettingsError

Array = NDArray[np.float64]
Function = Callable[[Array], Array]
AT_ONCE = 2**18  # points: memory does not grow with n


@dataclass(frozen=True, slots=True)
class Integral:
    """An estimate of an integral; two of them, from different points, merge.

    value: ⟨I⟩. n: points. m2: sum of squared deviations of f/p. seeds: that the points were drawn with.
    """

    value: float
    n: int
    m2: float
    seeds: tuple[int, ...] = ()

    @property
    def variance(self) -> float:
        """Sample variance V of f/p, of one point; NaN for a single one."""
        return self.m2 / (self.n - 1) if self.n > 1 else math.nan

    @property
    def standard_error(self) -> float:
        """Standard deviation of `value`."""
        return math.sqrt(self.variance / self.n)

    def interval(self, confidence: float = 0.95) -> tuple[float, float]:
        """Where the integral lies with this confidence (Student t, n − 1 degrees of freedom)."""
        if not 0 < confidence < 1:
            raise SettingsError(f"confidence is {confidence!r}; it must be between 0 and 1")
        half = float(stdtrit(max(self.n - 1, 1), 0.5 + confidence / 2)) * self.standard_error
        return self.value - half, self.value + half

    def merge(self, other: Integral) -> Integral:
        """The estimate from both sets of points. Refuses a seed that both hold: those would be the same points."""
        if shared := set(self.seeds) & set(other.seeds):
            raise MergeError(f"points overlap: both hold seed {min(shared)}; draw one of them with another seed")
        return _merged(self, other, tuple(sorted({*self.seeds, *other.seeds})))

    def __str__(self) -> str:
        return f"{self.value:.6g} ± {self.standard_error:.2g} (n = {self.n})"


def integrate(
    f: Function,
    a: float,
    b: float,
    n: int,
    *,
    pdf: Function | None = None,
    sample: Function | None = None,
    seed: int = 0,
) -> Integral:
    """Estimates the integral of f over [a, b] from n points.

    f: vectorised, (k,) float64 points → (k,) values. pdf, sample: a density on [a, b], positive wherever f is not zero,
    and the inverse of its cumulative distribution, (k,) numbers in [0, 1) → (k,) points; both or neither.
    Equal seeds give equal estimates. Raises SettingsError for bad limits, and where f or pdf misbehave, with the point.

    >>> plain = integrate(lambda x: x**2, 0, 1, 10_000)  # uniform points; the truth is 1/3
    >>> print(f"{plain.value:.3f} ± {plain.standard_error:.3f}")
    0.333 ± 0.003
    >>> best = integrate(lambda x: x**2, 0, 1, 10, pdf=lambda x: 3 * x**2, sample=lambda u: u ** (1 / 3))
    >>> print(f"{best.value:.12f} from 10 points, variance below 1e-30: {best.variance < 1e-30}")
    0.333333333333 from 10 points, variance below 1e-30: True
    """
    if not (math.isfinite(a) and math.isfinite(b) and a < b):
        raise SettingsError(f"the limits are {a!r} and {b!r}; they must be finite, the first below the second")
    if isinstance(n, bool) or not isinstance(n, (int, np.integer)) or n < 1:
        raise SettingsError(f"n is {n!r}; it must be a whole number from 1")
    if (pdf is None) != (sample is None):
        given, missing = ("pdf", "sample") if sample is None else ("sample", "pdf")
        raise SettingsError(f"{given} is given without {missing}; a density needs both, the uniform one neither")
    rng = np.random.default_rng(seed)
    total = Integral(0.0, 0, 0.0)
    for start in range(0, int(n), AT_ONCE):
        u = rng.random(min(AT_ONCE, int(n) - start))
        x = a + (b - a) * u if sample is None else np.asarray(sample(u), dtype=np.float64)
        p = np.full_like(u, 1 / (b - a)) if pdf is None else np.asarray(pdf(x), dtype=np.float64)
        _check_points(x, p, u, a, b)
        y = np.broadcast_to(np.asarray(f(x), dtype=np.float64), x.shape)
        if not np.isfinite(y).all():
            where = int(np.flatnonzero(~np.isfinite(y))[0])
            raise SettingsError(f"f({x[where]!r}) is {y[where]!r}; it must be finite wherever the density is positive")
        ratio = y / p
        mean = float(ratio.mean())
        total = _merged(total, Integral(mean, len(ratio), float(np.square(ratio - mean).sum())), (seed,))
    return total


def _check_points(x: Array, p: Array, u: Array, a: float, b: float) -> None:
    if x.shape != u.shape or p.shape != u.shape:
        raise SettingsError(f"for {u.shape} numbers, sample gave {x.shape} points and pdf {p.shape} densities")
    slack = 1e-12 * (b - a)
    if (outside := ~((x >= a - slack) & (x <= b + slack))).any():
        raise SettingsError(f"sample gave {x[outside][0]!r}; its points must lie in [{a!r}, {b!r}]")
    if (bad := ~((p > 0) & np.isfinite(p))).any():
        raise SettingsError(f"pdf({x[bad][0]!r}) is {p[bad][0]!r}; at a point that was drawn it must be positive")


def _merged(one: Integral, other: Integral, seeds: tuple[int, ...]) -> Integral:
    n = one.n + other.n
    share = other.n / max(n, 1)
    delta = other.value - one.value
    return Integral(one.value + delta * share, n, one.m2 + other.m2 + delta * delta * one.n * share, seeds)
