"""Replicates that wait for those before them: what makes parts of a render merge to the bits of a straight one.

Moments depend, in their last bits, on the order in which replicates are added, and a straight render adds them one by
one in index order. A part of it that does not begin at replicate 0 therefore keeps its replicates as they are, float32
radiance, and no moments: they are added when all before them are there, in whatever order parts are merged.

Enters: moments of the replicates from 0 on, and blocks of later ones, of any pixels. Leaves: the same, joined as far as
they follow each other; what overlaps is refused, what is missing is said.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from renderer.errors import MergeError
from renderer.estimate.moments import Moments


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """Replicates first … first + n − 1 of k pixels, one by one.

    pixels: (k,) ascending. radiance: (n, k, 3) float32 replicate means. invalid: (n, k) uint8 samples of each that were
    not finite. segments: (k,) int64 path segments of all n.
    """

    first: int
    pixels: NDArray[np.int64]
    radiance: NDArray[np.float32]
    invalid: NDArray[np.uint8]
    segments: NDArray[np.int64]

    @property
    def end(self) -> int:
        """The replicate after the last one."""
        return self.first + len(self.radiance)

    def of(self, chosen: NDArray[np.bool_]) -> Block:
        """The same replicates of some of its pixels."""
        if chosen.all():
            return self
        some = self.radiance[:, chosen], self.invalid[:, chosen], self.segments[chosen]
        return Block(self.first, self.pixels[chosen], *some)

    def added_to(self, moments: Moments, replicate_size: int) -> None:
        """Adds its replicates, in order."""
        moments.add_block(self.pixels, self.radiance, self.invalid, replicate_size, self.segments)


@dataclass(frozen=True, slots=True, eq=False)
class Held:
    """head: moments of the replicates of each pixel that follow each other from 0 on. waiting: blocks of later ones,
    by their first replicate; no two hold the same replicate of a pixel.
    """

    head: Moments
    waiting: tuple[Block, ...] = ()
    missing: tuple[tuple[int, int], ...] = field(init=False)  # ranges that some pixel waits for: (first, end)

    def __post_init__(self) -> None:
        gaps: set[tuple[int, int]] = set()
        reached = self.head.tried.copy()
        for block in self.waiting:
            gaps |= {(int(r), block.first) for r in np.unique(reached[block.pixels]) if r < block.first}
            reached[block.pixels] = block.end
        object.__setattr__(self, "missing", _union(gaps))

    @property
    def first(self) -> int:
        """The first replicate that any pixel has."""
        return self.waiting[0].first if self.waiting and not self.head.tried.any() else 0

    @property
    def said_missing(self) -> str:
        """The ranges that are missing, as they are written."""
        return " and ".join(f"{first}:{end}" for first, end in self.missing)

    def moments(self, replicate_size: int) -> Moments:
        """Of all replicates, waiting ones included: right as numbers, but not the bits of a straight render."""
        if not self.waiting:
            return self.head
        total = self.head.copy()
        for block in self.waiting:
            block.added_to(total, replicate_size)
        return total


def join(a: Held, b: Held, replicate_size: int) -> Held:
    """What both hold. Raises MergeError where a replicate of a pixel is in both."""
    head = _heads(a.head, b.head)
    blocks = sorted((*a.waiting, *b.waiting), key=lambda block: (block.first, block.end, int(block.pixels[0])))
    reached = head.tried.copy()
    for block in blocks:
        if (taken := reached[block.pixels] > block.first).any():
            end = min(block.end, int(reached[block.pixels[taken]].max()))
            raise MergeError(_overlap(block.first, end, int(taken.sum())))
        reached[block.pixels] = block.end
    waiting = []
    for block in blocks:
        is_next = head.tried[block.pixels] == block.first
        if is_next.any():
            block.of(is_next).added_to(head, replicate_size)
        if not is_next.all():
            waiting.append(block.of(~is_next))
    return Held(head, tuple(waiting))


def _heads(a: Moments, b: Moments) -> Moments:
    """Moments of pixels that only one of both has."""
    filled = np.flatnonzero(b.tried)
    if (taken := a.tried[filled] > 0).any():
        pixels = filled[taken]
        end = int(np.minimum(a.tried[pixels], b.tried[pixels]).max())
        raise MergeError(_overlap(0, end, len(pixels)))
    if not len(filled):
        return a.copy()
    head = b.copy()
    own = np.flatnonzero(a.tried)
    head.put(own, a.at(own))
    return head


def _overlap(first: int, end: int, n_pixels: int) -> str:
    return f"both hold replicates {first}:{end} of {n_pixels} pixels"


def _union(ranges: Iterable[tuple[int, int]]) -> tuple[tuple[int, int], ...]:
    """Ranges of numbers that are in any, ascending."""
    found: list[tuple[int, int]] = []
    for first, end in sorted(ranges):
        if found and first <= found[-1][1]:
            found[-1] = found[-1][0], max(found[-1][1], end)
        else:
            found.append((first, end))
    return tuple(found)
