"""Mesh files: triangles, vertices and bounds, without building anything.

Enters: the bytes of a .ply, .obj or .serialized file. Leaves: `MeshFacts`. A header that promises more than the file
can hold is refused: believing it would take the memory first and find out later.
Formats: Turk 1994 (PLY), Wavefront OBJ, Mitsuba's own serialized format.
"""

from __future__ import annotations

import math
import re
import struct
import zlib
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderer.errors import SceneError

PLY_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
MAX_HEADER = 1 << 16
HEADER_END = re.compile(rb"\r?\n *end_header *\r?\n")  # a line of its own, not the end of a comment
_ENCODINGS = ("ascii", "binary_little_endian", "binary_big_endian")
_NAME = re.compile("[!-~]{1,200}")  # no space or control character
_CORNERS = ("i0", "i1", "i2")
_SAMPLED_FROM = 1 << 15  # bytes of text
_SAMPLED_LINES = 128
_SERIALIZED_MAGIC = 0x041C
_DOUBLES = 0x2000
_SERIALIZED_PARTS = {0x0001: 3, 0x0002: 2, 0x0008: 3}  # numbers of a vertex by flag: normal, texture, colour
_INFLATE_RATIO = 1032  # the most that zlib can pack


@dataclass(frozen=True, slots=True)
class MeshFacts:
    """triangles, vertices: numbers of them. low, high: corners of the bounds in the file's coordinates, or None."""

    triangles: int
    vertices: int
    low: tuple[float, float, float] | None = None
    high: tuple[float, float, float] | None = None


def read_mesh(data: bytes, name: str, kind: str, shape_index: int = 0, *, exact: bool = True) -> MeshFacts:
    """Facts of a mesh file. data, name: its content and what it is called. kind: ply, obj or serialized. exact: read
    all of a long OBJ file, not a part of it. Raises SceneError if the file is damaged.
    """
    try:
        if kind == "ply":
            return _read_ply(data)
        if kind == "obj":
            return _read_obj(data, exact)
        return _read_serialized(data, shape_index)
    except (ValueError, IndexError, KeyError, OverflowError, struct.error, zlib.error, UnicodeDecodeError) as error:
        raise SceneError(f"{name}: damaged {kind} file ({str(error)[:120]}); export it again") from None


def _facts(triangles: int, positions: NDArray[Any]) -> MeshFacts:
    """positions: (n, 3)."""
    if len(positions) == 0:
        return MeshFacts(triangles, 0)
    if positions.ndim != 2 or positions.shape[1] != 3:
        raise ValueError("a vertex is not three numbers")
    low, high = positions.min(axis=0).tolist(), positions.max(axis=0).tolist()
    if not all(map(math.isfinite, (*low, *high))):
        raise ValueError("some vertices are not finite")
    return MeshFacts(triangles, len(positions), tuple(low), tuple(high))


# ------------------------------ PLY ------------------------------


@dataclass(frozen=True, slots=True)
class _PlyLayout:
    """What a PLY header says. row: of a vertex, None in text. where: columns of x, y and z. face: of a triangle, "n"
    the number of its vertices and "v" their indices; None where there are no faces.
    """

    n: int
    n_faces: int
    n_columns: int
    where: list[int]
    row: np.dtype[Any] | None
    face: np.dtype[Any] | None


@dataclass(frozen=True, slots=True)
class Element:
    """One element of a PLY header. properties: (name, type) or (name, type of the count, type of the items)."""

    name: str
    count: int
    properties: list[tuple[str, ...]]


def _read_ply(data: bytes) -> MeshFacts:
    end = HEADER_END.search(data, 0, MAX_HEADER)
    if end is None:
        raise ValueError("no PLY header")
    layout = _ply_layout(data[: end.start()])
    n, start = layout.n, end.end()
    if n == 0:
        return MeshFacts(0, 0)
    if layout.row is None:
        rows, rest = ascii_rows(data[start:], n, layout.n_columns, "vertices")
        positions = rows[:, layout.where]
        if layout.face is not None and layout.n_faces:
            names = layout.face.names or ()
            at, width = names.index("n"), len(names) + 2
            faces, _ = ascii_rows(rest, layout.n_faces, width, "faces")
            _check_indices(faces[:, at], faces[:, at + 1 : at + 4], n)
    else:
        if n * layout.row.itemsize + layout.n_faces > len(data) - start:
            raise ValueError(f"the header promises {n} vertices, more than the file holds")
        rows = np.frombuffer(data, layout.row, n, start)
        positions = np.stack([rows[f"{i}"] for i in layout.where], axis=1)
        _check_faces(data, start + n * layout.row.itemsize, layout)
    return _facts(layout.n_faces, positions)


