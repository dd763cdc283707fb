"""A film whose filter shares samples: each counts in every pixel that the reconstruction filter reaches.

A *lane* is (place, replicate): it draws its samples in one pixel's square, and keeps each of them. A pixel's replicate
is the sum, over the squares within `reach` of it, of the samples of the lanes of the same index, weighted by the
filter, whose integral is one:

    R(p, r) = Σ over q within reach of p   1/B Σ over j   f(q − p + u(r, j) − ½) L(q, r, j)

Its expectation is the filtered radiance, and over r a pixel's values are independent and identically distributed, as
without sharing; neighbouring pixels are correlated. A sample at a random place in the filter's support has as much
variance as the radiance there; shared, it is averaged with those of the neighbours (Gaussian filter: 3.1 times less
variance a pixel, tent: 2.25).

The offsets u in the square are those of a randomly shifted lattice, one for all squares of a replicate: then the
weights that a pixel receives sum to one wherever the translates of the filter do, a constant image has no noise, and
no division by a sum of weights is needed, which would bias.

Enters: pixels and replicates that are wanted. Leaves: the lanes to render, and how they are added up. The squares
around the image are rendered too: a pixel at the border sees what its filter reaches.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from renderer.backend import mitsuba
from renderer.equation import mueller
from renderer.equation.sequence import ONE_MINUS_EPSILON, Sequence, mix, unit
from renderer.estimate.correlation import correlation_of

mi: Any = mitsuba()

MOST_REACH = 3  # pixels, of the filters that samples are shared by: 49 squares
EVERY_PLACE = 0xFFFFFFFF  # the number of no square
STEPS = 2**12  # to a pixel, of integrals of the filter
NEVER = 2**31 - 1  # the index of no replicate
TILE = 4  # pixels on a side: lanes that run side by side are a tile of the picture


@dataclass(frozen=True, slots=True)
class Lanes:
    """What a launch renders for the replicates that are wanted.

    places: (n,) uint32, squares of the image with its border, row-major. replicates: (n,) uint32. Around the pixels
    that are wanted lies a rectangle of squares, `stride` to a row. starts: uint32, for each of them the number of its
    lane of replicate 0 (modulo 2^32). targets: uint32, each wanted pixel's square in it.
    """

    places: NDArray[np.uint32]
    replicates: NDArray[np.uint32]
    starts: NDArray[np.uint32]
    targets: NDArray[np.uint32]
    stride: int


class SharedFilm:
    """Lanes and weights of a separable reconstruction filter.

    has_stokes: whether samples are Stokes vectors. floats: of a kept sample, four for each component.
    """

    def __init__(self, rfilter: Any, has_stokes: bool = False) -> None:
        self.n_components = mueller.COMPONENTS if has_stokes else 1
        self.floats = 4 * self.n_components
        self.rfilter = rfilter
        self.reach = reach_of(rfilter)
        radius = float(rfilter.radius())
        n = math.ceil(radius * STEPS)
        profile = np.array(rfilter.eval(mi.Float(((np.arange(-n, n) + 0.5) / STEPS).astype(np.float32))), np.float64)
        self.integral = float(profile.sum() / STEPS)
        self.correlation = correlation_of(profile, 1 / STEPS, self.reach)

    def offset(self, index: Any, replicate: Any, seed: tuple[Any, Any], sizes: Any) -> Any:
        """Where in its square the index-th sample of a replicate lies: Point2f in [0, 1)²."""
        replicate_size, generator = sizes
        a, b = Sequence.keys(*seed, mi.UInt32(EVERY_PLACE), replicate)
        inverse = 1 / mi.Float(replicate_size)
        x = mi.Float(index) * inverse + unit(mix(a), mi.Float)
        y = mi.Float((index * generator) & (replicate_size - 1)) * inverse + unit(mix(b), mi.Float)
        return mi.Point2f(*(dr.minimum(v - dr.floor(v), ONE_MINUS_EPSILON) for v in (x, y)))

    def weights(self, u: Any) -> list[Any]:
        """What a sample at u (0 … 1) in the squares at −reach … reach from a pixel counts in it, along one axis."""
        return [self.rfilter.eval(u + (k - 0.5)) / self.integral for k in range(-self.reach, self.reach + 1)]

    def keep(self, samples: Any, number: Any, rgb: Any, is_finite: Any, active: Any) -> None:
        """Writes a sample to its place; one that is not finite counts as 0."""
        for i, one in enumerate(mueller.parts_of(rgb)):
            value = dr.select(is_finite, one, 0)
            at = number * self.n_components + i if self.n_components > 1 else number
            dr.scatter(samples, mi.Vector4f(value.x, value.y, value.z, 0), at, active)

    @dr.syntax
    def added_up(
        self, samples: Any, invalid: Any, starts: Any, target: Any, replicate: Any, stride: Any, seed: Any, sizes: Any
    ) -> Any:
        """Radiance (Color3f, or Stokes vectors of it) of each wanted pixel's replicate.

        samples: `floats` for each sample of each lane. invalid: of each lane, how many were not finite (and are 0
        here): those that were stand for them. target: the pixel's square, in `starts`. stride: of a row in `starts`.
        """
        replicate_size, _ = sizes
        reach = self.reach
        around, shares = [], []
        for dy in range(-reach, reach + 1):
            for dx in range(-reach, reach + 1):
                square = target + mi.UInt32(mi.Int32(stride) * dy + dx)
                lane = dr.gather(mi.UInt32, starts, square) + replicate
                finite = replicate_size - dr.gather(mi.UInt32, invalid, lane)
                around.append(lane * replicate_size)
                shares.append(dr.select(finite > 0, 1 / mi.Float(finite), 0))
        total = mueller.zeros(mi.Color3f, self.n_components > 1)
        index = mi.UInt32(0)
        while dr.hint(index < replicate_size, label="film"):
            u = self.offset(index, replicate, seed, sizes)
            across, down = self.weights(u.x), self.weights(u.y)
            k = 0
            for wy in down:
                for wx in across:
                    total += self._kept(samples, around[k] + index) * (wx * wy * shares[k])
                    k += 1
            index += 1
        return total

    def _kept(self, samples: Any, number: Any) -> Any:
        """A sample that `keep` wrote."""
        if self.n_components == 1:
            return _colour_at(samples, number)
        parts = [_colour_at(samples, number * self.n_components + i) for i in range(self.n_components)]
        return mueller.stokes_of(mi.Color3f).of(parts)


def _colour_at(samples: Any, number: Any) -> Any:
    found = dr.gather(mi.Vector4f, samples, number)
    return mi.Color3f(found.x, found.y, found.z)


def reach_of(rfilter: Any) -> int:
    """How many pixels further a sample counts, at most; 0 for a box."""
    return 0 if rfilter.is_box_filter() else max(0, math.ceil(float(rfilter.radius()) + 0.5 - 1e-6) - 1)


def shares_samples(rfilter: Any) -> bool:
    """Whether the filter is wider than a pixel, and not so wide that sharing would cost too much."""
    return 0 < reach_of(rfilter) <= MOST_REACH


@lru_cache(maxsize=8)
def generator_of(n: int) -> int:
    """The odd number whose lattice j/n, (j · generator mod n)/n has its points farthest from each other."""

    def nearest(g: int) -> int:
        j = np.arange(1, n)
        x, y = np.minimum(j, n - j), np.minimum(j * g % n, n - j * g % n)
        return int(np.min(x * x + y * y))

    return max(range(1, max(n, 2), 2), key=lambda g: (nearest(g), -g)) if n > 2 else 1


def lanes_for(pixels: NDArray[np.uint32], replicates: NDArray[np.uint32], width: int, reach: int) -> Lanes:
    """The lanes that make these replicates of these pixels whole. width: of the image."""
    rows, columns = np.divmod(pixels.astype(np.int64), width)
    top, left = int(rows.min()), int(columns.min())
    rows, columns = rows - top, columns - left
    shape = int(rows.max()) + 1, int(columns.max()) + 1
    first, end = np.full(shape, NEVER, np.int32), np.zeros(shape, np.int32)
    indices = replicates.astype(np.int32)
    if (indices == indices[0]).all():
        first[rows, columns], end[rows, columns] = indices[0], indices[0] + 1
    else:
        np.minimum.at(first, (rows, columns), indices)
        np.maximum.at(end, (rows, columns), indices + 1)
    first, end = _widened(first, reach, np.minimum, NEVER), _widened(end, reach, np.maximum, 0)
    n, stride = np.maximum(end - first, 0).ravel(), end.shape[1]
    order = _by_tiles(*end.shape)
    order = order[n[order] > 0]
    each = n[order]
    starts = np.zeros(n.size, np.int64)
    starts[order] = np.cumsum(each) - each - first.ravel()[order]
    down, across = np.divmod(order, stride)
    return Lanes(
        places=np.repeat(((down + top) * (width + 2 * reach) + across + left).astype(np.uint32), each),
        replicates=(np.arange(int(each.sum())) - np.repeat(starts[order], each)).astype(np.uint32),
        starts=(starts & 0xFFFFFFFF).astype(np.uint32),
        targets=((rows + reach) * stride + columns + reach).astype(np.uint32),
        stride=stride,
    )


def _widened(values: NDArray[np.int32], reach: int, larger: np.ufunc, outside: int) -> NDArray[np.int32]:
    """(h + 2 reach, w + 2 reach) the extreme of all values within reach."""
    for axis in (0, 1):
        margin = [(0, 0), (0, 0)]
        margin[axis] = (2 * reach, 2 * reach)
        wide = np.moveaxis(np.pad(values, margin, constant_values=outside), axis, 0)
        parts = [wide[k : k + values.shape[axis] + 2 * reach] for k in range(2 * reach + 1)]
        values = np.moveaxis(larger.reduce(parts), 0, axis)
    return values


@lru_cache(maxsize=4)
def _by_tiles(height: int, width: int) -> NDArray[np.int64]:
    """(height · width,) numbers of all squares, tile by tile: the rays of lanes that run together are alike."""
    bands, across = -(-height // TILE), -(-width // TILE)
    squares = np.full((bands * TILE, across * TILE), -1, np.int64)
    squares[:height, :width] = np.arange(height * width).reshape(height, width)
    tiled = squares.reshape(bands, TILE, across, TILE).swapaxes(1, 2).ravel()
    return tiled[tiled >= 0]
