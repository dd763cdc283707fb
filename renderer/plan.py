"""Decides which lanes come next. Pure: nothing is rendered here, and no clock is read.

A *round* gives every pixel of lowest count one more replicate. The first round starts with a coarse grid of pixels, so
that there is a picture at once, and then fills the gaps, finer and finer. Pixels come in bands of rows. The order
follows from these counts alone, so a resumed render goes on exactly where it would have. How many lanes go into a pass
follows from the speed seen so far; a pixel's replicates are added in order all the same, so no bit depends on it.

Adaptive rounds come once every pixel has a few replicates: `allocation.next_counts` says from the estimate at the end
of a round how many replicates each pixel has at the end of the next. These counts are kept with the estimate until they
are reached, so a render that was stopped in the middle of a round goes on with the same ones.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

FIRST_REPLICATES = 2
FIRST_SAMPLES = 2**17  # of the first pass: a picture within a fraction of a second
SOON_PASSES = 4  # that the first whole picture may take with as many replicates everywhere as at first
MIN_PASS_SAMPLES, MAX_PASS_SAMPLES = 2**17, 2**22
PASS_SECONDS = 0.2  # aimed at: how long a stop, a pause or another job waits
MIN_REPLICATES_TO_STOP = 4  # before an error target can be believed
CHECKPOINT_GROWTH = 1.15
ADAPTIVE_FROM = 4  # replicates of every pixel
MOST_TOGETHER = 16  # replicates of a pixel: that many fill a processor's vector
TILE = 4  # pixels on a side
KEPT_VISITS = 2**22  # pixels of an image whose order is kept from pass to pass


@dataclass(frozen=True, slots=True)
class Pass:
    """Lanes of one kernel launch: replicates first … first + n − 1 of each pixel; both may differ by pixel."""

    pixels: NDArray[np.uint32]
    first: int | NDArray[np.int64]
    n_replicates: int | NDArray[np.int64]

    @property
    def n_lanes(self) -> int:
        """Lanes of the launch."""
        n = self.n_replicates
        return len(self.pixels) * n if isinstance(n, int) else int(n.sum())

    def lanes(self) -> tuple[NDArray[np.uint32], NDArray[np.uint32]]:
        """(n_lanes,) pixel and replicate of each lane. A pixel's replicates run together: their paths are alike."""
        n = self.n_replicates
        pixels = np.repeat(self.pixels, n)
        within = np.arange(self.n_lanes) - np.repeat(self._starts(), n)
        return pixels, (np.repeat(np.broadcast_to(self.first, len(self.pixels)), n) + within).astype(np.uint32)

    def _starts(self) -> NDArray[np.int64]:
        """(n,) first lane of each pixel."""
        n = self.n_replicates
        return np.arange(len(self.pixels)) * n if isinstance(n, int) else np.cumsum(n) - n


