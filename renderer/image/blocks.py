"""Replicates that wait for earlier ones, as further parts of a checkpoint: two for each block.

The first holds the pictures of its replicates, one below the other: `R G B` in float32, `Y` alone where the three are
the same, `S1.R` to `S3.B` where light is polarised, and `invalid` where samples were not finite. Nothing is lost, and
viewers open it. The second says of each pixel whether it is in the block (`held`), and its path segments, the two
32-bit halves of a whole number.
Both cover the smallest rectangle around the block's pixels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from renderer.errors import CheckpointError
from renderer.estimate.blocks import Block

COLOURED, GREY, INVALID = ("R", "G", "B"), ("Y",), ("invalid",)
STOKES = tuple(f"S{i}.{colour}" for i in (1, 2, 3) for colour in COLOURED)
COUNTS = ("held", "segments.low", "segments.high")


@dataclass(frozen=True, slots=True)
class Part:
    """A part of an EXR: how it is described, and its values (H, W, channels)."""

    spec: Any
    values: NDArray


def parts_of(blocks: Sequence[Block], width: int, height: int) -> list[Part]:
    """The parts to write. width, height: of the image."""
    return [part for i, block in enumerate(blocks) for part in _written(block, i, width, height)]


def _written(block: Block, i: int, width: int, height: int) -> tuple[Part, Part]:
    rows, columns = np.divmod(block.pixels, width)
    top, left = int(rows.min()), int(columns.min())
    rows, columns = rows - top, columns - left
    h, w = int(rows.max()) + 1, int(columns.max()) + 1
    bits = block.radiance.view(np.uint32)
    is_grey = bits.shape[-1] == 3 and bool((bits == bits[..., :1]).all())
    colours = GREY if is_grey else COLOURED + STOKES[: bits.shape[-1] - 3]
    names = colours + (INVALID if block.invalid.any() else ())
    pictures = np.zeros((len(block.radiance), h, w, len(names)), np.float32)
    n_colours = len(colours)
    pictures[:, rows, columns, :n_colours] = block.radiance[..., :n_colours]
    if block.invalid.any():
        pictures[:, rows, columns, n_colours] = block.invalid
    counts = np.zeros((h, w, len(COUNTS)), np.uint32)
    counts[rows, columns, 0] = 1
    counts[rows, columns, 1:] = block.segments.astype("<i8").view("<u4").reshape(-1, 2)

    def spec(name: str, values: NDArray, channels: tuple[str, ...], kind: str) -> Any:
        made = oiio.ImageSpec(values.shape[1], values.shape[0], len(channels), kind)
        made.x, made.y = left, top
        made.full_x, made.full_y, made.full_width, made.full_height = 0, 0, width, height  # one for all parts
        made.channelnames = channels
        made.attribute("oiio:subimagename", f"{name} {i}")
        made.attribute("compression", "zip")
        made.attribute("fredholm:first", block.first)
        made.attribute("fredholm:replicates", len(block.radiance))
        return made

    flat = pictures.reshape(-1, w, len(names))
    return (
        Part(spec("replicates", flat, names, "float"), flat),
        Part(spec("pixels", counts, COUNTS, "uint"), counts),
    )


def read_blocks(source: Any, n_blocks: int, first_part: int, width: int) -> tuple[Block, ...]:
    """Reads them back, from the part `first_part` on. Raises CheckpointError where one is damaged."""
    return tuple(_read(source, first_part + 2 * i, width) for i in range(n_blocks))


def _read(source: Any, part: int, width: int) -> Block:
    pictures, spec = _values(source, part, "float")
    counts, _ = _values(source, part + 1, "uint")
    first, n = (int(spec.getattribute(f"fredholm:{key}")) for key in ("first", "replicates"))
    h, w = counts["held"].shape
    inside = counts["held"] > 0
    rows, columns = np.nonzero(inside)

    def stacked(name: str) -> NDArray[np.float32]:
        return pictures[name].reshape(n, h, w)[:, inside]

    names = COLOURED + tuple(name for name in STOKES if name in pictures) if COLOURED[0] in pictures else GREY * 3
    halves = np.stack([counts[name][inside] for name in COUNTS[1:]], axis=-1)
    return Block(
        first=first,
        pixels=(rows + spec.y) * width + columns + spec.x,
        radiance=np.stack([stacked(name) for name in names], axis=-1),
        invalid=stacked("invalid").astype(np.uint8) if "invalid" in pictures else np.zeros((n, len(rows)), np.uint8),
        segments=np.ascontiguousarray(halves, "<u4").view("<i8").reshape(-1),
    )


def _values(source: Any, part: int, kind: str) -> tuple[dict[str, NDArray], Any]:
    """Channels of a part by name, (H, W) each, and its spec."""
    spec = source.spec(part)
    values = source.read_image(part, 0, 0, spec.nchannels, kind)
    if values is None or values.shape[-1] != spec.nchannels:
        raise CheckpointError(f"its replicates cannot be read ({source.geterror()})")
    return {name: values[..., i] for i, name in enumerate(spec.channelnames)}, spec
