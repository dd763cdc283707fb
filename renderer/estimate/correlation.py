"""How alike the values of neighbouring pixels are, where their film shares samples (`equation/film.py`).

Enters: the profile of a separable reconstruction filter f, of integral one. Leaves: what sums over pixels have to know.
Pixels at the distance d have the correlation ρ(d) = ∫ f(x) f(x − d) dx / ∫ f²; a sum over pixels then spreads as if
there were fewer of them. A single bright value of rate λ counts in several pixels: they see ∫f²³ / ∫f³² · λ of them,
each, and a window of them has seen no more than λ a pixel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Correlation:
    """reach: pixels that a sample counts in beside its own, on each side. spread: Σ ρ(d)², by which the variance of a
    sum of estimated variances grows. events: times that a rare bright value is counted among the pixels of a window.
    """

    reach: int = 0
    spread: float = 1.0
    events: float = 1.0

    @property
    def touched(self) -> int:
        """Pixels further, on each side, that share a sample with a pixel."""
        return 2 * self.reach


INDEPENDENT = Correlation()


def correlation_of(profile: NDArray[np.float64], step: float, reach: int) -> Correlation:
    """From the filter's values at places `step` pixels apart (1/step is whole)."""
    profile = profile / (profile.sum() * step)
    pixel = round(1 / step)
    squared = float(np.sum(profile**2)) * step
    cubed = float(np.sum(np.abs(profile) ** 3)) * step
    lags = range(1, 2 * reach + 1)
    rho = [float(np.sum(profile[d * pixel :] * profile[: len(profile) - d * pixel])) * step / squared for d in lags]
    one_axis = 1 + 2 * sum(r * r for r in rho)
    return Correlation(reach, round(one_axis**2, 6), round(max(1.0, (squared**3 / cubed**2) ** 2), 6))
