"""Mesh files: triangles, vertices and bounds, without building anything.

Enters: a .ply, .obj or .serialized file. Leaves: `MeshFacts`. A header that promises more than the file can hold is
refused: believing it would take the memory first and find out later.
Formats: Turk 1994 (PLY), Wavefront OBJ, Mitsuba's own serialized format.
"""

from __future__ import annotations

import re
import struct
import zlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderer.errors import SceneError

_PLY_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
_MAX_HEADER = 1 << 16
_SAMPLED_FROM = 1 << 17  # bytes of text
_SAMPLED_LINES = 512
_SERIALIZED_MAGIC = 0x041C
_DOUBLES = 0x2000
_INFLATE_RATIO = 1032  # the most that zlib can pack


@dataclass(frozen=True, slots=True)
class MeshFacts:
    """triangles, vertices: numbers of them. low, high: corners of the bounds in the file's coordinates, or None."""

    triangles: int
    vertices: int
    low: tuple[float, float, float] | None = None
    high: tuple[float, float, float] | None = None


def read_mesh(path: Path, kind: str, shape_index: int = 0, *, exact: bool = True) -> MeshFacts:
    """Facts of a mesh file. kind: ply, obj or serialized. exact: read all of a long OBJ file, not a part of it.

    Raises SceneError if the file is damaged.
    """
    try:
        if kind == "ply":
            return _read_ply(path)
        if kind == "obj":
            return _read_obj(path, exact)
        return _read_serialized(path, shape_index)
    except (ValueError, IndexError, KeyError, OverflowError, struct.error, zlib.error, UnicodeDecodeError) as error:
        raise SceneError(f"{path.name}: damaged {kind} file ({str(error)[:120]}); export it again") from None


def _facts(triangles: int, positions: NDArray[Any]) -> MeshFacts:
    if len(positions) == 0:
        return MeshFacts(triangles, 0)
    if positions.ndim != 2 or positions.shape[1] != 3:
        raise ValueError("a vertex is not three numbers")
    low, high = positions.min(axis=0), positions.max(axis=0)
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        raise ValueError("some vertices are not finite")
    as_floats = [tuple(float(x) for x in corner) for corner in (low, high)]
    return MeshFacts(triangles, len(positions), as_floats[0], as_floats[1])  # type: ignore[arg-type]


# ------------------------------ PLY ------------------------------


def _read_ply(path: Path) -> MeshFacts:
    data = memoryview(path.read_bytes())
    start = bytes(data[:_MAX_HEADER])
    end = re.search(rb"end_header\r?\n", start)
    if not start.startswith(b"ply") or end is None:
        raise ValueError("no PLY header")
    text = start[: end.start()].decode("ascii")
    encoding, elements = _ply_header(text)
    counts = {name: count for name, count, _ in elements}
    if next((name for name, _, _ in elements), "") != "vertex":
        raise ValueError("vertices must come first")
    _, n, columns = elements[0]
    names = [name for name, _ in columns]
    if n == 0:
        return MeshFacts(counts.get("face", 0), 0)
    where = [names.index(axis) for axis in "xyz"]
    body = data[end.end() :]
    if encoding == "ascii":
        positions = _ascii_rows(bytes(body), n, len(names))[:, where]
    else:
        order = {"binary_little_endian": "<", "binary_big_endian": ">"}[encoding]
        row = np.dtype([(f"{i}", order + _PLY_TYPES[kind]) for i, (_, kind) in enumerate(columns)])
        if n * row.itemsize + counts.get("face", 0) > len(body):
            raise ValueError(f"the header promises {n} vertices, more than the file holds")
        rows = np.frombuffer(body, row, n)
        positions = np.stack([rows[f"{i}"] for i in where], axis=1).astype(np.float64)
        _check_faces(body[n * row.itemsize :], text, counts.get("face", 0), n, order)
    return _facts(counts.get("face", 0), positions)


def _check_faces(body: memoryview, header: str, n_faces: int, n_vertices: int, order: str) -> None:
    """Refuses triangles of vertices that are not there: Mitsuba reads beyond its memory for them.

    Looked at in the usual layout, faces of three indices and nothing else behind the vertices.
    """
    lists = re.findall(r"property list (\w+) (\w+) \w+\s*$", header, re.MULTILINE)
    if len(lists) != 1 or header.count("element") != 2 or n_faces == 0:
        return
    count, index = (_PLY_TYPES[kind] for kind in lists[0])
    face = np.dtype([("n", order + count), ("v", order + index, 3)])
    if n_faces * face.itemsize > len(body):
        raise ValueError(f"the header promises {n_faces} faces, more than the file holds")
    faces = np.frombuffer(body, face, n_faces)
    if (faces["n"] == 3).all() and (faces["v"].max() >= n_vertices or faces["v"].min() < 0):
        raise ValueError(f"a face names vertex {faces['v'].max()} of {n_vertices}")


