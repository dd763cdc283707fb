"""Facts about colours of vertices that cannot be had: each is named, with a way out."""

from __future__ import annotations

from pathlib import Path

import pytest

import renderer
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