def _check_faces(data: bytes, start: int, layout: _PlyLayout) -> None:
    """Refuses triangles of vertices that are not there: Mitsuba reads beyond its memory for them."""
    if layout.face is None or layout.n_faces == 0:
        return
    if layout.n_faces * layout.face.itemsize > len(data) - start:
        raise ValueError(f"the header promises {layout.n_faces} faces, more than the file holds")
    faces = np.frombuffer(data, layout.face, layout.n_faces, start)
    _check_indices(faces["n"], faces["v"], layout.n)


def _check_indices(corners: NDArray[Any], indices: NDArray[Any], n: int) -> None:
    """corners: (m,) vertices of each face. indices: (m, 3)."""
    if not (corners == 3).all():
        raise ValueError(f"a face has {corners[corners != 3][0]:g} corners, and 3 are known; triangulate the mesh")
    if indices.size and not (indices.min() >= 0 and indices.max() < n):
        wrong = indices.min() if indices.min() < 0 else indices.max()
        raise ValueError(f"a face names vertex {wrong:.0f} of {n}")


@lru_cache(maxsize=256)  # many small meshes have the same header
def _ply_layout(header: bytes) -> _PlyLayout:
    """What is known of a header. Refuses whatever Mitsuba might read otherwise than we do: what was looked at would
    then not be what it loads.
    """
    encoding, elements = ply_header(header)
    vertex = elements[0] if elements else None
    if vertex is None or vertex.name != "vertex":
        raise ValueError("vertices must come first")
    face = next((one for one in elements if one.name == "face"), None)
    if face is not None and elements[1] is not face:
        raise ValueError(f"the element {elements[1].name!r} between vertices and faces is not known; leave it out")
    if len({one.name for one in elements}) < len(elements):
        raise ValueError("an element is there twice")
    names = [name for name, *_ in vertex.properties]
    if list_ := next((one for one in vertex.properties if len(one) == 3), None):
        raise ValueError(f"the list {list_[0]!r} among the vertices")
    where = [names.index(axis) for axis in "xyz"] if vertex.count else []
    order = ">" if encoding == "binary_big_endian" else "<"
    row = np.dtype([(f"{i}", order + PLY_TYPES[kind]) for i, (_, kind) in enumerate(vertex.properties)])
    n_faces = 0 if face is None else face.count
    if n_faces and not vertex.count:
        raise ValueError(f"{n_faces} faces without vertices")
    return _PlyLayout(
        vertex.count,
        n_faces,
        len(names),
        where,
        None if encoding == "ascii" else row,
        face_row(face, order) if face is not None and n_faces else None,
    )


def face_row(face: Element, order: str) -> np.dtype[Any]:
    """A triangle in the file: one list, its vertices, and what else it holds."""
    fields: list[tuple[Any, ...]] = []
    for i, (name, kind, *item) in enumerate(face.properties):
        if name in _CORNERS:  # Mitsuba's own names for what is in the list
            raise ValueError(f"a property of the faces is called {name}; rename it")
        if not item:
            fields.append((f"{i}", order + PLY_TYPES[kind]))
        elif name not in ("vertex_index", "vertex_indices") or "n" in [field for field, *_ in fields]:
            raise ValueError(f"the list {name!r} of the faces is not known; leave it out")
        elif not {PLY_TYPES[kind][0], PLY_TYPES[item[0]][0]} <= {"i", "u"}:
            raise ValueError(f"vertices of faces are counted in {kind} and named in {item[0]}; use whole numbers")
        else:
            fields += [("n", order + PLY_TYPES[kind]), ("v", order + PLY_TYPES[item[0]], 3)]
    if "n" not in [field for field, *_ in fields]:
        raise ValueError("the faces have no list vertex_indices")
    return np.dtype(fields)