def _ply_header(text: str) -> tuple[str, list[tuple[str, int, list[tuple[str, str]]]]]:
    """Encoding, and name, count and scalar columns of each element."""
    encoding = ""
    elements: list[tuple[str, int, list[tuple[str, str]]]] = []
    for line in text.splitlines():
        words = line.split()
        match words:
            case ["format", kind, _]:
                encoding = kind
            case ["element", name, count]:
                if not 0 <= int(count) < 2**32:
                    raise ValueError(f"{count} of {name}")
                elements.append((name, int(count), []))
            case ["property", "list", *_]:
                if elements and elements[-1][0] == "vertex":
                    raise ValueError("a list among the vertices")
            case ["property", kind, name]:
                elements[-1][2].append((name, kind))
    if encoding not in ("ascii", "binary_little_endian", "binary_big_endian"):
        raise ValueError(f"unknown encoding {encoding!r}")
    return encoding, elements


def _ascii_rows(body: bytes, n: int, n_columns: int) -> NDArray[np.float64]:
    if 2 * n * n_columns > len(body) + 1:
        raise ValueError(f"the header promises {n} vertices, more than the file holds")
    words = body.split(None, n * n_columns)[: n * n_columns]
    if len(words) < n * n_columns:
        raise ValueError(f"the header promises {n} vertices, more than the file holds")
    return np.array(words, dtype=np.float64).reshape(n, n_columns)


# ------------------------------ OBJ ------------------------------


def _read_obj(path: Path, exact: bool) -> MeshFacts:
    data = b"\n" + path.read_bytes().replace(b"\t", b" ")
    if exact or len(data) < _SAMPLED_FROM:
        lines = data.split(b"\n")
        vertices = [line[2:] for line in lines if line[:2] == b"v "]
        triangles = sum(_triangles_of(line) for line in lines if line[:2] == b"f ")
        count = len(vertices)
    else:
        # Text is slow to read: the size of a scene is known well enough from some thousand vertices.
        vertices = _some_lines(data, b"\nv ")
        faces = _some_lines(data, b"\nf ")
        mean = sum(map(_triangles_of, (b"f " + face for face in faces))) / max(1, len(faces))
        triangles, count = round(data.count(b"\nf ") * mean), data.count(b"\nv ")
    if not vertices:
        return MeshFacts(triangles, 0)
    facts = _facts(triangles, np.array([line.split()[:3] for line in vertices], dtype=np.float64))
    return replace(facts, vertices=count)


def _triangles_of(face: bytes) -> int:
    """A polygon of n corners is n − 2 triangles."""
    return max(0, len(face.split()) - 3)


def _some_lines(data: bytes, start: bytes) -> list[bytes]:
    """What follows `start` on lines all over a file, at places that depend on its length alone."""
    found = []
    at = -1
    step = max(1, len(data) // _SAMPLED_LINES)
    while (at := data.find(start, at + 1)) >= 0:
        end = data.find(b"\n", at + 1)
        found.append(data[at + len(start) : end if end >= 0 else len(data)])
        at += step
    return found


# ------------------------------ Serialized ------------------------------


def _read_serialized(path: Path, shape_index: int) -> MeshFacts:
    data = path.read_bytes()
    magic, version = struct.unpack_from("<HH", data, 0)
    if magic != _SERIALIZED_MAGIC or version not in (3, 4):
        raise ValueError("no serialized mesh")
    (count,) = struct.unpack_from("<I", data, len(data) - 4)
    if not 0 <= shape_index < count:
        raise ValueError(f"shape_index is {shape_index}, and the file holds {count} meshes")
    width, kind = (8, "<Q") if version == 4 else (4, "<I")
    table = len(data) - 4 - width * count
    (start,) = struct.unpack_from(kind, data, table + width * shape_index)
    following = shape_index + 1
    end = struct.unpack_from(kind, data, table + width * following)[0] if following < count else table
    if not 0 <= start + 4 <= end <= len(data):
        raise ValueError("the table of meshes points outside the file")
    packed = data[start + 4 : end]
    inflate = zlib.decompressobj()
    head = inflate.decompress(packed, _MAX_HEADER)
    (flags,) = struct.unpack_from("<I", head, 0)
    at = head.index(b"\0", 4) + 1 if version == 4 else 4
    n, triangles = struct.unpack_from("<QQ", head, at)
    real = np.dtype("<f8" if flags & _DOUBLES else "<f4")
    wanted = 3 * n * real.itemsize
    if wanted + 12 * triangles > _INFLATE_RATIO * len(packed):
        raise ValueError(f"the header promises {n} vertices, more than the file holds")
    body = head[at + 16 :]
    body += inflate.decompress(inflate.unconsumed_tail, max(1, wanted - len(body))) if wanted > len(body) else b""
    if len(body) < wanted:
        raise ValueError("the file ends among the vertices")
    return _facts(triangles, np.frombuffer(body[:wanted], real).reshape(-1, 3).astype(np.float64))
