"""Facts about dropping triangles of zero area: what the others look like stays."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from renderer.backend import mitsuba
from renderer.scene.compile import load_scene

HEAD = """ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
property float nx
property float ny
property float nz
element face 3
property list uchar int vertex_indices
property float r
property float g
property float b
end_header
"""
VERTICES = ((-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0))
FACES = ("3 0 1 2 1 0 0", "3 0 1 1 0 1 0", "3 0 2 3 0 0 1")  # the second has no area


@pytest.fixture
def loaded(tmp_path: Path) -> dict[str, np.ndarray]:
    """Parameters of a mesh with tilted normals and a colour for each face, by their last name."""
    rows = [" ".join(map(str, (*vertex, 0.6, 0.0, 0.8))) for vertex in VERTICES]
    (tmp_path / "m.ply").write_text(HEAD + "\n".join([*rows, *FACES]) + "\n")
    scene = load_scene(
        {
            "type": "scene",
            "sensor": {"type": "perspective", "film": {"type": "hdrfilm", "width": 8, "height": 8}},
            "sky": {"type": "constant"},
            "mesh": {"type": "ply", "filename": str(tmp_path / "m.ply")},
        }
    )
    assert "dropped 1 triangles of zero area" in scene.requirements.notes
    parameters = mitsuba().traverse(scene.mitsuba_scene)
    return {key.rpartition(".")[2]: np.array(parameters[key]) for key in parameters.keys()}  # noqa: SIM118


def test_the_faces_with_an_area_are_kept(loaded: dict[str, np.ndarray]) -> None:
    assert loaded["faces"].tolist() == [0, 1, 2, 0, 2, 3]


def test_normals_of_the_file_are_kept(loaded: dict[str, np.ndarray]) -> None:
    np.testing.assert_allclose(loaded["vertex_normals"].reshape(-1, 3), [[0.6, 0.0, 0.8]] * 4, atol=1e-6)


def test_a_face_keeps_its_own_attribute(loaded: dict[str, np.ndarray]) -> None:
    (name,) = [name for name in loaded if name.startswith("face_")]
    assert loaded[name].tolist() == [1, 0, 0, 0, 0, 1]
