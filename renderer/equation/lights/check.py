"""A check of each light when a scene is looked at: does the sampler that aims at it find all of its light?

A light whose sampler misses a part of it makes pictures that are too dark and look settled. At some places around each
light, what the sampler brings is compared with what its radiance over its surface, or over all directions, brings by
points that are spread evenly. Light that even points may have missed themselves proves nothing: only a lack is told.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from renderer.backend import mitsuba
from renderer.equation.lights.environment_map import ENVIRONMENT_MAP
from renderer.equation.lights.sampler import EmitterSampler
from renderer.equation.lights.scene_lights import lights_of
from renderer.equation.lights.surface_lights import is_varying
from renderer.equation.mueller import intensity
from renderer.equation.reach import named
from renderer.equation.sequence import mix, unit
from renderer.equation.tables import table

mi: Any = mitsuba()

PLACES = 8  # around a light
PER_PLACE = 2048
MOST_LIGHTS = 16  # that are checked
DIM = 2.0  # times its mean, up to which a sky may be left to BSDFs
AWAY = 3.0  # radii of a light, from which it is looked at
LACKING = 0.25  # of its light, that a sampler may miss within the noise of the check
SURE = 5.0  # standard errors
WAVELENGTHS = (460.0, 530.0, 590.0, 640.0)  # nm


def lights_that_are_missed(scene: Any, sampler: EmitterSampler | None = None) -> tuple[str, ...]:
    """A sentence for each light of a Mitsuba scene of which its sampler misses a part. Lights of one radiance that
    nothing textures, without extent or in one direction, have nothing to be missed. sampler: that of a kernel, which
    then is what is checked, within milliseconds; else one is made.
    """
    checked = lights_worth_checking(scene)
    if not checked:
        return ()
    found = EmitterSampler(lights_of(scene)) if sampler is None else sampler
    said = []
    with dr.suspend_grad():
        for emitter in checked:
            by_sampler, by_even_points = _sampled(found, emitter), _even(found, emitter)
            if by_even_points is None or by_sampler is None:
                continue
            share = _share_found(by_sampler, by_even_points)
            if share is not None:
                (light,) = named([emitter])
                said.append(
                    f"light check: the way in which points on the {light} are chosen finds {100 * share:.0f} % of its "
                    "light; technique bsdf does without it"
                )
    return tuple(said)


def lights_worth_checking(scene: Any) -> list[Any]:
    """Lights with a picture, some of many."""
    return [e for e in scene.emitters() if _is_worth_it(e)][:MOST_LIGHTS]


def _is_worth_it(emitter: Any) -> bool:
    flags = emitter.flags()
    has = lambda flag: mi.has_flag(flags, flag)  # noqa: E731
    if has(mi.EmitterFlags.Delta):
        return False
    if has(mi.EmitterFlags.Infinite):
        return emitter.class_name() == ENVIRONMENT_MAP
    return is_varying(emitter) and emitter.get_shape() is not None


def _share_found(a: NDArray[np.float64], b: NDArray[np.float64]) -> float | None:
    """Of (places, n) values by a sampler and by even points, the share that the sampler finds; None where it may be all
    of it."""
    if not np.isfinite(a).all():
        return 0.0
    mean_a, mean_b = float(a.mean()), float(b.mean())
    error = np.sqrt((a.var(axis=1) / a.shape[1] + b.var(axis=1) / b.shape[1]).sum()) / len(a)
    return mean_a / mean_b if mean_a < (1 - LACKING) * mean_b - SURE * float(error) else None


def _sampled(sampler: EmitterSampler, emitter: Any) -> NDArray[np.float64] | None:
    """(places, n) radiance over density, by the sampler that a render has."""
    entries = range(0) if sampler.is_empty else sampler.entries_of(emitter)
    if not entries:
        return np.zeros((PLACES, PER_PLACE))  # it counts as dark
    places, lane = _places(emitter), dr.arange(mi.UInt32, PLACES * PER_PLACE)
    # Each patch of a sky has its share of the points, each point stands for all of them.
    index = entries.start + lane % len(entries)
    _, weight = sampler.sample_light(_reference(places, lane), index, _even_points(lane), mi.Bool(True))
    return _rows(weight) * len(entries)


def _even(sampler: EmitterSampler, emitter: Any) -> NDArray[np.float64] | None:
    """(places, n) the same by points that are spread evenly over its surface, or over all directions; of a sky whose
    dim parts are left to directions that BSDFs draw (`is_compensated`), without these."""
    places, lane = _places(emitter), dr.arange(mi.UInt32, PLACES * PER_PLACE)
    ref, u = _reference(places, lane), _even_points(lane)
    si = dr.zeros(mi.SurfaceInteraction3f, PLACES * PER_PLACE)
    si.wavelengths = ref.wavelengths
    shape = emitter.get_shape()
    if shape is None:
        direction = mi.warp.square_to_uniform_sphere(u)
        si.wi = -direction
        value = _rows(intensity(emitter.eval(si, mi.Bool(True))) * (4 * dr.pi))
        if not sampler.is_empty and sampler.sky is not None:
            aimed_at = np.array(sampler.sky.spot(direction, mi.Bool(True)).density > 0).reshape(value.shape)
            value[~aimed_at & (value < DIM * value.mean())] = 0
        return value
    at = shape.sample_position(0.0, u)
    away = ref.p - at.p
    si.p, si.n, si.uv, si.sh_frame = at.p, at.n, at.uv, mi.Frame3f(at.n)
    si.shape = mi.ShapePtr(shape)
    si.wi = si.to_local(dr.normalize(away))
    shines = (at.pdf > 0) & (si.wi.z > 0)
    weight = intensity(emitter.eval(si, shines)) * si.wi.z / (dr.squared_norm(away) * at.pdf)
    return _rows(dr.select(shines, weight, 0))


def _places(emitter: Any) -> NDArray[np.float64]:
    """(PLACES, 3) around a light: a lattice of directions."""
    shape = emitter.get_shape()
    centre, radius = np.zeros(3), 1.0
    if shape is not None:
        points = (
            np.array(shape.vertex_positions_buffer(), np.float64).reshape(-1, 3)
            if shape.is_mesh()
            else np.array([shape.bbox().min, shape.bbox().max], np.float64).reshape(2, 3)
        )
        low, high = points.min(axis=0), points.max(axis=0)
        centre, radius = 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))
    i = np.arange(PLACES) + 0.5
    z, phi = 1 - 2 * i / PLACES, i * np.pi * (3 - np.sqrt(5))
    across = np.sqrt(1 - z * z)
    return centre + AWAY * radius * np.stack([across * np.cos(phi), across * np.sin(phi), z], axis=1)


def _reference(places: NDArray[np.float64], lane: Any) -> Any:
    ref = dr.zeros(mi.Interaction3f, PLACES * PER_PLACE)
    ref.p = dr.gather(mi.Point3f, table(places.ravel(), mi.Float), lane // PER_PLACE)
    if mi.is_spectral:
        ref.wavelengths = mi.UnpolarizedSpectrum(*WAVELENGTHS)
    return ref


def _even_points(lane: Any) -> Any:
    """Of the lanes of a place: a lattice, shifted at random."""
    k = mi.Float(lane % PER_PLACE)
    shift = mix(lane // PER_PLACE + 0x5EED)
    x = (k + 0.5) / PER_PLACE + unit(shift, mi.Float)
    y = k * 0.6180339887 + unit(mix(shift), mi.Float)
    return mi.Point2f(x - dr.floor(x), y - dr.floor(y))


def _rows(weight: Any) -> NDArray[np.float64]:
    return np.array(dr.mean(weight), np.float64).reshape(PLACES, PER_PLACE)
