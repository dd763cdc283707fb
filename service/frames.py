"""Display → bytes for the page: IEEE halves as byte planes, which compress far better than interleaved ones.

Layout, little endian: magic "FRD1", u32 length of the header, JSON header padded with spaces so that the
planes start at a multiple of 8, then all low bytes of R, of G, of B, of SE, then all high bytes. SE is the
standard error of luminance; +inf: fewer than two replicates, no error estimate yet. With maps=1 a fifth
channel follows SE in both halves: N, the pixel's replicates, not scaled, negative where it is not trusted.
"""

from __future__ import annotations

import asyncio
import gzip
import json
import math
import struct
from collections import OrderedDict
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from typing import Any, Literal

import numpy as np
import zstandard
from numpy.typing import NDArray

from service.display import Display
from service.messages import FrameHeader

MAGIC = b"FRD1"
MEDIA_TYPE = "application/x-fredholm-frame"
HALF_MAX = 65504.0
_SMALLEST_HALF = 2.0**-24
_MEDIAN_SAMPLES = 1 << 16
_PART = 1 << 15
_BAND = 64  # rows, an even number
_EXPONENT_LIMIT = 120  # the scale must stay a float32 on the graphics card
Encoding = Literal["zstd", "gzip", "identity"]


def encode_frame(display: Display, reduce: Literal[1, 2] = 1, *, has_maps: bool = False) -> bytes:
    """The uncompressed body of one frame; `has_maps` adds N."""
    planes = _planes(display, reduce)
    scale = scale_for(planes)
    halves, clamped = _to_half(planes, scale)
    if has_maps:
        halves = np.concatenate([halves, _replicate_map(display, reduce)[None]])
    height, width = halves.shape[1:]
    least, most, size = int(display.replicates.min()), int(display.replicates.max()), display.replicate_size
    header = FrameHeader(
        seq=display.seq,
        width=width,
        height=height,
        channels=["R", "G", "B", "SE", "N"] if has_maps else ["R", "G", "B", "SE"],
        spp_min=float(least * size),
        spp_max=float(most * size),
        spp_mean=float(display.replicates.mean() * size),
        replicates_min=least,
        replicates_max=most,
        replicate_size=size,
        seconds=display.seconds,
        scale=scale,
        reduce=reduce,
        layout="byteplanes-half",
        rounded=False,
        filled=least == 0,
        clamped=clamped,
    )
    text = json.dumps(header.model_dump()).encode()
    padded = text.ljust(-(-(8 + len(text)) // 8) * 8 - 8)
    low, high = halves.astype("<f2", copy=False).view(np.uint8).reshape(-1, 2).T
    return b"".join((MAGIC, struct.pack("<I", len(padded)), padded, low.tobytes(), high.tobytes()))


def _planes(display: Display, reduce: Literal[1, 2]) -> NDArray[np.float32]:
    """R, G, B, SE (4, H, W), of 2×2 pixels each where reduced. In bands: halving takes a hundred bytes a pixel."""
    planes = np.empty((4, -(-display.height // reduce), -(-display.width // reduce)), dtype=np.float32)
    for start in range(0, display.height, _BAND):
        rows = slice(start, min(start + _BAND, display.height))
        band = np.empty((4, rows.stop - start, display.width), dtype=np.float32)
        for channel in range(3):
            band[channel] = display.radiance[rows, :, channel]
        band[3] = display.standard_error[rows, :, 3]
        band[3][~np.isfinite(band[3])] = np.inf
        planes[:, start // reduce : -(-rows.stop // reduce)] = _halved(band) if reduce == 2 else band
    return planes


def scale_for(planes: NDArray[np.float32]) -> float:
    """A power of two that brings the largest value to the top of the halves: the most room below.

    Where one huge value would push the typical ones into the denormals, the typical ones win and the huge is
    clamped.
    """
    largest = 0.0
    for part in _parts(planes.ravel()):
        size = np.abs(part)
        largest = max(largest, float(size.max(initial=0.0, where=np.isfinite(size))))
    if largest == 0:
        return 1.0
    # 2^15 ≤ largest · 2^exponent·2 < 2^16
    exponent = 15 - math.frexp(largest)[1]
    some = np.abs(planes.ravel()[:: max(1, planes.size // _MEDIAN_SAMPLES)])
    some = some[np.isfinite(some) & (some > 0)]
    if some.size:
        exponent = max(exponent, -8 - math.frexp(float(np.median(some)))[1])
    return math.ldexp(1.0, max(-_EXPONENT_LIMIT, min(_EXPONENT_LIMIT, exponent)))


def _to_half(planes: NDArray[np.float32], scale: float) -> tuple[NDArray[np.float16], int]:
    """Halves of planes (4, H, W) · scale: finite stays finite, a positive error stays positive.

    And how many were clamped.
    """
    halves, clamped = np.empty(planes.shape, np.float16), 0
    with np.errstate(over="ignore", under="ignore"):
        for channel, plane in enumerate(planes):
            for part, half in zip(_parts(plane.ravel()), _parts(halves[channel].ravel()), strict=True):
                scaled = part * np.float32(scale)
                over = (np.abs(scaled) > HALF_MAX) & np.isfinite(part)
                if over.any():
                    clamped += int(np.count_nonzero(over))
                    scaled[over] = np.copysign(np.float32(HALF_MAX), part[over])
                if channel == 3:
                    # 0 ± 0 means "no estimate yet": rounding must not make it.
                    scaled[(part > 0) & (scaled < _SMALLEST_HALF)] = _SMALLEST_HALF
                half[:] = scaled
    return halves, clamped


def _parts(flat: NDArray[Any]) -> Iterator[NDArray[Any]]:
    """Views of a flat array that stay in the processor's cache while they are worked on."""
    for start in range(0, flat.size, _PART):
        yield flat[start : start + _PART]


def _replicate_map(display: Display, reduce: Literal[1, 2]) -> NDArray[np.float16]:
    """N (H, W): replicates, negative where not trusted. Of 2×2 pixels: the fewest, trusted only if all are."""
    count = np.minimum(display.replicates, HALF_MAX).astype(np.float32)
    signed = np.where(display.trusted, count, -count)
    if reduce == 2:
        height, width = signed.shape
        padded = np.pad(signed, ((0, height % 2), (0, width % 2)), mode="edge")
        four = np.stack([padded[0::2, 0::2], padded[1::2, 0::2], padded[0::2, 1::2], padded[1::2, 1::2]])
        signed = np.copysign(np.abs(four).min(axis=0), np.where(np.signbit(four).any(axis=0), -1.0, 1.0))
    return signed.astype(np.float16)


def _halved(planes: NDArray[np.float32]) -> NDArray[np.float32]:
    """Mean of 2×2 pixels of planes (4, H, W); the standard error of a mean of n independent pixels is √ΣSE²/n.

    Odd edges: of 1 or 2.
    """
    height, width = planes.shape[1:]
    even = ((0, height % 2), (0, width % 2))
    total = planes.astype(np.float64)
    total[3] **= 2
    total = np.pad(total, ((0, 0), *even))
    n = np.pad(np.ones((height, width)), even)
    total = total[:, 0::2, 0::2] + total[:, 1::2, 0::2] + total[:, 0::2, 1::2] + total[:, 1::2, 1::2]
    n = n[0::2, 0::2] + n[1::2, 0::2] + n[0::2, 1::2] + n[1::2, 1::2]
    total[3] = np.sqrt(total[3])
    return (total / n).astype(np.float32)


def choose_encoding(accept: str) -> Encoding:
    """The best encoding that an Accept-Encoding header allows."""
    quality: dict[str, float] = {}
    for part in accept.lower().split(","):
        name, _, parameter = part.strip().partition(";")
        try:
            quality[name.strip()] = float(parameter.strip().removeprefix("q=")) if parameter else 1.0
        except ValueError:
            quality[name.strip()] = 0.0
    for encoding in ("zstd", "gzip"):
        if quality.get(encoding, 0.0) > 0:
            return encoding
    return "identity"


def compress(body: bytes, encoding: Encoding) -> bytes:
    """The body in an encoding, at its fastest level."""
    if encoding == "zstd":
        return zstandard.ZstdCompressor(level=1).compress(body)
    return gzip.compress(body, compresslevel=1, mtime=0) if encoding == "gzip" else body


class FrameCache:
    """The newest body of each key, at most `limit_bytes` of them. For use from one event loop."""

    def __init__(self, limit_bytes: int = 128 << 20) -> None:
        self._limit_bytes = limit_bytes
        self._bodies: OrderedDict[tuple[object, ...], tuple[int, bytes]] = OrderedDict()
        self._bytes = 0
        self._making: dict[tuple[object, ...], tuple[asyncio.Lock, int]] = {}

    @asynccontextmanager
    async def making(self, key: tuple[object, ...]) -> AsyncIterator[None]:
        """Lets one caller at a time look for a body and make it; the others find it made."""
        lock, users = self._making.get(key, (asyncio.Lock(), 0))
        self._making[key] = (lock, users + 1)
        try:
            async with lock:
                yield
        finally:
            lock, users = self._making[key]
            if users == 1:
                del self._making[key]
            else:
                self._making[key] = (lock, users - 1)

    def get(self, key: tuple[object, ...], seq: int = 0) -> bytes | None:
        """The body of a frame, or None."""
        kept = self._bodies.get(key)
        if kept is None or kept[0] != seq:
            return None
        self._bodies.move_to_end(key)
        return kept[1]

    def put(self, key: tuple[object, ...], body: bytes, seq: int = 0) -> None:
        """Keep a body in place of an older frame's, for which nobody asks any more; the least used ones make room."""
        kept = self._bodies.get(key)
        if kept is not None and kept[0] > seq:
            return
        self._bytes += len(body) - (len(kept[1]) if kept is not None else 0)
        self._bodies[key] = seq, body
        self._bodies.move_to_end(key)
        while self._bytes > self._limit_bytes and len(self._bodies) > 1:
            self._bytes -= len(self._bodies.popitem(last=False)[1][1])
