"""A room lit only through a door ajar (as in Veach & Guibas 1997, "Metropolis light transport"). Units are metres.

The lamp hangs in the hall behind the wall: almost every point of the room sees it only after two or more bounces.
"""

from __future__ import annotations

import math
from typing import Any

from .gallery_scene import GalleryScene
from .parts import area_light, block, camera, diffuse, metal, rectangle, scene, sphere

WIDTH, HEIGHT = 640, 480
MAX_DEPTH = 20
ROOM_X, ROOM_Y, ROOM_Z = 4.2, 2.6, 4.6
HALL_Z = -2.6
DOOR_LEFT, DOOR_RIGHT, DOOR_TOP = 1.15, 2.15, 2.1
DOOR_ANGLE = 46.0
WALL_THICKNESS = 0.12
LAMP_RADIANCE = 320.0


def build() -> dict[str, Any]:
    """The room (z > 0), the hall (z < 0), the wall between them with its doorway, and a few things to light."""
    x, y, z = ROOM_X, ROOM_Y, ROOM_Z
    white, floor = diffuse(0.8, 0.79, 0.76), diffuse(0.6, 0.47, 0.34)
    return scene(
        camera((2.5, 1.45, 4.45), (1.95, 1.0, 0.0), 62.0, WIDTH, HEIGHT),
        MAX_DEPTH,
        {
            "floor": rectangle((0, 0, HALL_Z), (0, 0, z - HALL_Z), (x, 0, 0), bsdf=floor),
            "ceiling": rectangle((0, y, HALL_Z), (x, 0, 0), (0, 0, z - HALL_Z), bsdf=white),
            "left-wall": rectangle((0, 0, HALL_Z), (0, y, 0), (0, 0, z - HALL_Z), bsdf=diffuse(0.4, 0.62, 0.66)),
            "right-wall": rectangle((x, 0, HALL_Z), (0, 0, z - HALL_Z), (0, y, 0), bsdf=diffuse(0.82, 0.58, 0.42)),
            "front-wall": rectangle((0, 0, z), (0, y, 0), (x, 0, 0), bsdf=white),
            "hall-wall": rectangle((0, 0, HALL_Z), (x, 0, 0), (0, y, 0), bsdf=diffuse(0.3, 0.26, 0.2)),
            **_doorway(),
            "hall-lamp": rectangle(
                (0.5, y - 0.02, -1.5),
                (0.7, 0, 0),
                (0, 0, 0.7),
                emitter=area_light((1.0, 0.88, 0.72), LAMP_RADIANCE),
            ),
            "table": block((2.75, 0.68, 0.55), (0, 0, 0.9), (1.1, 0, 0), (0, 0.05, 0), bsdf=diffuse(0.6, 0.45, 0.3)),
            "table-foot": block((3.2, 0, 0.9), (0, 0, 0.2), (0.2, 0, 0), (0, 0.68, 0), bsdf=diffuse(0.3, 0.25, 0.2)),
            "white-ball": sphere((3.1, 0.73 + 0.17, 0.85), 0.17, bsdf=diffuse(0.85, 0.85, 0.85)),
            "gold-ball": sphere((3.47, 0.73 + 0.13, 1.1), 0.13, bsdf=metal("gold", 0.15)),
            "box": block((0.45, 0, 0.7), (-0.15, 0, 0.5), (0.5, 0, 0.15), (0, 0.5, 0), bsdf=diffuse(0.7, 0.2, 0.15)),
        },
    )


def _doorway() -> dict[str, Any]:
    """The wall around the opening, and the door leaf turned into the room about its left edge."""
    wall, thick = diffuse(0.8, 0.79, 0.76), (0.0, 0.0, WALL_THICKNESS)
    leaf = DOOR_RIGHT - DOOR_LEFT
    cos, sin = math.cos(math.radians(DOOR_ANGLE)), math.sin(math.radians(DOOR_ANGLE))
    return {
        "wall-left": block((0, 0, -WALL_THICKNESS), (DOOR_LEFT, 0, 0), (0, ROOM_Y, 0), thick, bsdf=wall),
        "wall-right": block(
            (DOOR_RIGHT, 0, -WALL_THICKNESS), (ROOM_X - DOOR_RIGHT, 0, 0), (0, ROOM_Y, 0), thick, bsdf=wall
        ),
        "wall-above": block(
            (DOOR_LEFT, DOOR_TOP, -WALL_THICKNESS), (leaf, 0, 0), (0, ROOM_Y - DOOR_TOP, 0), thick, bsdf=wall
        ),
        "door": block(
            (DOOR_LEFT, 0, 0),
            (leaf * cos, 0, leaf * sin),
            (0, DOOR_TOP, 0),
            (-0.04 * sin, 0, 0.04 * cos),
            bsdf=diffuse(0.72, 0.68, 0.6),
        ),
        "door-knob": sphere(
            (DOOR_LEFT + 0.9 * leaf * cos - 0.09 * sin, 1.0, 0.9 * leaf * sin + 0.09 * cos),
            0.04,
            bsdf=metal("gold", 0.1),
        ),
    }


SCENE = GalleryScene(
    name="gap",
    title="A door ajar",
    teaches="Where every lamp is hidden, emitter sampling finds nothing at first hand: the room's error bars are "
    "those of light that has bounced through a gap.",
    width=WIDTH,
    height=HEIGHT,
    build=build,
)
