"""Fog with a shaft of light: a lamp shines through a hatch into a room full of fog, and the beam itself is seen.

The lamp is far behind the hatch: close to a point light, what fog scatters has no bound.
"""

from __future__ import annotations

from typing import Any

from renderer.backend import mitsuba

from .gallery_scene import GalleryScene
from .parts import area_light, camera, diffuse, rectangle, rgb, scene, sphere

WIDTH, HEIGHT = 768, 512
MAX_DEPTH = 16
EXTINCTION, ALBEDO, FORWARD = 0.13, 0.94, 0.4  # per unit of length; of water droplets, roughly
AIM, LAMP, CUTOFF = (0.9, 0.7, -0.4), (-5.04, 10.16, 1.36), 9.0
INTENSITY = 3500.0
HATCH = (-2.4, -0.2, 1.2)  # its left and back edge in the ceiling, and its size


def build() -> dict[str, Any]:
    """A room full of fog, with the camera in it, a hatch in the ceiling and a window."""
    mi = mitsuba()

    fog = {
        "type": "homogeneous",
        "sigma_t": EXTINCTION,
        "albedo": rgb(ALBEDO, ALBEDO, ALBEDO),
        "phase": {"type": "hg", "g": FORWARD},
    }
    spot = {
        "type": "spot",
        "to_world": mi.ScalarTransform4f().look_at(origin=list(LAMP), target=list(AIM), up=[0, 0, 1]),
        "cutoff_angle": CUTOFF,
        "beam_width": 0.8 * CUTOFF,
        "intensity": rgb(INTENSITY, 0.86 * INTENSITY, 0.62 * INTENSITY),
    }
    grey = diffuse(0.5, 0.5, 0.5)
    x, z, size = HATCH
    return scene(
        camera((0.0, 2.0, 7.4), (0.0, 2.05, 0.0), 46.0, WIDTH, HEIGHT) | {"medium": fog},
        MAX_DEPTH,
        {
            "floor": rectangle((-4, 0, -4), (0, 0, 12), (8, 0, 0), bsdf=diffuse(0.45, 0.4, 0.34)),
            "ceiling-back": rectangle((-4, 5, -4), (8, 0, 0), (0, 0, z + 4), bsdf=grey),
            "ceiling-front": rectangle((-4, 5, z + size), (8, 0, 0), (0, 0, 8 - z - size), bsdf=grey),
            "ceiling-left": rectangle((-4, 5, z), (x + 4, 0, 0), (0, 0, size), bsdf=grey),
            "ceiling-right": rectangle((x + size, 5, z), (4 - x - size, 0, 0), (0, 0, size), bsdf=grey),
            "back": rectangle((-4, 0, -4), (8, 0, 0), (0, 5, 0), bsdf=diffuse(0.35, 0.42, 0.5)),
            "front": rectangle((-4, 0, 8), (0, 5, 0), (8, 0, 0), bsdf=grey),
            "left": rectangle((-4, 0, -4), (0, 5, 0), (0, 0, 12), bsdf=grey),
            "right": rectangle((4, 0, -4), (0, 0, 12), (0, 5, 0), bsdf=grey),
            "ball": sphere((0.9, 0.7, -0.4), 0.7, bsdf=diffuse(0.75, 0.25, 0.15)),
            "lamp": spot,
            "window": rectangle((3.99, 1.6, -2.5), (0, 0, 2.5), (0, 1.8, 0), emitter=area_light((0.6, 0.8, 1.0), 4.0)),
        },
        integrator="volpath",
    )


SCENE = GalleryScene(
    name="fog",
    title="Fog with a shaft of light",
    teaches="Light is scattered between surfaces: the beam is seen from the side, and its error is largest where it is "
    "thin and bright.",
    width=WIDTH,
    height=HEIGHT,
    build=build,
    has_media=True,
)
