"""A closed furnace whose radiance is known exactly: the test of every estimator and of every error bar.

All surfaces emit Le and reflect a share ρ of what arrives, diffusely, whatever their shape. By induction over the
Neumann series of L = Le + T L, where T 1 = ρ in a closed scene, each bounce adds Le ρ^k: with paths up to
`max_depth` the radiance is the same in every pixel,

    L = Le · Σ ρ^k,  k = 0 … max_depth − 1,      L → Le / (1 − ρ).
"""

from __future__ import annotations

from typing import Any

from .gallery_scene import GalleryScene
from .parts import Vector, area_light, camera, rgb, scene, sphere

SIZE = 256
MAX_DEPTH = 8
EMITTED: Vector = (0.16, 0.16, 0.16)
ALBEDO: Vector = (0.75, 0.75, 0.75)


def expected_radiance(max_depth: int) -> Vector:
    """The radiance of every pixel, R, G, B, for paths of at most `max_depth` segments; 0 gives black."""
    red, green, blue = (
        emitted * sum(albedo**bounces for bounces in range(max_depth))
        for emitted, albedo in zip(EMITTED, ALBEDO, strict=True)
    )
    return (red, green, blue)


def build() -> dict[str, Any]:
    """A hollow sphere with the camera inside, and two balls in it that cannot be told from the wall."""
    return scene(
        camera((0.0, 0.0, 3.0), (0.0, 0.0, 0.0), 60.0, SIZE, SIZE),
        MAX_DEPTH,
        {
            "wall": sphere((0, 0, 0), 4.0, flip_normals=True, **_surface()),
            "large-ball": sphere((-0.9, -0.3, -0.5), 0.9, **_surface()),
            "small-ball": sphere((0.9, 0.4, 0.2), 0.5, **_surface()),
        },
    )


def _surface() -> dict[str, Any]:
    return {"bsdf": {"type": "diffuse", "reflectance": rgb(*ALBEDO)}, "emitter": area_light(EMITTED)}


SCENE = GalleryScene(
    name="furnace",
    title="White furnace",
    teaches="The answer is known: every pixel is Le·Σρᵏ, so the two balls vanish, and the error bars can be "
    "checked against the true error.",
    width=SIZE,
    height=SIZE,
    build=build,
)
