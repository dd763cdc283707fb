"""Lights with textures, colours of vertices and smooth normals: all techniques find what direction sampling finds.

Mitsuba's own emitter sampling finds a part of most of them, so its `path` is no judge here; its `direct` with samples
of the BSDF alone is, and so is ours.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import SHARED, mean_and_error, z_limit
from test_emitter_sampling import COLOURS, HALVES, bowl, by_vertex, mesh, painted

import renderer
from renderer.backend import mitsuba
from renderer.errors import SceneError

mi = mitsuba()
T = mi.ScalarTransform4f
RUNS = 8
DIM = {"type": "diffuse", "reflectance": 0.6}


def room(light: dict[str, Any], **more: Any) -> dict[str, Any]:
    """A floor under a light, seen from above the side, so that the light itself is hardly in the picture."""
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 2},
        "sensor": {
            "type": "perspective",
            "fov": 40.0,
            "to_world": T().look_at([0, -4, 2.4], [0, -0.4, 0], [0, 0, 1]),
            "film": {"type": "hdrfilm", "width": 16, "height": 12, "filter": {"type": "box"}},
        },
        "floor": {"type": "rectangle", "to_world": T().scale(3), "bsdf": DIM},
        "light": light,
        **more,
    }


def in_a_file(made: Any, folder: Path, emitter: dict[str, Any]) -> dict[str, Any]:
    """A light in the form of a mesh."""
    path = folder / "light.ply"
    made.write_ply(str(path))
    return {"type": "ply", "filename": str(path), "emitter": emitter}


def plate(folder: Path, emitter: dict[str, Any] | None = None, **more: Any) -> dict[str, Any]:
    corners = np.array([[-0.6, -0.6, 1], [-0.6, 0.6, 1], [0.6, 0.6, 1], [0.6, -0.6, 1]])
    return in_a_file(mesh(corners, HALVES, **more), folder, emitter or painted())


def shape(kind: str, **more: Any) -> dict[str, Any]:
    above = T().translate([0, 0, 1.2]).rotate([1, 0, 0], 180).scale(0.6)
    return {"type": kind, "to_world": above, "emitter": painted()} | more


BIG_UV = [[0, 0], [0, 2], [3, 2], [3, 0]]
LIGHTS: dict[str, Callable[[Path], dict[str, Any]]] = {
    "a picture that repeats": lambda folder: plate(folder, uv=BIG_UV),
    "a picture that mirrors": lambda folder: plate(folder, uv=BIG_UV, emitter=painted("mirror")),
    "a picture moved": lambda folder: shape(
        "rectangle", emitter=painted(to_uv=T().translate([0.3, 0.2, 0]).scale(2.0))
    ),
    "colours of vertices": lambda folder: plate(folder, emitter=by_vertex(), vertex_color=COLOURS),
    "a smooth bowl": lambda folder: in_a_file(bowl(), folder, {"type": "area", "radiance": 1.0}),
    "a turned ball of one radiance": lambda folder: shape("sphere", emitter={"type": "area", "radiance": 1.0}),
    "a disk": lambda folder: shape("disk"),
    "a ball": lambda folder: shape("sphere"),
    "a cylinder": lambda folder: shape(
        "cylinder", to_world=T().translate([-0.5, 0, 1]).rotate([0, 1, 0], 90).scale([0.3, 0.3, 1])
    ),
}


def by_directions(source: dict[str, Any], seed: int) -> tuple[float, float]:
    """Mean luminance by Mitsuba's `direct` without its emitter sampling, and its standard error."""
    scene: Any = mi.load_dict(source)
    integrator: Any = mi.load_dict({"type": "direct", "emitter_samples": 0, "bsdf_samples": 1})
    weights = np.array([0.2126, 0.7152, 0.0722])
    runs = [
        float(np.mean(np.array(mi.render(scene, integrator=integrator, spp=1024, seed=seed % 2**20 + run)) @ weights))
        for run in range(RUNS)
    ]
    return float(np.mean(runs)), float(np.std(runs, ddof=1)) / math.sqrt(RUNS)


def agree(source: dict[str, Any], seed: int) -> None:
    theirs, their_error = by_directions(source, seed)
    assert theirs > 0.01
    for technique in ("mis", "emitter", "bsdf"):
        settings = renderer.Settings(seed=seed, technique=technique, adaptive=False, colour="rgb")
        ours, our_error = mean_and_error(renderer.render(source, renderer.Target(spp=256), settings))
        # Eight runs tell an error to a quarter of it.
        limit = 1.5 * z_limit(3) * math.hypot(our_error, their_error)
        assert abs(ours - theirs) < limit, (
            f"{technique}: {ours:.5g} ± {our_error:.1g}, {theirs:.5g} ± {their_error:.1g}"
        )


@pytest.mark.parametrize("name", LIGHTS)
def test_all_techniques_find_all_of_a_painted_light(name: str, tmp_path: Path, seed: int) -> None:
    agree(room(LIGHTS[name](tmp_path)), seed)


def test_painted_lights_are_found_among_others(tmp_path: Path, seed: int) -> None:
    lamp = {"type": "spot", "to_world": T().look_at([1, 0, 2], [1, 0, 0], [0, 1, 0]), "intensity": 0.0}
    ring = shape("cylinder", to_world=T().translate([1, 1, 0.5]).scale(0.2), emitter={"type": "area", "radiance": 3.0})
    agree(room(LIGHTS["a picture that repeats"](tmp_path), lamp=lamp, ring=ring, ball=shape("disk")), seed)


@pytest.mark.parametrize(
    ("name", "right"), [("tiled-light/tile-texr.xml", 0.0681), ("vertex-colour-light/vertexcol-light.xml", 0.0381)]
)
def test_lights_of_public_reports(name: str, right: float, seed: int) -> None:
    """Red, by direct light alone; 0.0375 and 0 before."""
    path = SHARED / "reports" / name
    if not path.is_file():
        pytest.skip("needs the public reports beside the checkout")
    settings = renderer.Settings(seed=seed, max_depth=2)
    red = renderer.render(path, renderer.Target(spp=256), settings).mean[..., 0].mean()
    assert red == pytest.approx(right, rel=0.02)


def test_a_textured_light_without_texture_coordinates_is_refused_by_name(tmp_path: Path) -> None:
    """165 lines of traceback before, and all other scenes of the process failed while it was there."""
    light = plate(tmp_path)
    healthy = room(shape("disk"), lamp=shape("cylinder", emitter={"type": "area", "radiance": 1.0}))
    with pytest.raises(SceneError, match=r"light with a texture.*no texture coordinates.*export"):
        renderer.load_scene(room(light))
    assert renderer.render(healthy, renderer.Target(spp=16), renderer.Settings(seed=1)).mean.mean() > 0
