"""Scenes whose light is hard to find: the truth is known, and a naive error bar is wrong nearly always.

A floor under a far disk that one in 1/p cosine-distributed directions hits. Directions are drawn by the BSDF alone
(technique `bsdf`), so that nothing aims at the disk. A dim sky gives every sample something that looks settled.
"""

from __future__ import annotations

import math
from typing import Any

from renderer.backend import mitsuba
from renderer.settings import Settings

SETTINGS = Settings(technique="bsdf", replicate_size=16)
HEIGHT = 200.0
ALBEDO = 0.5


def scene(probability: float, sky: float, is_half_shaded: bool = False) -> dict[str, Any]:
    """probability: of a sample to find the disk, which lights the floor as a sky of radiance 1 would; `sky`: what the
    real one has. is_half_shaded: a plate far above hides the disk from the left half of the floor.
    """
    t: Any = mitsuba().ScalarTransform4f
    radius = HEIGHT * math.sqrt(probability / (1 - probability))
    parts: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 2},
        "sensor": {
            "type": "orthographic",
            "to_world": t().look_at(origin=[0, 0, 5], target=[0, 0, 0], up=[0, 1, 0]),
            "film": {"type": "hdrfilm", "width": 64, "height": 48, "rfilter": {"type": "box"}},
        },
        "floor": {
            "type": "rectangle",
            "to_world": t().scale(2),
            "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": ALBEDO}},
        },
        "disk": {
            "type": "disk",
            "to_world": t().translate([0, 0, HEIGHT]).rotate([1, 0, 0], 180).scale(radius),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": 1 / probability}},
            "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}},
        },
    }
    if sky:
        parts["sky"] = {"type": "constant", "radiance": {"type": "rgb", "value": sky}}
    if is_half_shaded:
        parts["plate"] = {
            "type": "rectangle",
            "to_world": t().translate([-20, 0, 100]).rotate([1, 0, 0], 180).scale(20),
            "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}},
        }
    return parts


def scenes() -> dict[str, dict[str, Any]]:
    """All of them by name."""
    return {
        "rare-1e-3": scene(1e-3, 1.0),
        "rare-1e-4": scene(1e-4, 1.0),
        "rare-1e-3-half": scene(1e-3, 1.0, True),
        "rare-1e-4-half": scene(1e-4, 1.0, True),
        "rare-1e-3-dark": scene(1e-3, 0.0),
    }
