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
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from renderer.stopping import next_checkpoint

FIRST_REPLICATES = 2
FIRST_SAMPLES = 2**17  # of the first pass: a picture within a fraction of a second
SOON_PASSES = 4  # if two replicates of every pixel fit into so many, the first whole picture has two, else one
FIRST_SHARE = 0.5  # of the time left, that two replicates of every pixel may take before all have one
MIN_PASS_SAMPLES, MAX_PASS_SAMPLES = 2**17, 2**22
PASS_SEGMENTS = 2**23  # path segments that a pass shall not exceed where MIN_PASS_SAMPLES would
LEAST_LANES = 64  # fewer leave processors without work
TIMED_PASSES = 8  # that a time has room for at least
MIN_TIMED_SAMPLES = 2**14  # where the target is a time, which one pass shall not use up
PASS_SECONDS = 0.2  # aimed at: how long a stop, a pause or another job waits
ADAPTIVE_FROM = 4  # replicates of every pixel
MOST_TOGETHER = 16  # replicates of a pixel: that many fill a processor's vector
TILE = 4  # pixels on a side
FINEST_LOOK = 4  # pixels between those of a look; finer, it would cost as much as what it stands for
KEPT_VISITS = 2**22  # pixels of an image whose order is kept from pass to pass


@dataclass(frozen=True, slots=True)
class Pass:
    """Lanes of one kernel launch: replicates first … first + n − 1 of each pixel; both may differ by pixel.

    is_look: for a first picture only; these replicates are not whole and do not count.
    """

    pixels: NDArray[np.uint32]
    first: int | NDArray[np.int64]
    n_replicates: int | NDArray[np.int64]
    is_look: bool = False

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
    is_shared: bool = False,
) -> Iterator[Pass]:
    """The passes of the next round.

    tried: (n,) replicates rendered so far. replicates_wanted: never go beyond this. pass_samples: asked each time.
    is_checked: whether a target is looked at on the way, at checkpoints. samples_left: that may be rendered before all
    is over, about: then a round is kept so short that all pixels have their share. is_shared: whether neighbours share
    samples (`equation/film.py`): passes then are blocks of the image, for their borders are rendered twice.
    """
    low = int(tried.min())
    n = width * height
    if is_shared:
        yield from _shared_round(
            tried, width, height, replicate_size, replicates_wanted, pass_samples, is_checked, samples_left
        )
        return
    if low == 0:
        yield from _first_round(tried, width, height, replicate_size, replicates_wanted, pass_samples, samples_left)
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
    yield from _cut(behind, low, n_replicates, lambda: pass_samples() // (replicate_size * n_replicates))


def _cut(pixels: NDArray[np.uint32], first: int, n_replicates: int, most: Callable[[], int]) -> Iterator[Pass]:
    """Passes that render these replicates of all of `pixels`, in this order; each of about `most` pixels."""
    start = 0
    while start < len(pixels):
        step = _even(len(pixels) - start, most())
        yield Pass(pixels[start : start + step], first, n_replicates)
        start += step


def level(
    is_wanted: NDArray[np.bool_],
    width: int,
    first: int,
    n_replicates: int,
    replicate_size: int,
    pass_samples: Callable[[], int] = lambda: 2**20,
    is_shared: bool = False,
) -> Iterator[Pass]:
    """The passes that render replicates first … first + n − 1 of the pixels (n,) that are wanted.

    is_shared: see `next_round`.
    """
    most = lambda: pass_samples() // (replicate_size * n_replicates)  # noqa: E731
    height = len(is_wanted) // width
    if not is_shared:
        order = _visits(width, height)
        yield from _cut(order[is_wanted[order]], first, n_replicates, most)
        return
    image = is_wanted.reshape(height, width)
    rows, columns = (np.flatnonzero(image.any(axis=axis)) for axis in (1, 0))
    top, left, bottom, right = int(rows[0]), int(columns[0]), int(rows[-1]) + 1, int(columns[-1]) + 1
    yield from _in_blocks(image[top:bottom, left:right], (left, top), width, first, n_replicates, most())


def _in_blocks(
    is_wanted: NDArray[np.bool_], corner: tuple[int, int], width: int, first: int, n_replicates: int, most: int
) -> Iterator[Pass]:
    """As `_cut`, block by block, for the pixels that are wanted of a part of the image. corner: its first column and
    row. width: of the image.
    """
    for rows, columns in _blocks(is_wanted.shape[1], is_wanted.shape[0], most):
        y, x = np.nonzero(is_wanted[rows, columns])
        if len(y):
            pixels = (y + rows.start + corner[1]) * width + x + columns.start + corner[0]
            yield Pass(pixels.astype(np.uint32), first, n_replicates)


def _shared_round(
    tried: NDArray[np.int64],
    width: int,
    height: int,
    replicate_size: int,
    replicates_wanted: int | None,
    pass_samples: Callable[[], int],
    is_checked: bool,
    samples_left: float,
) -> Iterator[Pass]:
    """As `next_round`, block by block."""
    low, n = int(tried.min()), width * height
    if low == 0:
        yield from _looks(width, height, replicate_size, pass_samples)
    room = max(1, pass_samples() // (replicate_size * n))
    ahead = tried[tried > low]
    if len(ahead):
        n_replicates = int(ahead.min()) - low
    elif low == 0:
        n_replicates = FIRST_REPLICATES if room >= FIRST_REPLICATES else 1
    else:
        n_replicates = min(room, next_checkpoint(low) - low) if is_checked else room
    n_replicates = int(max(1, min(n_replicates, samples_left / (replicate_size * n))))
    if replicates_wanted is not None:
        n_replicates = max(1, min(n_replicates, replicates_wanted - low))
    is_behind = (tried == low).reshape(height, width)
    yield from _in_blocks(
        is_behind, (0, 0), width, low, n_replicates, pass_samples() // (replicate_size * n_replicates)
    )


def _blocks(width: int, height: int, n_pixels: int) -> list[tuple[slice, slice]]:
    """Rows and columns of blocks of about so many pixels, nearly square, that make up the image; in scattered order, so
    that a picture in between shows all of its parts.
    """
    side = max(1.0, n_pixels**0.5)
    across = max(1, round(width / side)) if n_pixels < width * height else 1
    down = max(1, round(width * height / (across * max(n_pixels, 1))))
    edges = [np.linspace(0, whole, parts + 1).round().astype(int) for whole, parts in ((height, down), (width, across))]
    rows, columns = ([slice(int(a), int(b)) for a, b in pairwise(e)] for e in edges)
    blocks = [(r, c) for r in rows for c in columns if r.start < r.stop and c.start < c.stop]
    return [blocks[i] for i in np.argsort((np.arange(len(blocks)) * 0.6180339887498949) % 1.0)]


def _looks(width: int, height: int, replicate_size: int, pass_samples: Callable[[], int]) -> Iterator[Pass]:
    """Passes over single pixels of a grid, where a whole round would keep the first picture waiting; over finer and
    finer ones, where it takes long.
    """
    stride, coarser = coarse_stride(width, height, replicate_size), 0
    while stride > 1:
        rows, columns = np.mgrid[0:height:stride, 0:width:stride]
        is_new = (rows % coarser != 0) | (columns % coarser != 0) if coarser else np.ones(rows.shape, bool)
        fresh = (rows * width + columns)[is_new].astype(np.uint32)
        start = 0
        while start < len(fresh):
            step = _even(len(fresh) - start, pass_samples() // replicate_size)
            yield Pass(fresh[start : start + step], 0, 1, is_look=True)
            start += step
        if replicate_size * width * height <= SOON_PASSES * pass_samples() or stride // 2 < FINEST_LOOK:
            return
        stride, coarser = stride // 2, stride


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


def sample_of(width: int, height: int, n: int) -> NDArray[np.uint32]:
    """About n pixels from all over the image, in tiles, as passes have them."""
    order = _visits(width, height)
    tiles = len(order) // TILE**2
    if n >= len(order) or not tiles:
        return order
    chosen = np.linspace(0, tiles - 1, max(1, n // TILE**2)).astype(np.int64)
    return order[(chosen[:, None] * TILE**2 + np.arange(TILE**2)).ravel()]


def _even(rest: int, most: int) -> int:
    """Size of the next part when `rest` is cut into equal parts of about `most`: no small remainder at the end."""
    return -(-rest // max(1, round(rest / max(1, most))))


def pass_samples_for(
    samples_per_second: float,
    segments_per_sample: float = 1.0,
    replicate_size: int = 1,
    seconds: float | None = None,
    aimed: float = PASS_SECONDS,
) -> int:
    """Samples of a pass that takes about `aimed` seconds; fewer where paths are so long that even the least would not.

    seconds: of the target, of which a pass takes a fraction.
    """
    least = min(MIN_PASS_SAMPLES, PASS_SEGMENTS / max(segments_per_sample, 1.0))
    if seconds is not None:
        least, aimed = min(least, MIN_TIMED_SAMPLES), min(aimed, seconds / TIMED_PASSES)
    return int(min(max(samples_per_second * aimed, least, LEAST_LANES * replicate_size), MAX_PASS_SAMPLES))


def _first_round(
    tried: NDArray[np.int64],
    width: int,
    height: int,
    replicate_size: int,
    replicates_wanted: int | None,
    pass_samples: Callable[[], int],
    samples_left: float,
) -> Iterator[Pass]:
    is_short = math.isfinite(samples_left)
    stride = coarse_stride(width, height, replicate_size, pass_samples() if is_short else FIRST_SAMPLES)
    done = tried > 0
    # Two replicates on the first grid: with the first picture comes a first error.
    n_replicates = 1 if replicates_wanted == 1 else FIRST_REPLICATES
    while stride >= 1:
        n_columns, n_rows = -(-width // stride), -(-height // stride)
        rows, columns = np.divmod(_visits(n_columns, n_rows), np.uint32(n_columns))
        grid = (rows * np.uint32(width) + columns) * np.uint32(stride)
        yield from _cut(
            grid[~done[grid]], 0, n_replicates, lambda n=n_replicates: pass_samples() // (replicate_size * n)
        )
        if stride == 1:
            return
        done = done.copy()
        done[grid] = True
        stride //= 2
        # Paths of the same pixel are alike: two go together where nobody waits much longer for the whole picture.
        together = FIRST_REPLICATES * replicate_size * width * height
        is_soon = together <= SOON_PASSES * pass_samples() and together <= FIRST_SHARE * samples_left
        n_replicates = FIRST_REPLICATES if is_soon and replicates_wanted != 1 else 1


def coarse_stride(width: int, height: int, replicate_size: int, most: int = FIRST_SAMPLES) -> int:
    """Distance of the first grid's pixels, a power of two: its samples fit the first pass, of `most` or less."""
    stride, most = 1, max(min(most, FIRST_SAMPLES), replicate_size * FIRST_REPLICATES)
    while -(-width // stride) * -(-height // stride) * replicate_size * FIRST_REPLICATES > most:
        stride *= 2
    return stride
