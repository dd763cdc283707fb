"""Confidence intervals of pixels, and which of them can be believed.

Enters: moments. Leaves: Student t intervals with count − 1 degrees of freedom, and a trust flag per pixel.
A pixel whose light has hardly been found yet has a small or zero variance for the wrong reason: it is untrusted, never
"perfect".
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from renderer.estimate.moments import Moments

MIN_REPLICATES = 8
MIN_NONZERO = 6
MAX_SHARE = 0.5  # of the sum that one replicate may carry


def t_quantile(probability: float, degrees: NDArray | float) -> NDArray:
    """Quantile of Student's t distribution."""
    return stdtrit(degrees, probability)


def half_width(moments: Moments, confidence: float = 0.95) -> NDArray[np.float64]:
    """(n, 4) half width of the two-sided interval of R, G, B, Y; NaN where count < 2."""
    quantile = t_quantile(0.5 + confidence / 2, np.maximum(moments.count - 1, 1))
    return quantile[:, None] * np.sqrt(moments.variance_of_mean())


def trust(moments: Moments) -> NDArray[np.bool_]:
    """(n,) whether each pixel's interval can be believed."""
    total = np.abs(moments.luminance()) * moments.count
    spread = moments.largest <= MAX_SHARE * total
    return (moments.count >= MIN_REPLICATES) & (moments.nonzero >= MIN_NONZERO) & spread
