"""Glass balls on a plain under a clear sky: nearly all is easy, and the error sits in a few bright spots.

The sky is an environment map made here: a gradient, a glow around the sun, and a sun disk larger than the real one
(5° instead of 0.53° across) so that paths through the glass find it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from .gallery_scene import GalleryScene
from .parts import Vector, camera, diffuse, glass, metal, rectangle, rgb, scene, sky, sky_directions, sphere

WIDTH, HEIGHT = 768, 512
MAX_DEPTH = 12
MAP_HEIGHT = 256
SUN_DIRECTION: Vector = (-0.62, 0.62, -0.48)
SUN_RADIUS = math.radians(2.5)
SUN_IRRADIANCE: Vector = (2.9, 2.5, 1.95)
ZENITH: Vector = (0.16, 0.32, 0.68)
HORIZON: Vector = (0.72, 0.80, 0.88)


def build() -> dict[str, Any]:
    """Three glass balls, a copper one and a glazed one, with the sun behind them."""
    return scene(
        camera((0.3, 1.6, 5.9), (0.05, 0.62, 0.0), 45.0, WIDTH, HEIGHT),
        MAX_DEPTH,
        {
            "sky": sky(_sky()),
            "plain": rectangle((-60, 0, -60), (0, 0, 120), (120, 0, 0), bsdf=diffuse(0.46, 0.41, 0.33)),
            "large-glass": sphere((-0.35, 0.85, 0.0), 0.85, bsdf=glass()),
            "small-glass": sphere((1.15, 0.42, 1.0), 0.42, bsdf=glass()),
            "far-glass": sphere((1.5, 0.6, -1.9), 0.6, bsdf=glass()),
            "copper": sphere((-2.0, 0.5, -0.9), 0.5, bsdf=metal("copper", 0.12)),
            "glazed": sphere((-1.35, 0.3, 1.15), 0.3, bsdf=_glazed((0.04, 0.2, 0.3))),
        },
    )


def _glazed(colour: Vector) -> dict[str, Any]:
    return {"type": "roughplastic", "distribution": "ggx", "alpha": 0.1, "diffuse_reflectance": rgb(*colour)}


def _sky() -> npt.NDArray[np.float32]:
    """Radiance (H, 2H, 3) of the sky; the sun's irradiance on a surface facing it is SUN_IRRADIANCE."""
    direction = sky_directions(MAP_HEIGHT)
    rise = np.clip(direction[..., 1:2], 0.0, 1.0) ** 0.5
    radiance = (1.0 - rise) * np.asarray(HORIZON) + rise * np.asarray(ZENITH)
    cosine = direction @ (np.asarray(SUN_DIRECTION) / np.linalg.norm(SUN_DIRECTION))
    angle = np.arccos(np.clip(cosine, -1.0, 1.0))
    radiance += 0.5 * np.exp(-((angle / math.radians(18.0)) ** 2))[..., None] * np.array([1.0, 0.85, 0.6])
    # One texel of soft edge; the disk's radiance is its irradiance over its solid angle on this map.
    texel = math.pi / MAP_HEIGHT
    disk = np.clip((SUN_RADIUS - angle) / texel + 0.5, 0.0, 1.0)
    solid_angle = float(np.sum(disk * np.sqrt(1.0 - direction[..., 1] ** 2))) * texel**2
    radiance += disk[..., None] * np.asarray(SUN_IRRADIANCE) / solid_angle
    return radiance.astype(np.float32)


SCENE = GalleryScene(
    name="glass-sky",
    title="Glass under the sky",
    teaches="Error is local: sky and plain are done at once, while the spots where glass gathers the sun take the "
    "samples.",
    width=WIDTH,
    height=HEIGHT,
    build=build,
)
