"""A ring in the sun, polished inside: a caustic under a sky, and hardly any error but there.

The ring is gold inside and enamelled outside, so the sunlight that it gathers stays in it (compare glass-sky, whose
balls reflect the sun all over the plain). No technique here can aim at the sun by way of a mirror, but the disk is wide
enough for one path in some hundreds to find it.
"""

from __future__ import annotations

import math
from typing import Any

from .clear_sky import clear_sky
from .gallery_scene import GalleryScene
from .parts import Vector, camera, diffuse, glazed, metal, rectangle, rgb, scene, sphere, upright_ring

WIDTH, HEIGHT = 768, 512
MAX_DEPTH = 12
SUN_DIRECTION: Vector = (-0.6, 0.5, 0.5)
SUN_RADIUS = math.radians(2.5)
SUN_IRRADIANCE: Vector = (2.9, 2.5, 1.95)
RING_RADIUS, RING_HEIGHT = 1.1, 0.5


def build() -> dict[str, Any]:
    """A low ring on a plain, two matt balls and a glazed one around it."""
    return scene(
        camera((0.2, 3.6, 5.0), (0.05, 0.2, -0.1), 40.0, WIDTH, HEIGHT),
        MAX_DEPTH,
        {
            "sky": clear_sky(SUN_DIRECTION, SUN_RADIUS, SUN_IRRADIANCE),
            "plain": rectangle((-60, 0, -60), (0, 0, 120), (120, 0, 0), bsdf=diffuse(0.46, 0.41, 0.33)),
            "ring": upright_ring((-0.2, 0, 0), RING_RADIUS, RING_HEIGHT, bsdf=_lined((0.2, 0.22, 0.25), "gold")),
            "terracotta": sphere((1.75, 0.5, -0.9), 0.5, bsdf=diffuse(0.55, 0.25, 0.15)),
            "chalk": sphere((-1.75, 0.35, -1.2), 0.35, bsdf=diffuse(0.6, 0.6, 0.55)),
            "glazed": sphere((1.45, 0.3, 0.95), 0.3, bsdf=glazed((0.04, 0.2, 0.3))),
        },
    )


def _lined(outside: Vector, inside: str) -> dict[str, Any]:
    """Matt on the side that a shape faces, a polished metal on the other."""
    matt = {"type": "diffuse", "reflectance": rgb(*outside)}
    return {"type": "twosided", "outside": matt, "inside": metal(inside)["bsdf"]}


SCENE = GalleryScene(
    name="ring-sky",
    title="Ring in the sun",
    teaches="Error is local: all is done at once but the caustic in the ring, and adaptive sampling goes there.",
    width=WIDTH,
    height=HEIGHT,
    build=build,
)
