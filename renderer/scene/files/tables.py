"""Tables of numbers that scenes name: spectra, curves, measured materials, ellipsoids; looked through before Mitsuba.

Enters: a file. Leaves: nothing, or SceneError that says which line or field is wrong. Mitsuba believes their headers,
copies what they hold into its messages, and takes numbers that are none.
Formats: Mitsuba's text spectra (.spd) and curves, its tensor files (.bsdf), PLY with ellipsoids.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from renderer.errors import SceneError
from renderer.scene.files.mesh import ply_bytes

_SPECTRUM_BYTES = 4 << 20
_SHOWN = 40  # characters of a line that is not understood
_TENSOR_MAGIC = b"tensor_file\0"
_TENSOR_TYPES = ("", "u1", "i1", "<u2", "<i2", "<u4", "<i4", "<u8", "<i8", "<f2", "<f4", "<f8")  # by their numbers
_MOST_FIELDS, _MOST_DIMENSIONS = 1000, 16


def check_spectrum(path: Path) -> None:
    """Lines of a wavelength and a value, wavelengths increasing. Raises SceneError."""
    size = path.stat().st_size
    if size > _SPECTRUM_BYTES:
        raise SceneError(
            f"{path.name}: a spectrum of {size} bytes, and the limit is {_SPECTRUM_BYTES}; use fewer lines"
        )
    before, n = -math.inf, 0
    for line, words in _lines(path):
        wavelength, _ = _numbers(path, line, words, 2, "a wavelength and a value, as in 550 0.5")
        if wavelength <= before:
            raise SceneError(f"{path.name}:{line}: wavelength {wavelength:g} follows {before:g}; sort them, each once")
        before, n = wavelength, n + 1
    if n < 2:
        raise SceneError(f"{path.name}: a spectrum of {n} lines; it needs two at least, each a wavelength and a value")


def check_curves(path: Path, least: int) -> None:
    """Lines of x, y, z and radius; curves parted by empty lines. least: points of a curve. Raises SceneError."""
    before, length = 0, least  # of lines
    for line, words in _lines(path):
        if line > before + 1 or before == 0:
            _check_length(path, before, length, least)
            length = 0
        *_, radius = _numbers(path, line, words, 4, "x, y, z and radius")
        if radius < 0:
            raise SceneError(f"{path.name}:{line}: a radius of {radius:g}; write 0 or more")
        before, length = line, length + 1
    if before == 0:
        raise SceneError(f"{path.name}: no curve is in it; write lines of x, y, z and radius")
    _check_length(path, before, length, least)


def _check_length(path: Path, line: int, length: int, least: int) -> None:
    if length < least:
        raise SceneError(f"{path.name}:{line}: a curve of {length} points ends here; this kind needs {least} at least")


def _lines(path: Path) -> Iterator[tuple[int, list[bytes]]]:
    """Lines that say something: their number and words."""
    with path.open("rb") as file:
        for number, line in enumerate(file, 1):
            words = line.split()
            if words and not words[0].startswith(b"#"):
                yield number, words


def _numbers(path: Path, line: int, words: list[bytes], n: int, what: str) -> list[float]:
    try:
        found = [float(word) for word in words[:n]]
    except ValueError:
        found = []
    if len(found) < n or not all(map(math.isfinite, found)):
        shown = b" ".join(words)[:_SHOWN].decode("ascii", "replace")
        raise SceneError(f"{path.name}:{line}: {shown!r} is not {what}; write finite numbers as plain text")
    return found


def check_tensors(path: Path) -> None:
    """Fields of a tensor file lie within it and hold finite numbers. Raises SceneError."""
    data = path.read_bytes()
    try:
        _check_tensors(data)
    except (ValueError, struct.error, UnicodeDecodeError, OverflowError) as error:
        raise SceneError(f"{path.name}: damaged tensor file ({str(error)[:120]}); export it again") from None


def _check_tensors(data: bytes) -> None:
    if data[: len(_TENSOR_MAGIC)] != _TENSOR_MAGIC:
        raise ValueError("it does not begin as one")
    major, minor, n_fields = struct.unpack_from("<BBI", data, len(_TENSOR_MAGIC))
    if (major, minor) != (1, 0) or n_fields > _MOST_FIELDS:
        raise ValueError(f"version {major}.{minor} with {n_fields} fields")
    at = len(_TENSOR_MAGIC) + 6
    for _ in range(n_fields):
        (length,) = struct.unpack_from("<H", data, at)
        name = data[at + 2 : at + 2 + length].decode()
        n_dimensions, kind, offset = struct.unpack_from("<HBQ", data, at + 2 + length)
        at += 13 + length
        if n_dimensions > _MOST_DIMENSIONS or not 0 < kind < len(_TENSOR_TYPES):
            raise ValueError(f"field {name[:40]!r} has {n_dimensions} dimensions of the type {kind}")
        shape = struct.unpack_from(f"<{n_dimensions}Q", data, at)
        at += 8 * n_dimensions
        dtype = np.dtype(_TENSOR_TYPES[kind])
        count = math.prod(shape)
        if offset + count * dtype.itemsize > len(data):
            raise ValueError(f"field {name[:40]!r} promises {count} values, more than the file holds")
        if dtype.kind == "f" and not np.isfinite(np.frombuffer(data, dtype, count, offset)).all():
            raise ValueError(f"field {name[:40]!r} has values that are not finite")


def check_ellipsoids(path: Path) -> None:
    """The elements of a PLY file are all within it. Raises SceneError."""
    data = path.read_bytes()
    try:
        wanted = ply_bytes(data)
    except ValueError as error:
        raise SceneError(f"{path.name}: damaged ply file ({str(error)[:120]}); export it again") from None
    if wanted > len(data):
        raise SceneError(
            f"{path.name}: damaged ply file, its header promises {wanted} bytes of {len(data)}; export it again"
        )
