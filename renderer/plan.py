"""Decides which lanes come next. Pure: nothing is rendered here, and no clock is read.

A *round* gives every pixel of lowest count one more replicate. The first round starts with a coarse grid of pixels, so
that there is a picture at once, and then fills the gaps, finer and finer; later rounds go in bands of rows. The order
follows from the counts alone, so a resumed render goes on exactly where it would have.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FIRST_REPLICATES = 2
FIRST_SAMPLES = 2**18  # of the first pass: a picture within a fraction of a second
PASS_SAMPLES = 2**20  # of any other pass: about the smallest that keeps all lanes busy
MIN_REPLICATES_TO_STOP = 4  # before an error target can be believed
CHECKPOINT_GROWTH = 1.15


@dataclass(frozen=True, slots=True)
class Pass:
    """Lanes of one kernel launch: replicates first … first + n − 1 of each pixel."""

    pixels: NDArray[np.uint32]
    first: int
    n_replicates: int

    @property
    def n_lanes(self) -> int:
        """Lanes of the launch."""
        return len(self.pixels) * self.n_replicates


def next_round(
    count: NDArray[np.int64], width: int, height: int, replicate_size: int, replicates_wanted: int | None
) -> Iterator[Pass]:
    """The passes of the next round. count: (n,) replicates so far. replicates_wanted: never go beyond this."""
    low = int(count.min())
    n = width * height
    lanes = max(1, PASS_SAMPLES // replicate_size)
    if low == 0:
        yield from _first_round(count, width, height, replicate_size, replicates_wanted)
        return
    behind = np.flatnonzero(count == low).astype(np.uint32)
    # Small images take several replicates in one pass, as long as no checkpoint is skipped.
    n_replicates = 1
    if len(behind) == n:
        n_replicates = max(1, min(lanes // n, next_checkpoint(low) - low))
    if replicates_wanted is not None:
        n_replicates = max(1, min(n_replicates, replicates_wanted - low))
    step = max(1, lanes // n_replicates)
    for start in range(0, len(behind), step):
        yield Pass(behind[start : start + step], low, n_replicates)


def _first_round(
    count: NDArray[np.int64], width: int, height: int, replicate_size: int, replicates_wanted: int | None
) -> Iterator[Pass]:
    stride = coarse_stride(width, height, replicate_size)
    lanes = max(1, PASS_SAMPLES // replicate_size)
    done = count > 0
    # Two replicates on the first grid: with the first picture comes a first error.
    n_replicates = 1 if replicates_wanted == 1 else FIRST_REPLICATES
    while stride >= 1:
        rows = np.arange(0, height, stride, dtype=np.uint32)
        columns = np.arange(0, width, stride, dtype=np.uint32)
        grid = (rows[:, None] * np.uint32(width) + columns[None, :]).ravel()
        fresh = grid[~done[grid]]
        for start in range(0, len(fresh), lanes):
            yield Pass(fresh[start : start + lanes], 0, n_replicates)
        if stride == 1:
            return
        done = done.copy()
        done[grid] = True
        stride //= 2
        n_replicates = 1


def coarse_stride(width: int, height: int, replicate_size: int) -> int:
    """Distance of the first grid's pixels, a power of two: its samples fit the first pass."""
    excess = width * height * replicate_size * FIRST_REPLICATES / FIRST_SAMPLES
    return 1 if excess <= 1 else 2 ** math.ceil(math.log2(math.sqrt(excess)))


def next_checkpoint(replicates: int) -> int:
    """The next number of replicates at which a target may be checked: few, so that looking does not fool it."""
    checkpoint = MIN_REPLICATES_TO_STOP
    while checkpoint <= replicates:
        checkpoint = max(checkpoint + 1, int(checkpoint * CHECKPOINT_GROWTH))
    return checkpoint


def is_checkpoint(replicates: int) -> bool:
    """Whether a target may be checked at this number of replicates."""
    return replicates >= MIN_REPLICATES_TO_STOP and next_checkpoint(replicates - 1) == replicates