def ply_header(header: bytes) -> tuple[str, list[Element]]:
    """Encoding and elements. Each line must be one that is known."""
    encodings: list[str] = []
    elements: list[Element] = []
    # Not splitlines, which parts lines where Mitsuba goes on.
    first, *lines = header.decode("latin-1").split("\n")
    if first.rstrip("\r") != "ply":
        raise ValueError("no PLY header")
    for line in lines:
        words = line.rstrip("\r").replace("\t", " ").split(" ")
        match [word for word in words if word]:
            case [] | ["comment", *_]:
                continue
            case ["format", kind, "1.0"] if kind in _ENCODINGS and not encodings:
                encodings.append(kind)
            case ["element", name, count] if _NAME.fullmatch(name) and re.fullmatch("[0-9]{1,10}", count):
                if int(count) >= 2**32:
                    raise ValueError(f"{count} of {name}")
                elements.append(Element(name, int(count), []))
            case ["property", "list", count, item, name] if elements and encodings and _NAME.fullmatch(name):
                _add(elements[-1], (name, count, item))
            case ["property", kind, name] if elements and encodings and _NAME.fullmatch(name):
                _add(elements[-1], (name, kind))
            case _:
                raise ValueError(f"the line {line[:60]!r} of its header is not known")
    if not encodings:
        raise ValueError("its header names no format")
    return encodings[0], elements


def ply_bytes(data: bytes) -> int:
    """How long a PLY file must be to hold what its header promises; lists in it are refused. Raises ValueError."""
    end = HEADER_END.search(data, 0, MAX_HEADER)
    if end is None:
        raise ValueError("no PLY header")
    encoding, elements = ply_header(data[: end.start()])
    wanted = end.end()
    for element in elements:
        if list_ := next((one for one in element.properties if len(one) == 3), None):
            raise ValueError(f"the list {list_[0]!r} of {element.name!r} is not known; leave it out")
        sizes = [np.dtype(PLY_TYPES[kind]).itemsize for _, kind in element.properties]
        wanted += element.count * (2 * len(sizes) if encoding == "ascii" else sum(sizes))
    return wanted


def _add(element: Element, found: tuple[str, ...]) -> None:
    name, *kinds = found
    if unknown := [kind for kind in kinds if kind not in PLY_TYPES]:
        raise ValueError(f"{unknown[0]!r} is no type that is known")
    if name in [one[0] for one in element.properties]:
        raise ValueError(f"the property {name!r} of {element.name!r} is there twice")
    element.properties.append(found)


def ascii_rows(body: bytes, n: int, n_columns: int, what: str) -> tuple[NDArray[np.float64], bytes]:
    """The numbers in n rows of text, and the text behind them."""
    if 2 * n * n_columns > len(body) + 1:
        raise ValueError(f"the header promises {n} {what}, more than the file holds")
    words = body.split(None, n * n_columns)
    if len(words) < n * n_columns:
        raise ValueError(f"the header promises {n} {what}, more than the file holds")
    rest = words.pop() if len(words) > n * n_columns else b""
    return np.fromiter(map(float, words), np.float64, n * n_columns).reshape(n, n_columns), rest


# ------------------------------ OBJ ------------------------------


def _read_obj(data: bytes, exact: bool) -> MeshFacts:
    data = b"\n" + (data.replace(b"\t", b" ") if b"\t" in data else data)
    if (face := data.find(b"\nf ")) >= 0 and b"-" in data[face + 1 : face + 200].split(b"\n", 1)[0]:
        raise ValueError("faces count vertices from the end (negative indices), which is not read; use absolute ones")
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


def _read_serialized(data: bytes, shape_index: int) -> MeshFacts:
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
    head = inflate.decompress(packed, MAX_HEADER)
    (flags,) = struct.unpack_from("<I", head, 0)
    at = head.index(b"\0", 4) + 1 if version == 4 else 4
    n, triangles = struct.unpack_from("<QQ", head, at)
    real = np.dtype("<f8" if flags & _DOUBLES else "<f4")
    per_vertex = 3 + sum(more for flag, more in _SERIALIZED_PARTS.items() if flags & flag)
    faces_at = per_vertex * n * real.itemsize
    wanted = faces_at + 12 * triangles
    if wanted > _INFLATE_RATIO * len(packed):
        raise ValueError(f"the header promises {n} vertices, more than the file holds")
    body = head[at + 16 :]
    body += inflate.decompress(inflate.unconsumed_tail, max(1, wanted - len(body))) if wanted > len(body) else b""
    if len(body) < wanted:
        raise ValueError("the file ends among the vertices or faces")
    faces = np.frombuffer(body, "<u4", 3 * triangles, faces_at).reshape(-1, 3)
    _check_indices(np.full(len(faces), 3), faces, n)
    return _facts(triangles, np.frombuffer(body, real, 3 * n).reshape(-1, 3).astype(np.float64))
