"""The plainest estimator of the rendering equation, kept to be read and to test the kernel against.

BSDF sampling only, no roulette, independent random numbers, one sample a lane, no tricks:

    ⟨L(p, ωo)⟩ = Le(p, ωo) + f(p, ωi, ωo) cosθi / pdf(ωi) · ⟨L(r(p, ωi), −ωi)⟩      ωi drawn from the BSDF

It sees no point, spot or directional light, which no direction can hit, and it ignores the reconstruction filter.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from renderer.backend import mitsuba

mi: Any = mitsuba()


@dr.syntax
def sample_radiance(scene: Any, ray: Any, rng: Any, max_depth: int) -> Any:
    """One sample of the radiance along each ray, for paths of at most max_depth segments."""
    radiance = mi.Spectrum(0)
    throughput = mi.Spectrum(1)
    depth = mi.UInt32(0)
    active = mi.Bool(True)
    while active:
        si = scene.ray_intersect(ray, active)
        radiance[active] = radiance + throughput * si.emitter(scene).eval(si, active)

        active &= si.is_valid() & (depth + 1 < max_depth)
        u1, u2, u3 = rng.next_float32(), rng.next_float32(), rng.next_float32()
        bs, weight = si.bsdf().sample(mi.BSDFContext(), si, u1, mi.Point2f(u2, u3), active)
        throughput[active] = throughput * weight
        active &= dr.any(throughput != 0)
        ray = si.spawn_ray(si.to_world(bs.wo))
        depth += 1
    return radiance


def render(scene: Any, sensor: Any, spp: int, max_depth: int, seed: int) -> tuple[NDArray, NDArray]:
    """Mean radiance (H, W, 3) and its variance of the mean, through a box filter. RGB variants only."""
    width, height = (int(n) for n in sensor.film().crop_size())
    lane = dr.arange(mi.UInt32, width * height * spp)
    pixel = lane // spp
    rng = mi.PCG32(size=width * height * spp, initstate=seed)
    jitter = mi.Point2f(rng.next_float32(), rng.next_float32())
    position = (mi.Point2f(mi.Float(pixel % width), mi.Float(pixel // width)) + jitter) / mi.Vector2f(width, height)
    lens = mi.Point2f(rng.next_float32(), rng.next_float32())
    ray, weight = sensor.sample_ray(sensor.shutter_open(), rng.next_float32(), position, lens)
    radiance = weight * sample_radiance(scene, ray, rng, max_depth)
    samples = np.array(radiance, dtype=np.float64).T.reshape(height, width, spp, 3)
    return samples.mean(axis=2), samples.var(axis=2, ddof=1) / spp
