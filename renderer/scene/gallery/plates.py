"""Four metal plates under five lamps: when to sample the lamp and when the surface (Veach & Guibas 1995, fig. 2).

The lamps have equal power and radii in geometric progression. Each plate is tilted so that it mirrors the row of
lamps into the camera, and each is rougher than the one behind it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .gallery_scene import GalleryScene
from .parts import Vector, block, camera, diffuse, metal, rectangle, rgb, scene, sphere_light

WIDTH, HEIGHT = 768, 512
MAX_DEPTH = 6
EYE: Vector = (0.0, 2.0, 15.0)
LOOK_AT: Vector = (0.0, -2.25, 2.5)
LAMP_ROW: Vector = (0.0, 0.0, 0.0)
LAMP_POWER = 26.0
ROOM_RADIANCE: Vector = (0.25, 0.265, 0.29)
LAMP_RADII = (0.03, 0.07, 0.16, 0.37, 0.85)
LAMP_X = (-3.9, -2.25, -0.6, 1.25, 3.7)
LAMP_COLOURS: tuple[Vector, ...] = (
    (1.0, 0.62, 0.35),
    (1.0, 0.85, 0.45),
    (0.6, 1.0, 0.55),
    (0.45, 0.85, 1.0),
    (0.72, 0.6, 1.0),
)
PLATE_ROUGHNESS = (0.005, 0.02, 0.06, 0.15)
PLATE_CENTRES: tuple[Vector, ...] = ((0.0, -2.3, 0.4), (0.0, -2.95, 1.8), (0.0, -3.45, 3.2), (0.0, -3.8, 4.6))
PLATE_WIDTH, PLATE_LENGTH, PLATE_THICKNESS = 7.6, 1.05, 0.06
FLOOR_Y, WALL_Z = -4.4, -3.0


def build() -> dict[str, Any]:
    """The plates in front of a grey wall, in a dim room."""
    grey = diffuse(0.42, 0.42, 0.44)
    contents = {
        "floor": rectangle((-14, FLOOR_Y, WALL_Z), (0, 0, 20), (28, 0, 0), bsdf=grey),
        "wall": rectangle((-14, FLOOR_Y, WALL_Z), (28, 0, 0), (0, 16, 0), bsdf=grey),
        "room": {"type": "constant", "radiance": rgb(*ROOM_RADIANCE)},
    }
    for index, (x, radius, colour) in enumerate(zip(LAMP_X, LAMP_RADII, LAMP_COLOURS, strict=True)):
        contents[f"lamp-{index + 1}"] = sphere_light((x, LAMP_ROW[1], LAMP_ROW[2]), radius, colour, LAMP_POWER)
    for index, (centre, alpha) in enumerate(zip(PLATE_CENTRES, PLATE_ROUGHNESS, strict=True)):
        contents[f"plate-{index + 1}"] = _plate(centre, alpha)
    return scene(camera(EYE, LOOK_AT, 38.0, WIDTH, HEIGHT), MAX_DEPTH, contents)


def _plate(centre: Vector, alpha: float) -> dict[str, Any]:
    """A plate whose normal is the half vector between the camera and the row of lamps."""
    middle = np.asarray(centre)
    to_eye, to_lamps = (
        direction / np.linalg.norm(direction) for direction in (np.asarray(EYE) - middle, np.asarray(LAMP_ROW) - middle)
    )
    up = (to_eye + to_lamps) / np.linalg.norm(to_eye + to_lamps)
    across = np.array([PLATE_WIDTH, 0.0, 0.0])
    along = np.cross([1.0, 0.0, 0.0], up) * PLATE_LENGTH  # towards the camera
    thick = up * PLATE_THICKNESS
    corner = middle - (across + along) / 2 - thick
    return block(_vector(corner), _vector(along), _vector(across), _vector(thick), bsdf=metal("aluminium", alpha))


def _vector(array: Any) -> Vector:
    x, y, z = (float(value) for value in array)
    return (x, y, z)


SCENE = GalleryScene(
    name="plates",
    title="Four plates, five lamps",
    teaches="No single technique wins: small lamps on rough plates want emitter sampling, large lamps on polished "
    "plates want BSDF sampling, and `mis` takes the better of both everywhere.",
    width=WIDTH,
    height=HEIGHT,
    build=build,
)
