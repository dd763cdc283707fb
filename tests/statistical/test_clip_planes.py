"""Near and far planes hide what Mitsuba's own `path` hides, at every scale and for every camera that has them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import renderer
from renderer.backend import mitsuba

SIDE = 16
NEVER = {"near_clip": 1e-3, "far_clip": 1e3}


def slope(kind: str, clips: dict[str, float], scale: float = 1.0) -> dict[str, Any]:
    """A glowing wall that slants from near the camera to far away, before a dim sky."""
    t = mitsuba().ScalarTransform4f()
    look = t.look_at([0, 0, 5 * scale], [0, 0, 0], [0, 1, 0])
    camera: dict[str, Any] = {
        "type": kind,
        "to_world": look,
        "film": {"type": "hdrfilm", "width": SIDE, "height": SIDE},
    }
    camera["film"]["filter"] = {"type": "box"}
    camera |= {key: value * scale for key, value in clips.items()}
    if kind == "orthographic":
        camera["to_world"] = look @ t.scale([scale, scale, 1])
    else:
        camera["fov"] = 40.0
    if kind == "thinlens":
        camera |= {"aperture_radius": 0.01 * scale, "focus_distance": 5.0 * scale}
    wall = {"type": "rectangle", "to_world": t.scale(scale).rotate([1, 0, 0], -60).scale(6)}
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 3},
        "camera": camera,
        "wall": {**wall, "emitter": {"type": "area", "radiance": 3.0}},
        "sky": {"type": "constant", "radiance": 0.25},
    }


def seen(source: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Our picture, and that of Mitsuba's path."""
    mi = mitsuba()
    scene = mi.load_dict(source)
    theirs = np.array(mi.render(scene, spp=256, seed=1), dtype=np.float64)[..., :3]
    estimate = renderer.render(source, renderer.Target(spp=64), renderer.Settings(seed=1, max_depth=3))
    return np.asarray(estimate.mean, np.float64), theirs


@pytest.mark.parametrize(("kind", "scale"), [("perspective", 1e-4), ("thinlens", 1.0), ("orthographic", 1e-4)])
def test_clip_planes_hide_what_mitsubas_path_hides(kind: str, scale: float) -> None:
    ours, theirs = seen(slope(kind, {"near_clip": 3.8, "far_clip": 5.4}, scale))
    whole, _ = seen(slope(kind, NEVER, scale))
    assert np.abs(ours - theirs).mean() < 0.03 * theirs.mean()
    assert ours.mean() < 0.7 * whole.mean()
