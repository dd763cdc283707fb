"""Russian roulette: end paths that carry little, without bias. Source: Arvo & Kirk 1990."""

from __future__ import annotations

from typing import Any

import drjit as dr

# Where the depth is unlimited, light caught between mirrors ends after a thousand bounces or so. In walls of albedo a,
# survivors weigh (a/ceiling)^k: with the customary 0.95 their variance is infinite from a = 0.975 on, and a furnace of
# 0.999 came out 65 % too dark. A limited path ends by itself, and nothing needs to end one that has lost no light.
CEILING = 0.999
FLOOR = 0.05  # bounds the growth of a survivor to 20; a probability below 2^-24 could never be drawn from float32


def survival_probability(throughput: Any, eta: Any, is_limited: Any) -> Any:
    """Probability to go on, from the path's throughput without the radiance compression of refraction (eta²).

    is_limited: whether the depth ends every path.
    """
    return dr.clip(dr.max(throughput) * dr.square(eta), FLOOR, dr.select(is_limited, 1, CEILING))
