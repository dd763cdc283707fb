"""How often the 95 % intervals of trusted pixels hold the truth, and how often trust is misplaced."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from renderer.estimate.interval import half_width, trust
from renderer.estimate.moments import LUMINANCE, Moments
from tests.coverage_study.bank import Bank, BankKernel

COUNTS = (16, 32, 64, 128, 256)  # replicates of 16 samples each
FAR = 2.0  # half widths from the truth: 1 in 10 000 for a normal mean, so a sign of misplaced trust
ROUNDING = 1e-6  # of the truth: what float32 replicates leave undecided


@dataclass(frozen=True)
class Coverage:
    """Shares: trusted of all pixels; covered of the trusted, and of all; false: trusted and far off, of all pixels."""

    replicates: int
    trusted: float
    covered: float
    covered_untested: float
    false: float


def measure(bank: Bank, runs: int, counts: tuple[int, ...] = COUNTS) -> list[Coverage]:
    """One row per number of replicates, over independent runs."""
    kernel, width = BankKernel(bank), bank.scene.width
    n = bank.values.shape[1]
    truth = bank.mean @ LUMINANCE
    pixels, none = np.arange(n, dtype=np.uint32), np.zeros(n, np.uint32)
    sums = {count: np.zeros(4) for count in counts}
    for run in range(runs):
        moments = Moments.empty(n)
        for index in range(max(counts)):
            radiance, *_ = kernel.launch(pixels, np.full(n, index, np.uint32), 1000 + run)
            moments.add(slice(None), radiance.T, none, 16)
            if index + 1 in sums:
                is_trusted = trust(moments, width)
                off = np.maximum(np.abs(moments.luminance() - truth) - ROUNDING * truth, 0.0)
                half = half_width(moments)[:, 3]
                held, far = off <= half, off > FAR * half
                sums[index + 1] += [is_trusted.sum(), (held & is_trusted).sum(), held.sum(), (far & is_trusted).sum()]
    rows = []
    for count, (trusted, covered, held, false) in sums.items():
        rows.append(Coverage(count, trusted / n / runs, covered / max(trusted, 1), held / n / runs, false / n / runs))
    return rows
