"""A polished ring and a glass ball that focus a small lamp on the table (the ring draws the nephroid of Huygens, 1690).

No technique here can aim through the ring or the glass, so only paths that leave the table by chance in the right
direction find the lamp; its radius is chosen so that about one in two hundred does.
"""

from __future__ import annotations

from typing import Any

from .gallery_scene import GalleryScene
from .parts import area_light, camera, diffuse, glass, metal, rectangle, scene, sphere, sphere_light, upright_ring

WIDTH, HEIGHT = 768, 512
MAX_DEPTH = 12
LAMP_CENTRE = (4.2, 3.3, -0.9)
LAMP_RADIUS = 0.5
LAMP_POWER = 700.0
RING_RADIUS, RING_HEIGHT = 1.15, 0.65
BALL_RADIUS = 0.62


def build() -> dict[str, Any]:
    """A gold ring, a glass ball and a mirror ball on a pale table, with a dim wide lamp overhead."""
    return scene(
        camera((0.1, 4.5, 5.4), (0.05, 0.1, -0.1), 41.5, WIDTH, HEIGHT),
        MAX_DEPTH,
        {
            "table": rectangle((-8, 0, -5), (0, 0, 14), (16, 0, 0), bsdf=diffuse(0.66, 0.6, 0.52)),
            "wall": rectangle((-8, 0, -3.2), (16, 0, 0), (0, 9, 0), bsdf=diffuse(0.32, 0.45, 0.52)),
            "ring": upright_ring((-1.05, 0.002, 0.1), RING_RADIUS, RING_HEIGHT, bsdf=metal("gold")),
            "glass-ball": sphere((1.35, BALL_RADIUS + 0.002, 0.55), BALL_RADIUS, bsdf=glass()),
            "mirror-ball": sphere((0.85, 0.36, -1.1), 0.36, bsdf=metal("silver")),
            "lamp": sphere_light(LAMP_CENTRE, LAMP_RADIUS, (1.0, 0.88, 0.7), LAMP_POWER),
            "ceiling-lamp": rectangle((-4, 7, -2), (8, 0, 0), (0, 0, 8), emitter=area_light((0.9, 0.95, 1.0), 0.5)),
        },
    )


SCENE = GalleryScene(
    name="caustic",
    title="Ring and glass caustics",
    teaches="Focused light is found only by chance: the caustics keep the largest error bars long after the rest "
    "of the table is done.",
    width=WIDTH,
    height=HEIGHT,
    build=build,
)
