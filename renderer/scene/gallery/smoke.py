"""Coloured smoke: a plume from a grid that is made in code, in the light of a sun and a sky.

The density is a rising column with a turbulent edge (sums of value noise in octaves; Perlin 1985), the albedo turns
from orange at the foot to blue at the top. A grid has no closed form: its collisions are found by trial.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderer.backend import mitsuba

from .gallery_scene import GalleryScene
from .parts import camera, diffuse, rectangle, rgb, scene, sphere

WIDTH, HEIGHT = 512, 640
MAX_DEPTH = 24
ACROSS, UP = 48, 72  # voxels
SIZE, TALL = 2.4, 3.6  # of the grid, in units of length
EXTINCTION = 9.0  # at most, per unit of length
OCTAVES, SEED = 4, 7


def build() -> dict[str, Any]:
    """A plume above a plate, a dark ball behind it, a low sun and a pale sky."""
    mi = mitsuba()

    density, albedo = plume()
    to_world = mi.ScalarTransform4f().translate([-SIZE / 2, 0.02, -SIZE / 2]).scale([SIZE, TALL, SIZE])

    def grid(values: NDArray[np.float32]) -> dict[str, Any]:
        return {"type": "gridvolume", "grid": mi.VolumeGrid(values), "to_world": to_world, "raw": True}

    smoke = {
        "type": "heterogeneous",
        "sigma_t": grid(density),
        "albedo": grid(albedo),
        "scale": EXTINCTION,
        "phase": {"type": "hg", "g": 0.3},
    }
    box = {
        "type": "cube",
        "to_world": mi.ScalarTransform4f().translate([0, TALL / 2 + 0.02, 0]).scale([SIZE / 2, TALL / 2, SIZE / 2]),
        "bsdf": {"type": "null"},
        "interior": smoke,
    }
    sun = {"type": "directional", "direction": [0.75, -0.6, -0.5], "irradiance": rgb(4.5, 3.8, 2.9)}
    return scene(
        camera((0.0, 1.7, 7.0), (0.0, 1.75, 0.0), 33.0, WIDTH, HEIGHT),
        MAX_DEPTH,
        {
            "ground": rectangle((-30, 0, -30), (0, 0, 60), (60, 0, 0), bsdf=diffuse(0.3, 0.3, 0.28)),
            "ball": sphere((1.15, 0.45, -0.9), 0.45, bsdf=diffuse(0.12, 0.13, 0.16)),
            "smoke": box,
            "sun": sun,
            "sky": {"type": "constant", "radiance": rgb(0.32, 0.42, 0.58)},
        },
        integrator="volpath",
    )


def plume() -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Density (z, y, x, 1) in 0 … 1 and albedo (z, y, x, 3) of the smoke; y is up."""
    z, y, x = np.meshgrid(*((np.arange(n) + 0.5) / n for n in (ACROSS, UP, ACROSS)), indexing="ij")
    rng = np.random.default_rng(SEED)
    noise = sum(_noise(rng, 4 * 2**i, z.shape) / 2**i for i in range(OCTAVES))
    # The column sways and widens as it rises, and fades at its top and at the borders of the grid.
    away = np.hypot(x - 0.5 - 0.09 * np.sin(5.5 * y), z - 0.5 - 0.07 * np.cos(4.5 * y)) / (0.11 + 0.24 * y)
    body = np.clip(1.25 - away + 0.85 * (noise - 0.9), 0, 1) ** 1.5
    body *= np.clip((1 - y) / 0.3, 0, 1) * np.clip((0.5 - np.maximum(np.abs(x - 0.5), np.abs(z - 0.5))) / 0.06, 0, 1)
    low, high = np.array([0.98, 0.72, 0.42]), np.array([0.62, 0.78, 0.98])
    mixed = np.clip(y * 1.2, 0, 1)[..., None]
    density = (body / body.max())[..., None]
    return density.astype(np.float32), ((1 - mixed) * low + mixed * high).astype(np.float32)


def _noise(rng: np.random.Generator, cells: int, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Random values on a lattice of that many cells, interpolated smoothly to a grid of this shape."""
    values = rng.random((cells + 1,) * 3)
    for axis, n in enumerate(shape):
        at = (np.arange(n) + 0.5) / n * cells
        low = np.minimum(at.astype(int), cells - 1)
        t = at - low
        t = (t * t * (3 - 2 * t)).reshape([-1 if a == axis else 1 for a in range(3)])
        values = (1 - t) * np.take(values, low, axis) + t * np.take(values, low + 1, axis)
    return values


SCENE = GalleryScene(
    name="smoke",
    title="Coloured smoke",
    teaches="Smoke is a grid of densities: light finds its way by trial, and the thick middle costs more samples than "
    "the thin edge.",
    width=WIDTH,
    height=HEIGHT,
    build=build,
    has_media=True,
)
