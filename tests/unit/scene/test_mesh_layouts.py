"""PLY layouts: what is looked at must be what Mitsuba loads, so any other layout than those that we know is refused.

Each hostile file names vertex 10⁶ of 3 where a reader that takes the header otherwise than Mitsuba does sees nothing.
"""

from __future__ import annotations

import struct

import pytest

from renderer.errors import SceneError
from renderer.scene.files.mesh import MeshFacts, read_mesh

VERTICES = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)
FACE, WRONG = struct.pack("<B3i", 3, 0, 1, 2), struct.pack("<B3i", 3, 0, 1, 10**6)
AXES = "property float x\nproperty float y\nproperty float z\n"
V, F = f"element vertex 3\n{AXES}", "element face 1\nproperty list uchar int vertex_indices\n"
OTHER = "element strange 1\nproperty uchar a\n"


def ply(header: str, body: bytes, encoding: str = "binary_little_endian") -> bytes:
    return f"ply\nformat {encoding} 1.0\n{header}end_header\n".encode("latin-1") + body


REFUSED: dict[str, tuple[bytes, str]] = {
    "an element between": (ply(V + OTHER + F, VERTICES + b"\0" + WRONG), "'strange' between vertices and faces"),
    "an element of no rows between": (ply(V + OTHER.replace("1", "0") + F, VERTICES + WRONG), "'strange' between"),
    "an element before": (ply(OTHER + V + F, b"\0" + VERTICES + WRONG), "vertices must come first"),
    "faces twice": (ply(V + F + F, VERTICES + FACE + WRONG), "twice"),
    "more faces than the last ones": (ply(V + F + F.replace("1", "0"), VERTICES + WRONG), "twice"),
    "vertices twice": (ply(V + F + V, VERTICES + FACE + VERTICES), "twice"),
    "faces without vertices": (ply(V.replace("3", "0") + F, WRONG), "1 faces without vertices"),
    "two lists": (
        ply(V + F + "property list uchar int more\n", VERTICES + FACE + WRONG),
        "'more' of the faces is not known",
    ),
    "two lists of vertices": (
        ply(V + F + "property list uchar int vertex_index\n", VERTICES + FACE + WRONG),
        "'vertex_index' of the faces is not known",
    ),
    "a list of another name": (ply(V + F.replace("vertex_indices", "corners"), VERTICES + WRONG), "'corners'"),
    "no list": (ply(V + "element face 1\nproperty int a\n", VERTICES + b"\0" * 4), "no list vertex_indices"),
    "a corner beside the list": (
        ply(
            V + "element face 1\nproperty int i0\nproperty list uchar int vertex_indices\n",
            VERTICES + b"\xff" * 4 + FACE,
        ),
        "called i0",
    ),
    "fractions for vertices": (
        ply(V + F.replace("int vertex", "float vertex"), VERTICES + struct.pack("<B3f", 3, 0, 1, float("nan"))),
        "whole numbers",
    ),
    "a fraction for a count": (
        ply(V + F.replace("uchar", "float"), VERTICES + struct.pack("<f3i", 3, 0, 1, 10**6)),
        "whole numbers",
    ),
    "a vertex that is not there": (ply(V + F, VERTICES + WRONG), "vertex 1000000 of 3"),
    "a negative vertex": (ply(V + F, VERTICES + struct.pack("<B3i", 3, 0, 1, -2)), "vertex -2 of 3"),
    "one vertex too far": (ply(V + F, VERTICES + struct.pack("<B3i", 3, 0, 1, 3)), "vertex 3 of 3"),
    "a wrong one behind four corners": (
        ply(V + F.replace("1", "2"), VERTICES + struct.pack("<B4i", 4, 0, 1, 2, 0) + WRONG),
        "4 corners",
    ),
    "a wrong one in text": (ply(V + F, b"0 0 0 1 0 0 0 1 0 3 0 1 9", "ascii"), "vertex 9 of 3"),
    "a header that ends in a comment": (
        ply(f"{V}comment end_header\nelement strange 0\nproperty uchar a\n{F}", VERTICES + WRONG),
        "'strange' between",
    ),
    "a line that only some end": (
        ply(f"comment \x0b{V[:-1]}\x0b\n{V}{F}", VERTICES + WRONG),
        "'property float x' of its",
    ),
    "a line within a name": (ply(f"{V}element\x1fface 1\n{F}", VERTICES + WRONG), "is not known"),
    "a count with a line in it": (ply(V.replace("3", "3_0") + F, VERTICES * 10 + WRONG), "is not known"),
    "a count and more": (ply(V + F.replace("face 1", "face 1 2"), VERTICES + WRONG), "is not known"),
    "a word that is none": (ply(V + "obj_info 1\n" + F, VERTICES + FACE), "'obj_info 1' of its header"),
    "an unknown type": (ply(V + "property half w\n" + F, VERTICES + FACE), "'half' is no type"),
    "a coordinate twice": (ply(V + "property float x\n" + F, VERTICES + FACE), "'x' of 'vertex' is there twice"),
    "two formats": (ply("format ascii 1.0\n" + V + F, VERTICES + FACE), "is not known"),
    "no format": (b"ply\n" + (V + F).encode() + b"end_header\n" + VERTICES + FACE, "is not known|no format"),
    "a list among the vertices": (
        ply(V + "property list uchar int a\n" + F, VERTICES + FACE),
        "'a' among the vertices",
    ),
    "faces before vertices": (ply(F + V, WRONG + VERTICES), "vertices must come first"),
    "fewer faces than it says": (ply(V + F.replace("1", "2"), VERTICES + FACE), "more than the file holds"),
}
TAKEN = {
    "as exporters write it": ply(V + F, VERTICES + FACE),
    "with comments, tabs, empty lines": ply(
        f"comment by end_header é\n\n{V}{F}".replace("float ", "float\t"), VERTICES + FACE
    ),
    "with Windows' line ends": ply(V + F, VERTICES + FACE).replace(b"\n", b"\r\n", 14),
    "with more about vertices and faces": ply(
        f"{V}property uchar red\n{F}property uchar flags\n",
        b"".join(VERTICES[i : i + 12] + b"\0" for i in (0, 12, 24)) + FACE + b"\0",
    ),
    "with an element behind": ply(V + F + OTHER, VERTICES + FACE + b"\0"),
    "in text": ply(V + F, b"0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", "ascii"),
}  # fmt: skip


@pytest.mark.parametrize("what", REFUSED)
def test_a_layout_that_could_be_read_otherwise_is_refused_by_name(what: str) -> None:
    data, says = REFUSED[what]
    with pytest.raises(SceneError, match=says):
        read_mesh(data, "m.ply", "ply")


@pytest.mark.parametrize("what", TAKEN)
def test_usual_layouts_are_taken(what: str) -> None:
    assert read_mesh(TAKEN[what], "m.ply", "ply") == MeshFacts(1, 3, (0.0, 0.0, 0.0), (1.0, 1.0, 0.0))


def test_points_without_faces_are_no_triangles() -> None:
    assert read_mesh(ply(V, VERTICES), "m.ply", "ply").triangles == 0
    assert read_mesh(ply(V.replace("3", "0"), b""), "m.ply", "ply") == MeshFacts(0, 0)
