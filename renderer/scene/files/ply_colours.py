"""Colours in bytes of a PLY file, as MeshLab, Blender and scanners write them: what an 8-bit picture means by them.

Enters: the bytes of a .ply file that `mesh.read_mesh` accepts. Leaves: the same mesh, its colours linear and in floats,
so that Mitsuba does not take 188 for a reflectance of 188; without an alpha, beside which it finds no colour at all.
Colours in floats are linear, as Mitsuba has them, and stay.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderer.scene.files.mesh import HEADER_END, MAX_HEADER, PLY_TYPES, Element, ascii_rows, face_row, ply_header

_COLOURS = (("red", "green", "blue"), ("r", "g", "b"))
_ALPHAS = ("alpha", "a")
_BYTE = "u1"


def with_display_colours(data: bytes) -> bytes | None:
    """The file with colours in bytes, of vertices and faces, made linear; little-endian binary. None where it has none.
    What follows its faces is left out: nothing reads it. Raises ValueError where it is damaged.
    """
    end = HEADER_END.search(data, 0, MAX_HEADER)
    if end is None:
        return None
    encoding, elements = ply_header(data[: end.start()])
    known = [one for one in elements[:2] if one.name in ("vertex", "face") and one.count]
    if not any(_colours_of(one) for one in known):
        return None
    body, at = data[end.end() :], 0
    header, parts = ["ply", "format binary_little_endian 1.0"], []
    for element in known:
        rows = _Rows.of(element, ">" if encoding == "binary_big_endian" else "<")
        if encoding == "ascii":
            numbers, body = ascii_rows(body, element.count, rows.n_columns, element.name)
            values = rows.filled(numbers)
        else:
            values = np.frombuffer(body, rows.kind, element.count, at)
            at += values.nbytes
        header += [f"element {element.name} {element.count}", *rows.lines(element)]
        parts.append(rows.linear(values).tobytes())
    return "\n".join([*header, "end_header", ""]).encode() + b"".join(parts)


def _colours_of(element: Element) -> tuple[str, ...]:
    """Names of the three colours, where all of them are in bytes."""
    kinds = {name: PLY_TYPES[kind] for name, kind, *item in element.properties if not item}
    return next((names for names in _COLOURS if all(kinds.get(name) == _BYTE for name in names)), ())


@dataclass(frozen=True, slots=True)
class _Rows:
    """How the rows of an element lie in the file. kind: of a row, its fields in order; those of a list are "n" and "v".
    colours, left_out: fields that are made linear, and those that go.
    """

    kind: np.dtype[Any]
    colours: tuple[str, ...]
    left_out: tuple[str, ...]

    @classmethod
    def of(cls, element: Element, order: str) -> _Rows:
        names = [name for name, *_ in element.properties]
        if element.name == "face":
            kind = face_row(element, order)
        else:
            kind = np.dtype([(f"{i}", order + PLY_TYPES[one[1]]) for i, one in enumerate(element.properties)])
        colours = _colours_of(element)
        alphas = [name for name in _ALPHAS if name in names] if colours else []
        return cls(kind, tuple(f"{names.index(c)}" for c in colours), tuple(f"{names.index(a)}" for a in alphas))

    @property
    def n_columns(self) -> int:
        """Numbers in a row of text."""
        return sum(3 if name == "v" else 1 for name in self.kind.names or ())

    def filled(self, numbers: NDArray[np.float64]) -> NDArray[Any]:
        """Rows of text, (n, columns), as the binary form has them."""
        values, column = np.zeros(len(numbers), self.kind), 0
        for name in self.kind.names or ():
            width = 3 if name == "v" else 1
            values[name] = numbers[:, column : column + width].reshape(values[name].shape)
            column += width
        return values

    def lines(self, element: Element) -> list[str]:
        """Lines of the new header, one a property."""
        kept = [(f"{i}", one) for i, one in enumerate(element.properties) if f"{i}" not in self.left_out]
        return [
            f"property list {one[1]} {one[2]} {one[0]}"
            if len(one) == 3
            else f"property {'float' if field in self.colours else one[1]} {one[0]}"
            for field, one in kept
        ]

    def linear(self, values: NDArray[Any]) -> NDArray[Any]:
        """The rows of the new file."""
        fields: list[tuple[Any, ...]] = []
        for name in self.kind.names or ():
            if name not in self.left_out:
                kind, shape = self.kind[name].base, self.kind[name].shape
                fields.append((name, "<f4" if name in self.colours else kind.newbyteorder("<"), shape))
        made = np.zeros(len(values), fields)
        for name in made.dtype.names or ():
            made[name] = _LINEAR[values[name]] if name in self.colours else values[name]
        return made


_ENCODED = np.arange(256) / 255
# IEC 61966-2-1
_LINEAR = np.where(_ENCODED <= 0.04045, _ENCODED / 12.92, ((_ENCODED + 0.055) / 1.055) ** 2.4).astype(np.float32)
