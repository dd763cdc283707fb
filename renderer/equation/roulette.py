"""Russian roulette: end paths that carry little, without bias. Source: Arvo & Kirk 1990."""

from __future__ import annotations

from typing import Any

import drjit as dr

CEILING = 0.95  # so that light caught between mirrors ends
FLOOR = 0.05  # bounds the growth of a survivor to 20; a probability below 2^-24 could never be drawn from float32


def survival_probability(throughput: Any, eta: Any) -> Any:
    """Probability to go on, from the path's throughput without the radiance compression of refraction (eta²)."""
    return dr.clip(dr.max(throughput) * dr.square(eta), FLOOR, CEILING)
