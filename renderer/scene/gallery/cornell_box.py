"""The Cornell box, from its measurements (Goral et al. 1984; Cornell University, Program of Computer Graphics).

Units are millimetres. The measured walls are up to 6 mm out of square and the ceiling has a hole for the lamp;
here the room is square and the lamp hangs 0.5 mm below the ceiling. Reflectances are the usual linear sRGB
approximations of the measured spectra.
"""

from __future__ import annotations

import math
from typing import Any

from .gallery_scene import GalleryScene
from .parts import area_light, block, camera, diffuse, rectangle, rgb, scene

SIZE = 512
MAX_DEPTH = 12
WIDTH_X, HEIGHT_Y, DEPTH_Z = 552.8, 548.8, 559.2
WHITE, RED, GREEN = (0.725, 0.71, 0.68), (0.63, 0.065, 0.05), (0.14, 0.45, 0.091)
LAMP_REFLECTANCE = 0.78
# The usual approximation of the published spectrum, which is relative, doubled to fill the tonal range.
LAMP_RADIANCE = (36.8, 28.0, 13.5)
LAMP_DROP = 0.5
# The published camera (35 mm lens, 25 × 25 mm film, 39.3°), cropped so that the box's opening fills the film.
EYE_DISTANCE, EYE_X, EYE_Y = 800.0, 278.0, 273.0
FOV = math.degrees(2.0 * math.atan((EYE_Y - 1.0) / EYE_DISTANCE))


def build() -> dict[str, Any]:
    """Two white blocks in a room with one red and one green wall, lit by a lamp in the ceiling."""
    x, y, z = WIDTH_X, HEIGHT_Y, DEPTH_Z
    white = diffuse(*WHITE)
    lamp = {"type": "diffuse", "reflectance": rgb(LAMP_REFLECTANCE, LAMP_REFLECTANCE, LAMP_REFLECTANCE)}
    return scene(
        camera((EYE_X, EYE_Y, -EYE_DISTANCE), (EYE_X, EYE_Y, 0), FOV, SIZE, SIZE),
        MAX_DEPTH,
        {
            "floor": rectangle((0, 0, 0), (0, 0, z), (x, 0, 0), bsdf=white),
            "ceiling": rectangle((0, y, 0), (x, 0, 0), (0, 0, z), bsdf=white),
            "back-wall": rectangle((0, 0, z), (0, y, 0), (x, 0, 0), bsdf=white),
            "left-wall": rectangle((x, 0, 0), (0, 0, z), (0, y, 0), bsdf=diffuse(*RED)),
            "right-wall": rectangle((0, 0, 0), (0, y, 0), (0, 0, z), bsdf=diffuse(*GREEN)),
            # Published corners; the fourth one of each block is within 3 mm of the parallelogram's.
            "short-block": block((130, 0, 65), (160, 0, 49), (0, 165, 0), (-48, 0, 160), bsdf=white),
            "tall-block": block((423, 0, 247), (49, 0, 159), (0, 330, 0), (-158, 0, 49), bsdf=white),
            "ceiling-lamp": rectangle(
                (213, y - LAMP_DROP, 227),
                (130, 0, 0),
                (0, 0, 105),
                bsdf=lamp,
                emitter=area_light(LAMP_RADIANCE),
            ),
        },
    )


SCENE = GalleryScene(
    name="cornell-box",
    title="Cornell box",
    teaches="Light bounces: red and green walls colour the white blocks, and the error is largest where "
    "light arrives only indirectly.",
    width=SIZE,
    height=SIZE,
    build=build,
)
