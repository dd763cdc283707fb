"""What an audit says about the samples spent so far: the error that they cannot know of, and where. Pure, NumPy only.

Enters: an audit and the moments of a camera's estimate. Leaves: `Missing`, which every error that is said or judged
takes in. A pixel is doubted where light of which it had too few finds makes up a notable part of its interval; the
squared error grows by what the audit expects beyond the estimate's own variance, and by light that no sample meets.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from renderer.audit.value import Audit
from renderer.estimate.error import NOTHING_MISSING, Missing
from renderer.estimate.interval import FLOOR, MISSING, half_width
from renderer.estimate.moments import Moments

EXCLUDED = 0.5  # of the audited light, that the camera's estimate must have at least: the audit is right within two
FAR = 3.0  # standard errors below which it counts as having less
WITHIN = 2.0  # what the audit is right within: for the bound, so much more may be missing
NEGLIGIBLE = 1e-8  # a squared relative error that no target asks for


def missing_of(
    audit: Audit | None, moments: Moments, replicate_size: int, scope: NDArray[np.bool_] | None = None
) -> Missing:
    """scope: (n,) pixels whose error counts; None for all."""
    if audit is None or audit.is_empty or not moments.count.any():
        return NOTHING_MISSING
    pixels = audit.pixels_per_tile()
    sampled = audit.by_tile(moments.count > 0)
    has_any = np.maximum(sampled, np.finfo(np.float64).tiny)
    samples = audit.by_tile(moments.count) / has_any * replicate_size
    mean = audit.by_tile(moments.luminance()) / has_any
    own = audit.by_tile(np.nan_to_num(moments.variance_of_mean()[:, 3])) / has_any

    found, never, unmet = audit.found(), audit.never(), audit.missing(samples)
    expected = audit.variance(samples)
    level = float(np.average(np.maximum(mean, found), weights=pixels))
    scale = np.maximum(mean, found) ** 2 + (FLOOR * level) ** 2
    spread = np.sqrt(own / np.maximum(pixels * sampled, 1.0))
    lacks = (sampled > 0) & (mean + FAR * spread < EXCLUDED * (found - never))
    lacking = np.where(lacks, found - never - mean, 0.0)

    counted = pixels if scope is None else audit.by_tile(scope) * pixels
    said = np.maximum(np.minimum(expected, (unmet - never) ** 2) - own, lacking**2) + never**2
    likely = audit.most_variance(samples)
    most = np.minimum(expected, (WITHIN * (unmet - never)) ** 2)
    bound = np.maximum(np.maximum(likely, most) - own, lacking**2) + never**2
    squared, most = (float(np.average(part / scale, weights=counted)) for part in (said, bound))
    doubted = _doubted(audit, moments, unmet, lacks)
    if most < NEGLIGIBLE and doubted is None:
        return NOTHING_MISSING
    return Missing(squared, doubted, most)


def _doubted(
    audit: Audit, moments: Moments, unmet: NDArray[np.float64], lacks: NDArray[np.bool_]
) -> NDArray[np.bool_] | None:
    """(n,) pixels that are not believed; None where all are."""
    if not (unmet.any() or lacks.any()):
        return None
    tolerated = MISSING * np.nan_to_num(half_width(moments)[:, 3])
    doubted = (audit.by_pixel(unmet) > tolerated) | audit.by_pixel(lacks)
    return doubted if doubted.any() else None
