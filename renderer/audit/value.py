"""What an audit by light paths has found: a value that merges, and what it says about samples spent. NumPy only.

A camera's estimate knows of light only what its samples have met. Light of radiance A that comes in finds worth c each
is met A/c times per sample; where that is hardly ever, the estimate's own variance says nothing. The audit holds A by
classes of c for each tile of the image, from paths that start at the lights. With n samples in a pixel:

    finds      Σ n·A/c                what was to be met
    missing    Σ A over the largest c of which fewer than ENOUGH were to be met
    variance   Σ A·c / n              of the mean of n samples: E[X²] is the mean of what a find is worth

Light that no sample can meet (of points and single directions, by way of mirrors or glass) is a class of its own.
"""

from __future__ import annotations

import base64
import math
import zlib
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

CLASSES = 64  # of worth, each four times the one before; and one of light that is never met
LOWEST = -32  # the exponent of 4 from which the first class begins
ENOUGH = 10.0  # finds after which a pixel's own values tell (`interval.EVENTS`)
SURE = 1.0  # standard errors that are taken off what was found
UNLIKELY = 0.05  # finds in the whole picture: 19 of 20 pictures hold none
MANY = 100.0  # finds in the whole picture, whose number varies by little
ONE_SIDED = 1.645  # standard deviations that a number exceeds in one of 20 cases
NOISE = 0.75  # of what a block is known to have on the average: where tiles tell of less, they are noise
BLOCK = 3  # tiles on a side make a block; so many of these the next
LEAST_TOLD = 0.02  # of the image's mean luminance: less is not worth a sentence
RARE = 1e-3  # finds per sample from which on a light is not called hidden
MOST_TOLD = 4  # sentences


def class_of(worth: Array) -> NDArray[np.int64]:
    """The class of what a find is worth; the last for infinity."""
    with np.errstate(divide="ignore"):
        exponent = np.floor(0.5 * np.log2(worth))
    finite = np.clip(np.nan_to_num(exponent, posinf=0, neginf=LOWEST) - LOWEST, 0, CLASSES - 1).astype(np.int64)
    return np.where(np.isfinite(worth), finite, CLASSES)


def worths() -> Array:
    """(CLASSES + 1,) what a find of each class is worth, about: the middle of the class."""
    return np.append(2.0 * 4.0 ** (np.arange(CLASSES) + LOWEST), np.inf)


@dataclass(frozen=True, slots=True)
class Source:
    """Light of one lamp by way of one thing. energy: its mean luminance in the image. finds: per camera sample."""

    light: str
    via: str
    energy: float
    finds: float


