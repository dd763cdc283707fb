"""Decides which lanes come next. Pure: nothing is rendered here, and no clock is read.

A *round* gives every pixel of lowest count one more replicate. The first round starts with a coarse grid of pixels, so
that there is a picture at once, and then fills the gaps, finer and finer; later rounds go in bands of rows. The order
follows from these counts alone, so a resumed render goes on exactly where it would have. How many lanes go into a pass
follows from the speed seen so far; a pixel's replicates are added in order all the same, so no bit depends on it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FIRST_REPLICATES = 2
FIRST_SAMPLES = 2**17  # of the first pass: a picture within a fraction of a second
MIN_PASS_SAMPLES, MAX_PASS_SAMPLES = 2**17, 2**22
PASS_SECONDS = 0.2  # aimed at: how long a stop, a pause or another job waits
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
    tried: NDArray[np.int64],
    width: int,
    height: int,
    replicate_size: int,
    replicates_wanted: int | None,
    pass_samples: Callable[[], int] = lambda: 2**20,
) -> Iterator[Pass]:
    """The passes of the next round.

    tried: (n,) replicates rendered so far. replicates_wanted: never go beyond this. pass_samples: asked each time.
    """
    low = int(tried.min())
    n = width * height
    if low == 0:
        yield from _first_round(tried, width, height, replicate_size, replicates_wanted, pass_samples)
        return
    lanes = max(1, pass_samples() // replicate_size)
    behind = np.flatnonzero(tried == low).astype(np.uint32)
    if low < FIRST_REPLICATES:
        # Rows in scattered order: until every pixel has a variance, those that have one must stand for the image.
        behind = behind[np.argsort(_scattered(height)[behind // width], kind="stable")]
    # Small images take several replicates in one pass, as long as no checkpoint is skipped.
    n_replicates = 1
    if len(behind) == n:
        n_replicates = max(1, min(lanes // n, next_checkpoint(low) - low))
    if replicates_wanted is not None:
        n_replicates = max(1, min(n_replicates, replicates_wanted - low))
    start = 0
    while start < len(behind):
        step = _even(len(behind) - start, pass_samples() // (replicate_size * n_replicates))
        yield Pass(behind[start : start + step], low, n_replicates)
        start += step


def _scattered(n: int) -> NDArray[np.int64]:
    """A rank for each of n rows that visits them evenly: the order of the golden-ratio sequence."""
    return np.argsort(np.argsort((np.arange(n) * 0.6180339887498949) % 1.0))


def _even(rest: int, most: int) -> int:
    """Size of the next part when `rest` is cut into equal parts of about `most`: no small remainder at the end."""
    return -(-rest // max(1, round(rest / max(1, most))))


def pass_samples_for(samples_per_second: float) -> int:
    """Samples of a pass that takes about PASS_SECONDS."""
    return int(min(max(samples_per_second * PASS_SECONDS, MIN_PASS_SAMPLES), MAX_PASS_SAMPLES))


def _first_round(
    tried: NDArray[np.int64],
    width: int,
    height: int,
    replicate_size: int,
    replicates_wanted: int | None,
    pass_samples: Callable[[], int],
) -> Iterator[Pass]:
    stride = coarse_stride(width, height, replicate_size)
    done = tried > 0
    # Two replicates on the first grid: with the first picture comes a first error.
    n_replicates = 1 if replicates_wanted == 1 else FIRST_REPLICATES
    while stride >= 1:
        rows = np.arange(0, height, stride, dtype=np.uint32)
        columns = np.arange(0, width, stride, dtype=np.uint32)
        grid = (rows[:, None] * np.uint32(width) + columns[None, :]).ravel()
        fresh = grid[~done[grid]]
        start = 0
        while start < len(fresh):
            step = _even(len(fresh) - start, pass_samples() // (replicate_size * n_replicates))
            yield Pass(fresh[start : start + step], 0, n_replicates)
            start += step
        if stride == 1:
            return
        done = done.copy()
        done[grid] = True
        stride //= 2
        n_replicates = 1


def coarse_stride(width: int, height: int, replicate_size: int) -> int:
    """Distance of the first grid's pixels, a power of two: its samples fit the first pass."""
    stride = 1
    while -(-width // stride) * -(-height // stride) * replicate_size * FIRST_REPLICATES > FIRST_SAMPLES:
        stride *= 2
    return stride


def next_checkpoint(replicates: int) -> int:
    """The next number of replicates at which a target may be checked: few, so that looking does not fool it."""
    checkpoint = MIN_REPLICATES_TO_STOP
    while checkpoint <= replicates:
        checkpoint = max(checkpoint + 1, int(checkpoint * CHECKPOINT_GROWTH))
    return checkpoint


def is_checkpoint(replicates: int) -> bool:
    """Whether a target may be checked at this number of replicates."""
    return replicates >= MIN_REPLICATES_TO_STOP and next_checkpoint(replicates - 1) == replicates
