"""A glass of something cloudy: a ball of glass full of a milky drink, and one of clear tea, under a wide lamp.

Light enters and leaves by refraction, so no point on the lamp can be connected to what floats within: the lamp is wide,
and found by directions.
"""

from __future__ import annotations

from typing import Any

from .gallery_scene import GalleryScene
from .parts import area_light, camera, diffuse, glass, rectangle, rgb, scene, sphere

WIDTH, HEIGHT = 640, 448
MAX_DEPTH = 32


def build() -> dict[str, Any]:
    """Two filled glass balls on a table: one scatters, one only absorbs."""
    milky = {
        "type": "homogeneous",
        "sigma_t": rgb(0.55, 0.7, 1.0),
        "scale": 6.0,
        "albedo": rgb(0.995, 0.985, 0.95),
        "phase": {"type": "hg", "g": 0.6},
    }
    tea = {"type": "homogeneous", "sigma_t": rgb(0.15, 0.5, 1.0), "scale": 1.8, "albedo": 0.0}
    return scene(
        camera((0.0, 2.6, 6.0), (0.0, 0.7, 0.0), 36.0, WIDTH, HEIGHT),
        MAX_DEPTH,
        {
            "table": rectangle((-9, 0, -6), (0, 0, 15), (18, 0, 0), bsdf=diffuse(0.5, 0.42, 0.34)),
            "wall": rectangle((-9, 0, -4), (18, 0, 0), (0, 9, 0), bsdf=diffuse(0.5, 0.56, 0.58)),
            "milk": sphere((-1.0, 0.902, 0.1), 0.9, bsdf=glass(1.4), interior=milky),
            "tea": sphere((1.0, 0.802, 0.0), 0.8, bsdf=glass(1.33), interior=tea),
            "lamp": rectangle((-3, 5, -2), (6, 0, 0), (0, 0, 5), emitter=area_light((1.0, 0.95, 0.86), 5.0)),
        },
        integrator="volpath",
    )


SCENE = GalleryScene(
    name="cloudy-glass",
    title="A glass of something cloudy",
    teaches="Lamps behind glass cannot be aimed at: light in the drink is found by chance, its error is the last to "
    "go.",
    width=WIDTH,
    height=HEIGHT,
    build=build,
    has_media=True,
)
