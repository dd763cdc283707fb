"""A clear sky with a sun as an environment map made here: a gradient, a glow around the sun, and a sun disk larger than
the real one (some 5° instead of 0.53° across) so that paths which nothing aims find it.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from .parts import Plugin, Vector, sky, sky_directions

MAP_HEIGHT = 256
ZENITH: Vector = (0.16, 0.32, 0.68)
HORIZON: Vector = (0.72, 0.80, 0.88)
LOWEST = math.radians(-2.0)


def clear_sky(sun_direction: Vector, sun_radius: float, sun_irradiance: Vector) -> Plugin:
    """An environment emitter; sun_radius in radians, sun_irradiance on a surface that faces the sun, W·m⁻²."""
    return sky(_radiance(sun_direction, sun_radius, sun_irradiance))


def _radiance(sun_direction: Vector, sun_radius: float, sun_irradiance: Vector) -> npt.NDArray[np.float32]:
    """(H, 2H, 3)."""
    direction = sky_directions(MAP_HEIGHT)
    rise = np.clip(direction[..., 1:2], 0.0, 1.0) ** 0.5
    radiance = (1.0 - rise) * np.asarray(HORIZON) + rise * np.asarray(ZENITH)
    # A plain hides what lies below the horizon: emitter samples that went there would only make noise.
    radiance[direction[..., 1] < math.sin(LOWEST)] = 0.0
    cosine = direction @ (np.asarray(sun_direction) / np.linalg.norm(sun_direction))
    angle = np.arccos(np.clip(cosine, -1.0, 1.0))
    radiance += 0.5 * np.exp(-((angle / math.radians(18.0)) ** 2))[..., None] * np.array([1.0, 0.85, 0.6])
    # One texel of soft edge; the disk's radiance is its irradiance over its solid angle on this map.
    texel = math.pi / MAP_HEIGHT
    disk = np.clip((sun_radius - angle) / texel + 0.5, 0.0, 1.0)
    solid_angle = float(np.sum(disk * np.sqrt(1.0 - direction[..., 1] ** 2))) * texel**2
    radiance += disk[..., None] * np.asarray(sun_irradiance) / solid_angle
    return radiance.astype(np.float32)
