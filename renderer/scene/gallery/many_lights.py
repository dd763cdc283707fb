"""A hall with forty coloured lamps of very unequal power (Shirley, Wang & Zimmerman 1996 on choosing among lights).

Lamps are spread by a Kronecker sequence, their powers over two and a half decades; the order of both is unrelated.
"""

from __future__ import annotations

import colorsys
import math
from typing import Any

from renderer.backend import mitsuba

from .gallery_scene import GalleryScene
from .parts import Vector, block, camera, diffuse, metal, rectangle, scene, sphere, sphere_light

WIDTH, HEIGHT = 768, 512
MAX_DEPTH = 10
LAMP_COUNT = 40
LAMP_RADIUS = 0.08
POWER_LOW, POWER_HIGH = 0.2, 60.0
HALL_X, HALL_Y, HALL_Z = 10.0, 4.4, 12.0
# The plastic number's reciprocals: the most even two-dimensional Kronecker sequence (Roberts 2018).
STEP = (0.7548776662466927, 0.5698402909980532)
GOLDEN = 0.6180339887498949


def build() -> dict[str, Any]:
    """Pillars, balls and plinths under lamps hung at many heights."""
    x, y, z = HALL_X, HALL_Y, HALL_Z
    wall, pillar = diffuse(0.72, 0.7, 0.68), diffuse(0.66, 0.66, 0.7)
    contents: dict[str, Any] = {
        "floor": rectangle((-x / 2, 0, -z / 2), (0, 0, z), (x, 0, 0), bsdf=_floor()),
        "ceiling": rectangle((-x / 2, y, -z / 2), (x, 0, 0), (0, 0, z), bsdf=wall),
        "back-wall": rectangle((-x / 2, 0, -z / 2), (x, 0, 0), (0, y, 0), bsdf=wall),
        "front-wall": rectangle((-x / 2, 0, z / 2), (0, y, 0), (x, 0, 0), bsdf=wall),
        "left-wall": rectangle((-x / 2, 0, -z / 2), (0, y, 0), (0, 0, z), bsdf=wall),
        "right-wall": rectangle((x / 2, 0, -z / 2), (0, 0, z), (0, y, 0), bsdf=wall),
        "chrome-ball": sphere((-0.9, 0.75, -1.2), 0.75, bsdf=metal("silver", 0.05)),
        "white-ball": sphere((1.15, 0.5, 0.1), 0.5, bsdf=diffuse(0.8, 0.8, 0.8)),
        "plinth": block((0.6, 0, -3.4), (0, 0, 0.9), (0.9, 0, 0), (0, 0.9, 0), bsdf=wall),
        "gold-ball": sphere((1.05, 0.9 + 0.42, -2.95), 0.42, bsdf=metal("gold", 0.2)),
    }
    for row, depth in enumerate((-4.0, -1.5, 1.0)):
        for side in (-1.0, 1.0):
            corner = (side * 3.1 - 0.25, 0.0, depth - 0.25)
            contents[f"pillar-{row + 1}-{'left' if side < 0 else 'right'}"] = block(
                corner, (0, 0, 0.5), (0.5, 0, 0), (0, y, 0), bsdf=pillar
            )
    for index in range(LAMP_COUNT):
        contents[f"lamp-{index + 1:02d}"] = _lamp(index)
    return scene(camera((0.0, 1.9, 5.6), (0.0, 1.55, -2.0), 66.0, WIDTH, HEIGHT), MAX_DEPTH, contents)


def _floor() -> dict[str, Any]:
    """A floor of large tiles; Mitsuba's checkerboard needs no file."""
    mi = mitsuba()

    tiles = {
        "type": "checkerboard",
        "color0": {"type": "rgb", "value": [0.55, 0.53, 0.5]},
        "color1": {"type": "rgb", "value": [0.3, 0.3, 0.32]},
        "to_uv": mi.ScalarTransform4f().scale([6, 5, 1]),
    }
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": tiles}}


def _lamp(index: int) -> dict[str, Any]:
    """Lamp number `index`: place from the Kronecker sequence, colour and power from shuffled ranks."""
    along, across = (math.modf((index + 1) * step)[0] for step in STEP)
    height = math.modf((index + 1) * GOLDEN)[0]
    centre: Vector = (
        (across - 0.5) * 0.86 * HALL_X,
        1.7 + 2.3 * height,
        -0.46 * HALL_Z + along * 0.74 * HALL_Z,
    )
    rank = (index * 17 + 5) % LAMP_COUNT / (LAMP_COUNT - 1)
    power = POWER_LOW * (POWER_HIGH / POWER_LOW) ** rank
    colour = colorsys.hsv_to_rgb(math.modf(index * GOLDEN)[0], 0.85, 1.0)
    return sphere_light(centre, LAMP_RADIUS, colour, power)


SCENE = GalleryScene(
    name="many-lights",
    title="Forty lamps",
    teaches="Which lamp to ask matters: choosing among forty unequal lamps by their power, not evenly, buys several "
    "times the speed.",
    width=WIDTH,
    height=HEIGHT,
    build=build,
)
