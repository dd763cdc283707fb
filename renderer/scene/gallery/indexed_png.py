"""Small PNG files: an image of 256 fitted colours (median cut, then Lloyd's iteration; Heckbert 1982).

Enters: (H, W, 3) uint8 sRGB. Leaves: the bytes of an 8-bit indexed PNG, a third to a half of the true-colour size.
"""

from __future__ import annotations

import struct
import zlib
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

Pixels: TypeAlias = npt.NDArray[np.uint8]
N_COLOURS = 256
LLOYD_STEPS = 8
_CHUNK = 8192  # pixels compared with the palette at a time: 8 MiB of distances


def encode(image: Pixels) -> bytes:
    """The PNG file of an image; image: (H, W, 3) uint8."""
    height, width, _ = image.shape
    colours = image.reshape(-1, 3).astype(np.float32)
    palette = _median_cut(colours)
    for _ in range(LLOYD_STEPS):
        palette = _centres(colours, _nearest(colours, palette), palette)
    palette = np.rint(palette)
    rows = _nearest(colours, palette).astype(np.uint8).reshape(height, width)
    # Filter 0 on every row: prediction does not pay on palette indices.
    scanlines = np.concatenate([np.zeros((height, 1), np.uint8), rows], axis=1).tobytes()
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        [
            _chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 3, 0, 0, 0)),
            _chunk(b"sRGB", b"\x00"),
            _chunk(b"PLTE", palette.astype(np.uint8).tobytes()),
            _chunk(b"IDAT", zlib.compress(scanlines, 9)),
            _chunk(b"IEND", b""),
        ]
    )


def _chunk(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


def _median_cut(colours: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Split the set of colours with the largest spread at its median until there are enough sets; (n, 3) means."""
    boxes = [colours]
    while len(boxes) < N_COLOURS:
        widest = max(range(len(boxes)), key=lambda i: float(boxes[i].var(axis=0).max()) * len(boxes[i]))
        box = boxes[widest]
        channel = int(box.var(axis=0).argmax())
        below = box[:, channel] <= np.median(box[:, channel])
        if below.all():
            below = box[:, channel] < np.median(box[:, channel])
        if not below.any():
            break  # one colour only: nothing left to split
        boxes[widest : widest + 1] = [box[below], box[~below]]
    return np.stack([box.mean(axis=0) for box in boxes])


def _nearest(colours: npt.NDArray[np.float32], palette: npt.NDArray[np.float32]) -> npt.NDArray[np.intp]:
    """Index of the palette entry nearest to each colour."""
    length2 = (palette**2).sum(axis=1)
    parts = [colours[i : i + _CHUNK] for i in range(0, len(colours), _CHUNK)]
    return np.concatenate([(length2 - 2.0 * (part @ palette.T)).argmin(axis=1) for part in parts])


def _centres(
    colours: npt.NDArray[np.float32], index: npt.NDArray[np.intp], palette: npt.NDArray[np.float32]
) -> npt.NDArray[np.float32]:
    """Mean of the colours assigned to each entry; entries without any stay."""
    count = np.bincount(index, minlength=len(palette))
    sums = np.stack([np.bincount(index, colours[:, c], minlength=len(palette)) for c in range(3)], axis=1)
    return np.where(count[:, None] > 0, sums / np.maximum(count, 1)[:, None], palette).astype(np.float32)
