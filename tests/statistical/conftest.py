"""What statistical tests share: where the scenes are, and how sure a failure is.

False alarms: the suite as a whole fails by chance with probability at most 1 %. Each test takes its part of that by
Šidák's correction. Seeds are fixed, so a build either always passes or always fails; `make test-long` draws fresh ones.
"""

from __future__ import annotations

import math
import os
import secrets
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import norm

SHARED = Path(__file__).parents[3] / "shared"
SUITE_ALPHA = 0.01
TESTS_IN_SUITE = 400  # generously counted


def z_limit(comparisons: int = 1) -> float:
    """|z| beyond which one of `comparisons` in one test of the suite is a failure."""
    alpha = 1 - (1 - SUITE_ALPHA) ** (1 / (TESTS_IN_SUITE * comparisons))
    return float(norm.isf(alpha / 2))


def p_limit() -> float:
    """p-value below which one test of the suite is a failure."""
    return 1 - (1 - SUITE_ALPHA) ** (1 / TESTS_IN_SUITE)


@pytest.fixture(scope="session")
def seed() -> int:
    """Fixed in CI; fresh with FREDHOLM_FRESH_SEEDS=1, and then printed."""
    if os.environ.get("FREDHOLM_FRESH_SEEDS"):
        fresh = secrets.randbits(40)
        print(f"fresh seed {fresh}")
        return fresh
    return 20_260_001


def shared_scene(name: str) -> Path:
    """Path of a shared scene; skips where the folder is missing."""
    path = SHARED / "scenes" / name / "scene.xml"
    if not path.is_file():
        pytest.skip(f"needs {name} from the shared scenes beside the checkout")
    return path


def mean_and_error(estimate: object) -> tuple[float, float]:
    """Mean luminance of an image and its standard error."""
    moments = estimate.moments  # type: ignore[attr-defined]
    variance = moments.variance_of_mean()[:, 3]
    return float(moments.luminance().mean()), math.sqrt(float(np.nansum(variance))) / len(variance)


def variance_map(estimate: Any) -> NDArray[np.float64]:
    """(H, W, 4) variance of each pixel's mean; 0 where nothing was found, as sums over pixels need it."""
    return estimate.moments.variance_of_mean().reshape(estimate.height, estimate.width, 4)
