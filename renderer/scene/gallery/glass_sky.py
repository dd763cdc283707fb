"""Glass balls on a plain under a clear sky: nearly all is easy, and the error sits in a few bright spots."""

from __future__ import annotations

import math
from typing import Any

from .clear_sky import clear_sky
from .gallery_scene import GalleryScene
from .parts import Vector, camera, diffuse, glass, glazed, metal, rectangle, scene, sphere

WIDTH, HEIGHT = 768, 512
MAX_DEPTH = 12
SUN_DIRECTION: Vector = (-0.62, 0.62, -0.48)
SUN_RADIUS = math.radians(2.5)
SUN_IRRADIANCE: Vector = (2.9, 2.5, 1.95)


def build() -> dict[str, Any]:
    """Three glass balls, a copper one and a glazed one, with the sun behind them."""
    return scene(
        camera((0.3, 1.6, 5.9), (0.05, 0.62, 0.0), 45.0, WIDTH, HEIGHT),
        MAX_DEPTH,
        {
            "sky": clear_sky(SUN_DIRECTION, SUN_RADIUS, SUN_IRRADIANCE),
            "plain": rectangle((-60, 0, -60), (0, 0, 120), (120, 0, 0), bsdf=diffuse(0.46, 0.41, 0.33)),
            "large-glass": sphere((-0.35, 0.85, 0.0), 0.85, bsdf=glass()),
            "small-glass": sphere((1.15, 0.42, 1.0), 0.42, bsdf=glass()),
            "far-glass": sphere((1.5, 0.6, -1.9), 0.6, bsdf=glass()),
            "copper": sphere((-2.0, 0.5, -0.9), 0.5, bsdf=metal("copper", 0.12)),
            "glazed": sphere((-1.35, 0.3, 1.15), 0.3, bsdf=glazed((0.04, 0.2, 0.3))),
        },
    )


SCENE = GalleryScene(
    name="glass-sky",
    title="Glass under the sky",
    teaches="Error is local: sky and plain are done at once, while the spots where glass gathers the sun take the "
    "samples.",
    width=WIDTH,
    height=HEIGHT,
    build=build,
)
