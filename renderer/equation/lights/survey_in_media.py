"""The survey of lights in scenes with participating media: points on surfaces and in media, and what they see of lights
through borders that let light pass.

As `survey.py`, whose walks take borders for walls. Here a path goes through them, and in a medium it leaves a point on
each of its ways, drawn by the medium's majorant within the way's length; every other time it is scattered there, all
ways alike. Points in media have no normal. What a medium takes away between a point and a light is left out.
"""

from __future__ import annotations

from typing import Any

import drjit
import numpy as np

from renderer.backend import mitsuba
from renderer.equation.mueller import intensity
from renderer.equation.sequence import Sequence

dr: Any = drjit
mi: Any = mitsuba()

STEPS = 6  # of a path, borders included
NO_MEDIUM = 0
SURFACE, PASSED, WITHIN = 1, 2, 3  # a point where light is reflected; where it may pass, too; in a medium


def points(scene: Any, sensor: Any, walks: int, seed: int, start: Any, time: float) -> tuple[Any, ...]:
    """Points (n, 3), normals (n, 3) on the side they are seen from, or 0 in media, and what they are (n,).

    start: where on the film each of the walks begins.
    """
    found = _walk(scene, sensor, dr.arange(mi.UInt32, walks), dr.opaque(mi.UInt32, walks), seed, start, time)
    dr.eval(found)
    p, n, kind = (np.array(values) for values in found)
    p, n, kind = p.reshape(-1, 3).astype(np.float64), n.reshape(-1, 3).astype(np.float64), kind.astype(np.int64)
    good = (kind > 0) & np.isfinite(p).all(axis=1) & np.isfinite(n).all(axis=1)
    return p[good], n[good], kind[good]


@dr.syntax
def _walk(scene: Any, sensor: Any, lane: Any, walks: Any, seed: int, start: Any, time: float) -> Any:
    sequence = Sequence(
        mi, *Sequence.keys(mi.UInt32(seed), mi.UInt32(0), lane, mi.UInt32(0)), mi.UInt32(1), stratified=False
    )
    zero = mi.UInt32(0)
    ray, _ = sensor.sample_ray(time, sequence.point(zero, 0).x, start, sequence.point(zero, 1), True)
    slots = dr.width(lane) * 2 * STEPS
    p, n, kind = dr.zeros(mi.Float, slots * 3), dr.zeros(mi.Float, slots * 3), dr.zeros(mi.UInt32, slots)
    step = mi.UInt32(0)
    origin, direction, wavelengths = mi.Point3f(ray.o), mi.Vector3f(ray.d), ray.wavelengths
    own = sensor.get_medium()
    medium = mi.UInt32(NO_MEDIUM)
    if dr.hint(own is not None, mode="scalar"):
        medium = mi.UInt32(dr.reinterpret_array(mi.UInt32, mi.MediumPtr(own)))
    active = mi.Bool(True)
    while dr.hint(active, label="survey in media"):
        way = mi.Ray3f(origin, direction, time, wavelengths)
        si = scene.ray_intersect(way, mi.RayFlags.All, False, active)
        u_way = sequence.point(zero, 3 * step + 2)
        slot = 2 * (lane * STEPS + step)

        # In a medium, a point on the way.
        is_within = active & (medium != NO_MEDIUM)
        at = dr.zeros(mi.MediumInteraction3f)
        at.p, at.wi, at.time, at.wavelengths = origin, -direction, time, wavelengths
        at.sh_frame = mi.Frame3f(-direction)
        asked = dr.reinterpret_array(mi.MediumPtr, medium)
        rate = dr.max(mi.Spectrum(asked.get_majorant(at, is_within)))
        is_met, near, far = asked.intersect_aabb(way)
        even = asked.is_homogeneous()
        near = dr.select(even | ~is_met, 0, dr.maximum(near, 0))
        far = dr.select(even | ~is_met, dr.inf, far)
        far = dr.minimum(far, dr.select(si.is_valid(), si.t, dr.inf))
        passes = dr.exp(-rate * (far - near))
        is_within &= (rate > 0) & (far > near) & (passes < 1)
        t = near - dr.log(1 - u_way.x * (1 - passes)) / rate
        is_within &= dr.isfinite(t)
        place = dr.fma(direction, t, origin)
        is_scattered = is_within & (u_way.y < 0.5)
        for i in range(3):
            dr.scatter(p, place[i], slot * 3 + i, is_within)
        dr.scatter(kind, mi.UInt32(WITHIN), slot, is_within)

        # At the end of the way, the surface.
        at_surface = active & si.is_valid() & ~is_scattered
        bsdf = si.bsdf()
        is_smooth = at_surface & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)
        facing = dr.select(dr.dot(si.n, direction) > 0, -si.n, si.n)
        for i in range(3):
            dr.scatter(p, si.p[i], slot * 3 + 3 + i, is_smooth)
            dr.scatter(n, facing[i], slot * 3 + 3 + i, is_smooth)
        is_passed = mi.has_flag(bsdf.flags(), mi.BSDFFlags.Transmission)
        dr.scatter(kind, dr.select(is_passed, mi.UInt32(PASSED), SURFACE), slot + 1, is_smooth)

        u, u_direction = sequence.point(zero, 3 * step + 3), sequence.point(zero, 3 * step + 4)
        bs, weight = bsdf.sample(mi.BSDFContext(), si, u.x, u_direction, at_surface)
        active = is_scattered | (at_surface & dr.any(intensity(weight) != 0))
        onward = dr.select(is_scattered, mi.warp.square_to_uniform_sphere(u_direction), si.to_world(bs.wo))
        is_border = at_surface & si.is_medium_transition()
        behind = dr.reinterpret_array(mi.UInt32, si.target_medium(onward))
        medium = dr.select(is_border, behind, medium)
        origin = dr.select(is_scattered, place, si.spawn_ray(onward).o)
        direction = onward
        step += 1
        active &= step < STEPS
    return p, n, kind


@dr.syntax
def is_seen(scene: Any, ray: Any, active: Any) -> Any:
    """Whether nothing but borders that let light pass is on a ray."""
    ray, going, seen = mi.Ray3f(ray), mi.Bool(active), mi.Bool(active)
    met = mi.UInt32(0)
    while dr.hint(going, label="survey of borders"):
        si = scene.ray_intersect(ray, mi.RayFlags.All, False, going)
        going &= si.is_valid()
        passes = mi.has_flag(si.bsdf().flags(), mi.BSDFFlags.Null)
        seen &= ~going | passes
        met += 1
        going &= passes & (met < STEPS)
        left = ray.maxt - si.t
        ray = si.spawn_ray(ray.d)
        ray.maxt = left
    return seen