@dataclass(frozen=True)
class Audit:
    """width, height: of the image, in pixels. columns, rows: of its tiles. batches: independent ones, of which all are
    means. spectrum: (tiles, CLASSES + 1) mean luminance by class. m2: (tiles,) sum of the squared deviations of the
    batches' totals; m2_coarse: the same of the means of blocks of tiles, level by level (`blocks_of`). sources: the
    lamps and what their light comes by, the most luminous first.
    """

    width: int
    height: int
    columns: int
    rows: int
    batches: int
    spectrum: Array
    m2: Array
    sources: tuple[Source, ...] = ()
    m2_coarse: Array = field(default_factory=lambda: np.zeros(0))
    _sure: Array = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Takes the standard errors off: what is left was found in any case. Where single tiles are noise and blocks of
        them are not, as in a view into a small part of what is lit, what the tiles lack is spread over their block."""
        tiles = self.spectrum.sum(axis=1)
        sure = self.spectrum * self._share_left(tiles, self.m2)[:, None]
        for level, blocks in enumerate(blocks_of(self.columns, self.rows) if len(self.m2_coarse) else ()):
            n = np.bincount(blocks)[:, None]
            mean = _by_block(self.spectrum, blocks) / n
            total = mean.sum(axis=1)
            known = total * self._share_left(total, self._of_level(level))
            had = _by_block(sure, blocks).sum(axis=1) / n[:, 0]
            left = np.where(had < NOISE * known, known - had, 0.0)
            lacking = np.divide(left, total, out=np.zeros_like(total), where=total > 0)
            least = np.minimum(tiles, NOISE * known[blocks])  # of what lies in a tile, noisy as it may be
            share = np.divide(least, tiles, out=np.zeros_like(tiles), where=tiles > 0)
            sure = np.maximum(sure + (mean * lacking[:, None])[blocks], self.spectrum * share[:, None])
        object.__setattr__(self, "_sure", sure)

    def _share_left(self, total: Array, m2: Array) -> Array:
        error = np.sqrt(m2 / max(self.batches - 1, 1) / max(self.batches, 1))
        return np.divide(np.maximum(total - SURE * error, 0.0), total, out=np.zeros_like(total), where=total > 0)

    def _of_level(self, level: int) -> Array:
        sizes = [int(blocks.max()) + 1 for blocks in blocks_of(self.columns, self.rows)]
        return self.m2_coarse[sum(sizes[:level]) :][: sizes[level]]

    @property
    def is_empty(self) -> bool:
        """Whether nothing was found."""
        return not self._sure.any()

    def found(self) -> Array:
        """(tiles,) mean luminance of all light that was audited, less its standard errors."""
        return self._sure.sum(axis=1)

    def finds(self, samples: Array) -> Array:
        """(tiles, CLASSES + 1) finds to be expected in a pixel of each tile after so many samples (tiles,)."""
        return samples[:, None] * self._sure / worths()

    def rare(self, rate: float) -> Array:
        """(tiles,) mean luminance, standard errors and all, of the brightest light that fewer than `rate` finds per
        sample bring."""
        from_the_largest = np.cumsum((self.spectrum / worths())[:, ::-1], axis=1)[:, ::-1]
        return np.where(from_the_largest < rate, self.spectrum, 0.0).sum(axis=1)

    def missing(self, samples: Array) -> Array:
        """(tiles,) mean luminance that comes in finds of which a pixel had too few to tell."""
        from_the_largest = np.cumsum(self.finds(samples)[:, ::-1], axis=1)[:, ::-1]
        return np.where(from_the_largest < ENOUGH, self._sure, 0.0).sum(axis=1)

    def never(self) -> Array:
        """(tiles,) mean luminance that no sample can meet."""
        return self._sure[:, -1]

    def variance(self, samples: Array) -> Array:
        """(tiles,) variance of a pixel's mean after so many samples, by light that can be met at all."""
        return self._variance(samples, np.ones(CLASSES))

    def most_variance(self, samples: Array) -> Array:
        """(tiles,) the same as far as this very picture may hold finds: without the brightest light of which it holds
        none, and with as many of the others as it has at most, both in 19 of 20 pictures. One find of what few pictures
        hold makes more than is to be expected of all of them."""
        finds = (self.finds(samples) * self.pixels_per_tile()[:, None]).sum(axis=0)[:-1]
        so_bright = np.cumsum(finds[::-1])[::-1]
        most = np.maximum(so_bright + ONE_SIDED * np.sqrt(so_bright), 1.0)
        factor = np.divide(most, so_bright, out=np.zeros_like(most), where=so_bright >= UNLIKELY)
        factor[so_bright >= MANY] = 1.0
        return self._variance(samples, factor)

    def _variance(self, samples: Array, factor: Array) -> Array:
        return (self._sure[:, :-1] * worths()[:-1] * factor).sum(axis=1) / np.maximum(samples, 1.0)

    # ------------------------------ Tiles and pixels ------------------------------

    def by_tile(self, values: NDArray) -> Array:
        """(tiles,) means over the pixels of each tile of (n,) values."""
        rows, columns = self._edges()
        image = np.asarray(values, np.float64).reshape(self.height, self.width)
        summed = np.add.reduceat(np.add.reduceat(image, rows[:-1], axis=0), columns[:-1], axis=1)
        return summed.ravel() / self.pixels_per_tile()

    def pixels_per_tile(self) -> Array:
        """(tiles,) how many pixels each has."""
        rows, columns = self._edges()
        return np.outer(np.diff(rows), np.diff(columns)).ravel().astype(np.float64)

    def by_pixel(self, values: NDArray) -> NDArray:
        """(n,) the value of its tile for each pixel."""
        rows, columns = self._edges()
        tiled = values.reshape(self.rows, self.columns)
        return np.repeat(np.repeat(tiled, np.diff(rows), axis=0), np.diff(columns), axis=1).ravel()

    def _edges(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        return edges(self.height, self.rows), edges(self.width, self.columns)

    # ------------------------------ Merging and files ------------------------------

    def merge(self, other: Audit) -> Audit:
        """The audit of both sets of batches, which must be independent."""
        n = self.batches + other.batches
        share = other.batches / n
        delta = other.spectrum.sum(axis=1) - self.spectrum.sum(axis=1)
        return replace(
            self,
            batches=n,
            spectrum=self.spectrum + share * (other.spectrum - self.spectrum),
            m2=self.m2 + other.m2 + delta**2 * self.batches * share,
            m2_coarse=self.m2_coarse
            + other.m2_coarse
            + coarse(delta, self.columns, self.rows)[: len(self.m2_coarse)] ** 2 * self.batches * share,
            sources=_merged(self.sources, other.sources, share),
        )

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for files."""
        used = np.flatnonzero(self.spectrum.any(axis=0))
        return {
            **{k: getattr(self, k) for k in ("width", "height", "columns", "rows", "batches")},
            "classes": used.tolist(),
            "spectrum": _packed(self.spectrum[:, used]),
            "m2": _packed(self.m2),
            "m2_coarse": _packed(self.m2_coarse),
            "sources": [[s.light, s.via, s.energy, s.finds] for s in self.sources],
        }

    @staticmethod
    def from_dict(values: dict[str, Any]) -> Audit:
        """Reads back what `as_dict` gave, bit for bit."""
        tiles = values["columns"] * values["rows"]
        spectrum = np.zeros((tiles, CLASSES + 1))
        spectrum[:, values["classes"]] = _unpacked(values["spectrum"]).reshape(tiles, -1)
        kept = {k: values[k] for k in ("width", "height", "columns", "rows", "batches")}
        sources = tuple(Source(*s) for s in values["sources"])
        m2, m2_coarse = _unpacked(values["m2"]), _unpacked(values["m2_coarse"])
        return Audit(**kept, spectrum=spectrum, m2=m2, sources=sources, m2_coarse=m2_coarse)


def edges(length: int, parts: int) -> NDArray[np.int64]:
    """(parts + 1,) where `parts` even parts of so many pixels begin and end."""
    return np.arange(parts + 1) * length // parts


def blocks_of(columns: int, rows: int) -> tuple[NDArray[np.int64], ...]:
    """For each level, from fine to all of the image, (tiles,) the block that each tile lies in."""
    levels = []
    side = BLOCK
    while side < BLOCK * max(columns, rows):
        across = -(-columns // side)
        block = (np.arange(rows) // side)[:, None] * across + np.arange(columns) // side
        levels.append(block.ravel())
        side *= BLOCK
    return tuple(levels)


def coarse(tiles: Array, columns: int, rows: int) -> Array:
    """The means of (tiles,) values over the blocks of each level, level by level."""
    levels = blocks_of(columns, rows)
    means = [np.bincount(blocks, tiles) / np.bincount(blocks) for blocks in levels]
    return np.concatenate(means) if means else np.zeros(0)


def _by_block(values: Array, blocks: NDArray[np.int64]) -> Array:
    """Sums of the rows of each block."""
    summed = np.zeros((int(blocks.max()) + 1, values.shape[1]))
    np.add.at(summed, blocks, values)
    return summed


def _merged(a: tuple[Source, ...], b: tuple[Source, ...], share: float) -> tuple[Source, ...]:
    sums: dict[tuple[str, str], tuple[float, float]] = {}
    for sources, weight in ((a, 1 - share), (b, share)):
        for s in sources:
            energy, finds = sums.get((s.light, s.via), (0.0, 0.0))
            sums[s.light, s.via] = energy + weight * s.energy, finds + weight * s.finds
    found = (Source(*names, *numbers) for names, numbers in sums.items())
    return tuple(sorted(found, key=lambda s: (-s.energy, s.light, s.via)))


def _packed(array: Array) -> str:
    return base64.b64encode(zlib.compress(np.ascontiguousarray(array, "<f8").tobytes())).decode()


def _unpacked(text: str) -> Array:
    return np.frombuffer(zlib.decompress(base64.b64decode(text)), "<f8").astype(np.float64)


def sentences(audit: Audit, image_mean: float, samples: float) -> tuple[str, ...]:
    """What to say of light that this many samples per pixel hardly meet; nothing where it hardly matters."""
    said = []
    notable = LEAST_TOLD * max(image_mean, float(audit.spectrum.sum(axis=1).mean()))
    hidden = [s for s in audit.sources if s.energy >= notable and s.finds < RARE and samples * s.finds < ENOUGH]
    for s in hidden[:MOST_TOLD]:
        way = f" arrives through {s.via}" if s.via else " is met by chance alone"
        if s.finds <= 0:
            said.append(f"light from {s.light}{way} and is met by no sample; it is missing in the picture")
        else:
            said.append(
                f"light from {s.light}{way} and is met by one sample in {_round(1 / s.finds):,}; "
                "expect fireflies or a caustic layer"
            )
    if (more := len(hidden) - MOST_TOLD) > 0:
        said.append(f"{more} more lights are met as seldom")
    return tuple(said)


def _round(x: float) -> int:
    """Two digits say all that is known."""
    digits = max(0, math.floor(math.log10(max(x, 1.0))) - 1)
    return round(x / 10**digits) * 10**digits
