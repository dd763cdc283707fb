"""The direct light at one point, as an integral over directions and as one over the points of the lights.

    ∫ f Le(r(p, ω), −ω) cosθ dω  =  ∫ f Le(p′, −ω) V(p, p′) G(p, p′) dA
    G = cosθ cosθ′ / |p′ − p|²      dω = cosθ′ dA / |p′ − p|²

Enters: a lesson's pixel. Leaves: points on the lights, drawn as technique `emitter` draws them, with each factor of the
integrand of the area form, and the density that they were drawn with, by area and by solid angle.
Source: Kajiya 1986; Veach 1997, section 8.2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from renderer.backend import mitsuba
from renderer.equation.lights.sampler import EmitterSampler
from renderer.equation.lights.scene_lights import lights_of
from renderer.equation.path import PathKernel
from renderer.equation.sequence import Sequence
from renderer.lesson.pixel import Lesson

mi: Any = mitsuba()
Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class LightPoints:
    """n points on lights, lengths in units of the scene as it was written.

    position: (n, 3), of the rendered scene; nan where the light is infinitely far. has_area: whether the light is a
    surface, with an area form at all; not so skies, points and directions. distance, cos_theta (at p), cos_light (at
    p′): (n,). geometry: G, in 1 / length². is_visible: V. f: luminance of the BSDF. emitted: luminance of Le. pdf: per
    solid angle; pdf_area: per area. estimate: luminance of f Le V cosθ / pdf, which is f Le V G / pdf_area.
    """

    position: Array
    has_area: NDArray[np.bool_]
    distance: Array
    cos_theta: Array
    cos_light: Array
    geometry: Array
    is_visible: NDArray[np.bool_]
    f: Array
    emitted: Array
    pdf: Array
    pdf_area: Array
    estimate: Array


def light_points(lesson: Lesson, n: int, seed: int = 0) -> LightPoints | None:
    """n points on the lights as the pixel's point samples them; None where there is no light that can be sampled."""
    sampler = EmitterSampler(lights_of(lesson.scene.mitsuba_scene))
    if sampler.is_empty or not lesson.vertex.is_hit:
        return None
    numbers = dr.arange(mi.UInt32, n)
    keys = Sequence.keys(mi.UInt32(seed), mi.UInt32(0), mi.UInt32(0), numbers)
    u = Sequence(mi, *keys, mi.UInt32(1), stratified=False).point(mi.UInt32(0), 0)
    si = dr.gather(type(lesson.si), lesson.si, dr.zeros(mi.UInt32, n))
    ds, weight = sampler.sample(si, u, mi.Mask(True))
    wo = si.to_local(ds.d)
    value = si.bsdf().eval(mi.BSDFContext(), si, wo)  # f·cosθ
    is_free = ~lesson.scene.mitsuba_scene.ray_test(si.spawn_ray_to(ds.p))
    infinite = mi.has_flag(ds.emitter.flags(), mi.EmitterFlags.Infinite)
    has_area = mi.has_flag(ds.emitter.flags(), mi.EmitterFlags.Surface)

    def luminance(spectrum: Any) -> Array:
        rgb = PathKernel.to_rgb(mi.Spectrum(spectrum), lesson.ray.wavelengths)
        return np.broadcast_to(np.array(mi.luminance(rgb), dtype=np.float64), (n,))

    def numbers_of(part: Any) -> Array:
        return np.broadcast_to(np.array(part, dtype=np.float64), (n,))

    is_visible = np.broadcast_to(np.array(is_free, dtype=np.bool_), (n,))
    is_surface = np.broadcast_to(np.array(has_area, dtype=np.bool_), (n,))
    distance = np.asarray(lesson.scene.similarity.original_distance(numbers_of(ds.dist)))
    cos_theta, pdf = numbers_of(wo.z), numbers_of(ds.pdf)
    cos_light = np.where(is_surface, numbers_of(dr.dot(ds.n, -ds.d)), np.nan)
    ours = np.abs(cos_theta)
    with np.errstate(divide="ignore", invalid="ignore"):
        solid_angle_of_area = np.where(is_surface, np.maximum(cos_light, 0) / distance**2, np.nan)  # dω / dA
        f = np.where(ours > 0, luminance(value) / ours, 0.0)
    estimate = np.where(is_visible & (pdf > 0), luminance(value * weight), 0.0)
    position = np.array(ds.p, dtype=np.float64).reshape(3, -1).T
    position = np.where(np.broadcast_to(np.array(infinite), (n,))[:, None], np.nan, np.broadcast_to(position, (n, 3)))
    return LightPoints(
        position=position,
        has_area=is_surface,
        distance=distance,
        cos_theta=cos_theta,
        cos_light=cos_light,
        geometry=ours * solid_angle_of_area,
        is_visible=is_visible,
        f=f,
        emitted=luminance(weight * ds.pdf),
        pdf=pdf,
        pdf_area=pdf * solid_angle_of_area,
        estimate=estimate,
    )
