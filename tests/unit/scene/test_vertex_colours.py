"""Facts about colours of vertices: those that cannot be had are named, with a way out; bytes mean display colours."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import pytest

import renderer
from renderer.backend import mitsuba
from renderer.errors import SceneError

PLY = """ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
property {kind} {red}
property {kind} {green}
property {kind} {blue}
element face 1
property list uchar int vertex_indices
end_header
0 0 0 1 0 0
1 0 0 0 1 0
0 1 0 0 0 1
3 0 1 2
"""
FLOATS = {"kind": "float", "red": "r", "green": "g", "blue": "b"}
OTHERS = {"kind": "float", "red": "quality", "green": "size", "blue": "weight"}
SCENE = """<scene version="3.0.0"><sensor type="perspective"/><emitter type="constant"/><shape type="ply">
<string name="filename" value="a.ply"/><bsdf type="{bsdf}">{colour}</bsdf></shape></scene>"""


def scene(folder: Path, bsdf: str, key: str, columns: dict[str, str]) -> Path:
    (folder / "a.ply").write_text(PLY.format(**columns))
    colour = f'<texture name="{key}" type="mesh_attribute"><string name="name" value="vertex_color"/></texture>'
    (folder / "scene.xml").write_text(SCENE.format(bsdf=bsdf, colour=colour))
    return folder / "scene.xml"


@pytest.mark.parametrize(("columns", "is_missing"), [(FLOATS, False), (OTHERS, True)], ids=["there", "missing"])
def test_colours_that_no_mesh_has_are_named(columns: dict[str, str], is_missing: bool, tmp_path: Path) -> None:
    """A black mesh without a word before."""
    warnings = renderer.load_scene(scene(tmp_path, "diffuse", "reflectance", columns)).warnings
    assert any("no mesh has 'vertex_color'" in warning for warning in warnings) == is_missing


@pytest.mark.parametrize("bsdf", ["plastic", "roughplastic"])
def test_materials_that_cannot_have_colours_of_vertices_say_so(bsdf: str, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=f"{bsdf}.*needs the mean of its colours.*use principled"):
        renderer.load_scene(scene(tmp_path, bsdf, "diffuse_reflectance", FLOATS))


def test_a_colour_in_hexadecimal_is_told_how_to_write_it(tmp_path: Path) -> None:
    colour = '<rgb name="reflectance" value="#3366cc"/>'
    (tmp_path / "a.ply").write_text(PLY.format(**FLOATS))
    (tmp_path / "scene.xml").write_text(SCENE.format(bsdf="diffuse", colour=colour))
    with pytest.raises(SceneError, match=r"#3366cc.*three numbers"):
        renderer.load_scene(tmp_path / "scene.xml")


# ------------------------------ Colours in bytes ------------------------------

BYTES = [(188, 10, 0), (0, 255, 64), (128, 128, 3)]
CORNERS = [(-1.0, -1.0, 0.0), (3.0, -1.0, 0.0), (-1.0, 3.0, 0.0)]


def linear(byte: int) -> float:
    """IEC 61966-2-1."""
    c = byte / 255
    return c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4


def mesh(encoding: str, of: str, alpha: bool, names: tuple[str, ...], in_bytes: bool) -> bytes:
    """A triangle whose vertices, or whose face, has colours: in bytes, or the same in floats."""
    kind = "uchar" if in_bytes else "float"
    colours = "".join(f"property {kind} {name}\n" for name in names[: 4 if alpha and in_bytes else 3])
    header = (
        f"ply\nformat {encoding} 1.0\ncomment made by hand\nelement vertex 3\nproperty float x\nproperty float y\n"
        f"property float z\n{colours if of == 'vertex' else ''}element face 1\n"
        f"property list uchar int vertex_indices\n{colours if of == 'face' else ''}end_header\n"
    )
    order = ">" if encoding == "binary_big_endian" else "<"
    pack = lambda form, *values: (  # noqa: E731
        f"{' '.join(map(str, values))} ".encode() if encoding == "ascii" else struct.pack(order + form, *values)
    )

    def colour(i: int) -> bytes:
        if not in_bytes:
            return pack("fff", *map(linear, BYTES[i]))
        return pack("BBBB", *BYTES[i], 77) if alpha else pack("BBB", *BYTES[i])

    body = b""
    for i, corner in enumerate(CORNERS):
        body += pack("fff", *corner) + (colour(i) if of == "vertex" else b"")
    body += pack("B", 3) + pack("iii", 0, 1, 2) + (colour(0) if of == "face" else b"")
    return header.encode() + body


def coloured_scene(file: Path, of: str, grouped: bool) -> dict[str, Any]:
    texture = {"type": "mesh_attribute", "name": f"{of}_color"}
    shape = {"type": "ply", "filename": str(file), "bsdf": {"type": "twosided", "b": {"type": "diffuse"}}}
    shape["bsdf"]["b"]["reflectance"] = texture
    T = mitsuba().ScalarTransform4f
    film = {"type": "hdrfilm", "width": 8, "height": 8, "rfilter": {"type": "box"}}
    parts = {
        "group": {"type": "shapegroup", "a": shape},
        "one": {"type": "instance", "b": {"type": "ref", "id": "group"}},
    }
    return {
        "type": "scene",
        "eye": {"type": "perspective", "to_world": T().look_at([0, 0, 3], [0, 0, 0], [0, 1, 0]), "film": film},
        "sky": {"type": "constant"},
        **(parts if grouped else {"a": shape}),
    }


@pytest.mark.parametrize("grouped", [False, True], ids=["alone", "in a shape group"])
@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize(("of", "alpha"), [("vertex", False), ("vertex", True), ("face", False), ("face", True)])
def test_colours_in_bytes_are_display_colours_wherever_the_mesh_is(
    encoding: str, of: str, alpha: bool, grouped: bool, tmp_path: Path
) -> None:
    names = ("red", "green", "blue", "alpha") if encoding == "ascii" else ("r", "g", "b", "a")
    pictures = []
    for in_bytes in (True, False):
        file = tmp_path / f"{'bytes' if in_bytes else 'floats'}.ply"
        file.write_bytes(mesh(encoding, of, alpha, names, in_bytes))
        scene = renderer.load_scene(coloured_scene(file, of, grouped))
        assert any("bytes.ply" in note and "display colours" in note for note in scene.requirements.notes) == in_bytes
        pictures.append(renderer.render(scene, renderer.Target(spp=4), renderer.Settings(seed=3)).mean)
    assert pictures[1].max() > 0.05  # there is something to see
    assert pictures[0] == pytest.approx(pictures[1], rel=1e-5)


def test_colours_in_bytes_that_nothing_asks_for_leave_the_file_alone(tmp_path: Path) -> None:
    file = tmp_path / "a.ply"
    file.write_bytes(mesh("ascii", "vertex", True, ("red", "green", "blue", "alpha"), True))
    scene = coloured_scene(file, "vertex", False)
    scene["a"]["bsdf"] = {"type": "diffuse"}
    assert not any("display" in note for note in renderer.load_scene(scene).requirements.notes)
