"""One pixel's radiance by the number of reflections: the terms of the Neumann series of the rendering equation.

    L = Le + T Le + T² Le + …      (T L)(p, ωo) = ∫ f(p, ωi, ωo) L(r(p, ωi), −ωi) cosθi dωi

Enters: a lesson's pixel and numbers of samples. Leaves: for each sample what came after 0, 1, 2, … reflections, and
all that came after more. A sample whose depth is limited to k + 1 has the terms up to T^k Le; the same sample with one
more has one term more, as its path begins with the same random numbers. So a term is the difference of two, has little
noise of its own, and the terms of a sample sum to that sample exactly.
Source: Kajiya 1986; Veach 1997, section 4.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderer.backend import mitsuba
from renderer.lesson.pixel import Lesson
from renderer.settings import Settings

mi: Any = mitsuba()

MOST_TERMS = 8  # told one by one; what comes after more reflections is told together


def by_bounces(lesson: Lesson, numbers: range, seed: int = 0) -> NDArray[np.float64]:
    """Luminance of samples number `numbers` by reflections: (terms + 1, n), the last row what came after more.

    There are as many terms as the scene's depth admits, at most MOST_TERMS. Samples are those of `Lesson.samples` with
    technique mis, but for paths without a limit, which end by roulette a little later.
    """
    scene = lesson.scene
    settings = scene.resolved(Settings(technique="mis", independent_pixels=True), 1)
    kernel = scene.kernel(settings)
    depth = settings.max_depth if settings.max_depth is not None and settings.max_depth >= 0 else None
    n_terms = MOST_TERMS if depth is None else min(MOST_TERMS, depth)
    pixel = np.full(len(numbers), lesson.y * scene.width + lesson.x, dtype=np.uint32)
    replicates = np.asarray(numbers, dtype=np.uint32)

    def luminance(limited: Any) -> NDArray[np.float64]:
        radiance, *_ = limited.launch(pixel, replicates, seed)
        values = np.array(mi.luminance(mi.Color3f(radiance)), dtype=np.float64)
        return np.where(np.isfinite(values), values, 0.0)

    sums = [luminance(kernel.with_depth_limit(terms)) for terms in range(1, n_terms + 1)]
    all_of_it = luminance(kernel)
    return np.diff(np.stack([*sums, all_of_it]), axis=0, prepend=np.zeros((1, len(numbers))))