def next_round(
    tried: NDArray[np.int64],
    width: int,
    height: int,
    replicate_size: int,
    replicates_wanted: int | None,
    pass_samples: Callable[[], int] = lambda: 2**20,
    is_checked: bool = True,
    samples_left: float = math.inf,
) -> Iterator[Pass]:
    """The passes of the next round.

    tried: (n,) replicates rendered so far. replicates_wanted: never go beyond this. pass_samples: asked each time.
    is_checked: whether a target is looked at on the way, at checkpoints. samples_left: that may be rendered before all
    is over, about: then a round is kept so short that all pixels have their share.
    """
    low = int(tried.min())
    n = width * height
    if low == 0:
        yield from _first_round(tried, width, height, replicate_size, replicates_wanted, pass_samples)
        return
    order = _visits(width, height)
    behind = order[tried[order] == low]
    # A pixel's replicates run together, for their paths are alike: several in one pass, as long as no checkpoint is
    # skipped that matters, as many as the image has room for, or more in one part of it after the other.
    room = max(1, pass_samples() // (replicate_size * n))
    if len(behind) < n:
        n_replicates = int(tried[tried > low].min()) - low
    elif low < ADAPTIVE_FROM:
        n_replicates = min(room if is_checked else ADAPTIVE_FROM, next_checkpoint(low) - low)
    else:
        n_replicates = next_checkpoint(low) - low if is_checked else low
    n_replicates = min(n_replicates, max(room, MOST_TOGETHER))
    n_replicates = int(max(1, min(n_replicates, samples_left / (replicate_size * n))))
    if replicates_wanted is not None:
        n_replicates = max(1, min(n_replicates, replicates_wanted - low))
    start = 0
    while start < len(behind):
        step = _even(len(behind) - start, pass_samples() // (replicate_size * n_replicates))
        yield Pass(behind[start : start + step], low, n_replicates)
        start += step


def planned_round(
    tried: NDArray[np.int64],
    planned: NDArray[np.int64],
    width: int,
    replicate_size: int,
    lanes_left: int | None = None,
    pass_samples: Callable[[], int] = lambda: 2**20,
) -> Iterator[Pass]:
    """The passes that bring every pixel to its planned number of replicates.

    lanes_left: never render more than this.
    """
    order = _visits(width, -(-len(tried) // width))
    behind = order[(planned > tried)[order]]
    missing = planned[behind] - tried[behind]
    ends = np.cumsum(missing)
    rest = int(ends[-1]) if len(ends) else 0
    if lanes_left is not None and lanes_left < rest:
        last = int(np.searchsorted(ends, lanes_left))
        behind, missing = behind[: last + 1], missing[: last + 1].copy()
        missing[-1] -= int(ends[last]) - lanes_left
        ends = np.cumsum(missing)
        rest = lanes_left
    done = start = 0
    while done < rest:
        most = _even(rest - done, pass_samples() // replicate_size)
        stop = max(start + 1, int(np.searchsorted(ends, done + most, side="right")))
        chosen = slice(start, stop)
        some, n = behind[chosen], missing[chosen]
        if (n > 0).any():
            some, n = some[n > 0], n[n > 0]
            yield Pass(some, tried[some], n)
        start, done = stop, int(ends[stop - 1])


def _visits(width: int, height: int) -> NDArray[np.uint32]:
    """(n,) pixels in the order in which they are rendered: bands of rows, and within each tile by tile.

    The bands come in scattered order (that of the golden-ratio sequence): a render that ends in between has served all
    parts of the image alike, and those pixels that have a variance already stand for it. The lanes that a processor
    works on at a time are a tile: their rays are alike, whatever their pixel's replicates.
    """
    return _made_visits(width, height) if width * height > KEPT_VISITS else _kept_visits(width, height)


def _made_visits(width: int, height: int) -> NDArray[np.uint32]:
    bands, columns = -(-height // TILE), -(-width // TILE)
    pixels = np.full((bands * TILE, columns * TILE), -1, np.int64)
    pixels[:height, :width] = np.arange(width * height).reshape(height, width)
    tiled = pixels.reshape(bands, TILE, columns, TILE).swapaxes(1, 2)
    scattered = tiled[np.argsort((np.arange(bands) * 0.6180339887498949) % 1.0)].ravel()
    return scattered[scattered >= 0].astype(np.uint32)


_kept_visits = lru_cache(maxsize=8)(_made_visits)


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
        n_columns, n_rows = -(-width // stride), -(-height // stride)
        rows, columns = np.divmod(_visits(n_columns, n_rows), np.uint32(n_columns))
        grid = (rows * np.uint32(width) + columns) * np.uint32(stride)
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
        # Paths of the same pixel are alike: two go together where nobody waits much longer for the whole picture.
        is_soon = FIRST_REPLICATES * replicate_size * width * height <= SOON_PASSES * pass_samples()
        n_replicates = FIRST_REPLICATES if is_soon and replicates_wanted != 1 else 1


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
