"""Facts about recorded kernels: a pass is traced once, whatever else is loaded and whatever camera looks."""

from __future__ import annotations

import gc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import renderer
from renderer.backend import mitsuba
from renderer.equation.path import PathKernel
from renderer.scene.compile import Scene

SHARED = Path(__file__).resolve().parents[4] / "shared" / "scenes"
SETTINGS = renderer.Settings(width=8, height=8, replicate_size=4, colour="rgb")


def tiled_room(sensor: dict[str, Any]) -> Scene:
    """A room seen through a sensor."""
    rng, look = np.random.default_rng(1), mitsuba().ScalarTransform4f().look_at([0, 1, 4], [0, 0, 0], [0, 1, 0])
    image = mitsuba().Bitmap(rng.random((4, 4, 3), np.float32))
    paper = {"type": "bitmap", "bitmap": image, "raw": True}
    metal = {"type": "roughconductor", "alpha": 0.2, "specular_reflectance": paper}
    contents = {
        "sensor": sensor | {"to_world": look},
        "floor": {"type": "rectangle", "bsdf": {"type": "twosided", "bsdf": metal}},
        "ball": {"type": "cylinder", "bsdf": {"type": "diffuse", "reflectance": paper}},
        "lamp": {"type": "point", "position": mitsuba().ScalarPoint3f(1, 2, 2), "intensity": 20.0},
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": [0.2, 0.3, 0.4]}},
    }
    return renderer.load_scene({"type": "scene", **contents}, settings=SETTINGS)


def launches(scene: Scene, times: int = 3) -> PathKernel:
    gc.collect()  # what other tests loaded: a recording is of all scenes that are there
    pixels = np.arange(64, dtype=np.uint32)
    kernel = scene.kernel(scene.resolved(SETTINGS, 4))
    for turn in range(times):
        np.array(kernel.launch(pixels, np.full_like(pixels, turn), 1)[0])
    return kernel


def recordings(kernel: PathKernel) -> int:
    assert kernel.is_recorded, "its passes are traced one by one"
    return kernel._replayed.n_recordings


@pytest.mark.skipif(not SHARED.is_dir(), reason="there is no folder of shared scenes beside the checkout")
@pytest.mark.parametrize("name", ["veach-ajar", "cornell-box"])
def test_kernels_stay_recorded_where_a_scene_is_loaded_twice(name: str) -> None:
    scenes = [renderer.load_scene(SHARED / name / "scene.xml", settings=SETTINGS) for _ in range(2)]
    for scene in scenes:
        before = recordings(launches(scene))
        assert recordings(launches(scene)) == before


@pytest.mark.parametrize("sensor", ["thinlens", "orthographic"])
def test_every_camera_is_recorded(sensor: str) -> None:
    lens = {"aperture_radius": 0.1, "focus_distance": 4.0} if sensor == "thinlens" else {}
    scene = tiled_room({"type": sensor, **lens})
    before = recordings(launches(scene))
    assert recordings(launches(scene)) == before
