"""Metals, plastics and glass of rising roughness in a photographer's studio (Walter et al. 2007 for the microfacets).

The studio is an environment map made here: a grey gradient, two softboxes and a strip light.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from .gallery_scene import GalleryScene
from .parts import Vector, camera, diffuse, glass, metal, rectangle, rgb, scene, sky, sky_directions, sphere

WIDTH, HEIGHT = 768, 512
MAX_DEPTH = 12
MAP_HEIGHT = 128
BALL_RADIUS = 0.5
SPACING, ROW_SPACING = 1.16, 1.5
# Softboxes: direction to the centre, half widths across and upwards (as tangents), radiance.
SOFTBOXES: tuple[tuple[Vector, float, float, Vector], ...] = (
    ((-0.8, 0.75, 0.55), 0.5, 0.38, (9.0, 8.6, 8.0)),
    ((0.95, 0.55, 0.25), 0.16, 0.75, (6.0, 6.6, 7.6)),
    ((0.1, 0.45, -1.0), 0.9, 0.1, (5.0, 4.6, 4.2)),
)


def build() -> dict[str, Any]:
    """Three rows of four balls on a grey floor: metals at the back, plastics, and glass in front."""
    contents: dict[str, Any] = {
        "studio": sky(_studio()),
        "floor": rectangle((-30, 0, -30), (0, 0, 60), (60, 0, 0), bsdf=diffuse(0.27, 0.25, 0.23)),
    }
    for row, bsdfs in enumerate((_metals(), _plastics(), _glasses())):
        for column, bsdf in enumerate(bsdfs):
            centre = ((column - 1.5) * SPACING, BALL_RADIUS + 1e-3, (row - 1.0) * ROW_SPACING)
            contents[f"ball-{row + 1}-{column + 1}"] = sphere(centre, BALL_RADIUS, bsdf=bsdf)
    return scene(camera((0.0, 4.9, 6.6), (0.0, 0.35, 0.1), 39.5, WIDTH, HEIGHT), MAX_DEPTH, contents)


def _metals() -> list[dict[str, Any]]:
    return [metal("gold"), metal("copper", 0.08), metal("silver", 0.2), metal("gold", 0.4)]


def _plastics() -> list[dict[str, Any]]:
    colours = ((0.65, 0.06, 0.05), (0.8, 0.36, 0.05), (0.05, 0.36, 0.3), (0.07, 0.13, 0.5))
    roughnesses = (0.0, 0.08, 0.2, 0.4)
    return [_plastic(colour, alpha) for colour, alpha in zip(colours, roughnesses, strict=True)]


def _plastic(colour: Vector, alpha: float) -> dict[str, Any]:
    plastic: dict[str, Any] = {"type": "plastic", "diffuse_reflectance": rgb(*colour), "nonlinear": True}
    if alpha > 0.0:
        plastic |= {"type": "roughplastic", "distribution": "ggx", "alpha": alpha}
    return plastic


def _glasses() -> list[dict[str, Any]]:
    rough = {"type": "roughdielectric", "distribution": "ggx", "int_ior": 1.5, "ext_ior": 1.0}
    return [glass(), rough | {"alpha": 0.08}, rough | {"alpha": 0.2}, rough | {"alpha": 0.4}]


def _studio() -> npt.NDArray[np.float32]:
    """Radiance (H, 2H, 3) of the studio: brighter towards the zenith, softboxes with soft edges."""
    direction = sky_directions(MAP_HEIGHT)
    rise = np.clip(direction[..., 1:2], 0.0, 1.0)
    radiance = 0.2 + 0.3 * rise * np.array([0.9, 0.97, 1.1])
    for centre, half_width, half_height, colour in SOFTBOXES:
        radiance += _softbox(direction, centre, half_width, half_height)[..., None] * np.asarray(colour)
    return radiance.astype(np.float32)


def _softbox(
    direction: npt.NDArray[np.float64], centre: Vector, half_width: float, half_height: float
) -> npt.NDArray[np.float64]:
    """Coverage 0 … 1 (H, W) of a rectangle in the tangent plane at `centre`."""
    axis = np.asarray(centre) / np.linalg.norm(centre)
    across = np.cross([0.0, 1.0, 0.0], axis)
    across /= np.linalg.norm(across)
    facing = direction @ axis
    depth = np.maximum(facing, 1e-6)
    u, v = np.abs(direction @ across) / depth, np.abs(direction @ np.cross(axis, across)) / depth
    edge = 0.04
    inside = np.clip((half_width - u) / edge, 0, 1) * np.clip((half_height - v) / edge, 0, 1)
    return np.where(facing > 0.0, inside, 0.0)


SCENE = GalleryScene(
    name="materials",
    title="Rough and polished",
    teaches="Roughness decides the cost: polished balls copy the studio almost without error, rough ones average "
    "over it, and rough glass averages twice.",
    width=WIDTH,
    height=HEIGHT,
    build=build,
)
