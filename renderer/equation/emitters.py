"""Emitter sampling: which light, and which point on it (the area form).

Enters: the scene's emitters. Leaves: a direction sample with its solid-angle pdf and the weight radiance/pdf, and the
same pdf for a light that was hit by chance. Lights are chosen by their power, mixed with a uniform choice so that a dim
light close by is never starved; lights at infinity each get a fixed share. Where there are many, what they give is
surveyed first, and the choice depends on the place. Sphere lights are sampled by the cone they
subtend, with 1 − cos written as sin²/(1 + cos): in float32 the plain form is off by 7 % at a milliradian and black
below a tenth of one.
Sources: Shirley, Wang & Zimmerman 1996; pbrt-v4, sections 6.2.4 and 12.6.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from renderer.backend import mitsuba
from renderer.equation.collimated import CollimatedLights, is_collimated
from renderer.equation.light_choice import LightChoice
from renderer.equation.light_survey import survey
from renderer.equation.tables import table

mi: Any = mitsuba()

UNIFORM_SHARE = 0.2  # of the choice among finite lights
# Among few lights power says little (a spot shines elsewhere, a dim lamp is near): a light chosen too seldom costs
# fireflies, and halving the chance of the others costs next to nothing.
FEW_LIGHTS, UNIFORM_SHARE_OF_FEW = 8, 0.5
POWER_SAMPLES, MOST_POWER_SAMPLES = 1024, 2**20  # rays of one emitter, and of all
ON_SURFACE = 0.9998  # (radius / distance)² from which a point counts as lying on a sphere
# Shapes whose surface Mitsuba cannot sample: light on them is found by direction sampling alone.
_UNSAMPLEABLE = ("SDFGrid", "BSplineCurve", "LinearCurve", "Ellipsoids", "EllipsoidsMesh")


class EmitterSampler:
    """Samples the emitters of one scene. `is_empty` where there is nothing to sample.

    sensor: where paths begin, for a survey of what many lights give; without it they are chosen by their power.
    """

    def __init__(self, scene: Any, sensor: Any = None) -> None:
        emitters = [e for e in scene.emitters() if is_sampleable(e)]
        self.is_empty = not emitters
        if self.is_empty:
            return
        weights = choice_probabilities(emitters)
        emitters = [e for e, w in zip(emitters, weights, strict=True) if w > 0]
        weights = weights[weights > 0]
        self.is_empty = not emitters
        if self.is_empty:
            return
        self.only = emitters[0] if len(emitters) == 1 else None
        near = _side_by_side(emitters)
        emitters, weights = [emitters[i] for i in near], weights[near]
        # Tables by registry id: what is known of an emitter once a ray has hit it.
        ids = np.array([registry_id(e) for e in emitters], np.uint32)
        self.pointers: Any = dr.reinterpret_array(mi.EmitterPtr, table(ids, mi.UInt32))
        by_id = np.full(int(ids.max()) + 1, len(emitters), np.uint32)
        by_id[ids] = np.arange(len(emitters))
        self.n_emitters = len(emitters)
        self.index_by_id = mi.UInt32(by_id)
        spheres = [_sphere_of(e) for e in emitters]
        self.has_spheres = any(s is not None for s in spheres)
        if self.has_spheres:
            by_id = np.zeros((int(ids.max()) + 1, 4), np.float32)
            for i, sphere in zip(ids, spheres, strict=True):
                if sphere is not None:
                    by_id[i] = sphere
            self.sphere_by_id = mi.Float(by_id.ravel())
        self.collimated = CollimatedLights(emitters, ids)
        self.choice = LightChoice(weights) if self.only is None else None
        if self.choice is not None and sensor is not None and len(emitters) > FEW_LIGHTS:
            seen = survey(scene, sensor, self._sample_entry, self.choice.n_entries)
            if seen is not None:
                self.choice.learn(seen)

    @property
    def knows_places(self) -> bool:
        """Whether the choice among lights depends on the place."""
        return not self.is_empty and self.choice is not None and self.choice.depth > 0

    def place(self, p: Any, n: Any, active: Any) -> Any:
        """Where p is, as far as the choice among lights depends on it. n: normal on the side that light comes from."""
        return self.choice.place(p, n, active) if self.choice is not None else mi.UInt32(0)

    def sample(self, ref: Any, u: Any, active: Any, place: Any = 0) -> tuple[Any, Any]:
        """A point on a light as seen from `ref`, visibility not tested. Returns (DirectionSample3f, radiance / pdf)."""
        u = mi.Point2f(u)
        if self.choice is None:
            assert self.only is not None
            ds, weight = self.only.sample_direction(ref, u, active)
            return self._refined(mi.EmitterPtr(self.only), ref, u, ds, weight, active)
        index, u, pmf = self.choice.sample(mi.UInt32(place), u, active)
        ds, weight = self._sample_one(ref, index, u, active)
        ds.pdf *= pmf
        return ds, weight / pmf

    def _sample_entry(self, ref: Any, entry: Any, u: Any, active: Any) -> tuple[Any, Any]:
        """A point on a light of one entry of the choice."""
        assert self.choice is not None
        index, u, share = self.choice.sample_within(entry, u, active)
        ds, weight = self._sample_one(ref, index, u, active)
        return ds, weight / share

    def _sample_one(self, ref: Any, index: Any, u: Any, active: Any) -> tuple[Any, Any]:
        emitter = dr.gather(mi.EmitterPtr, self.pointers, index, active)
        ds, weight = emitter.sample_direction(ref, u, active)
        return self._refined(emitter, ref, u, ds, weight, active)

    def _refined(self, emitter: Any, ref: Any, u: Any, ds: Any, weight: Any, active: Any) -> tuple[Any, Any]:
        """Mitsuba's sample of an emitter, replaced where we know better."""
        if self.has_spheres:
            sphere = self._sphere(emitter, active)
            is_sphere = active & (sphere.w != 0)
            ds_sphere, weight_sphere = sample_sphere(ref, u, emitter, sphere, is_sphere)
            for name in ("p", "n", "d", "dist", "pdf"):
                setattr(ds, name, dr.select(is_sphere, getattr(ds_sphere, name), getattr(ds, name)))
            weight = dr.select(is_sphere, weight_sphere, weight)
        if not self.collimated.is_empty:
            ds, weight = self.collimated.sample(ref, emitter, ds, weight, active)
        return ds, weight

    def pdf(self, ref: Any, ds: Any, active: Any, place: Any = 0) -> Any:
        """Solid-angle density with which `sample` finds the hit `ds`."""
        if self.choice is None:
            is_known = active & (ds.emitter == mi.EmitterPtr(self.only))
            pmf = dr.select(is_known, mi.Float(1), 0)
        else:
            index = dr.gather(mi.UInt32, self.index_by_id, self._id(ds.emitter), active)
            is_known = active & (index < self.n_emitters)
            pmf = self.choice.pmf(mi.UInt32(place), index, is_known)
        pdf = ds.emitter.pdf_direction(ref, ds, is_known)
        if self.has_spheres:
            sphere = self._sphere(ds.emitter, is_known)
            pdf = dr.select(sphere.w != 0, sphere_pdf(ref.p, sphere, ds), pdf)
        return dr.select(is_known, pdf * pmf, 0)

    def _id(self, emitter: Any) -> Any:
        # An id beyond the table is an emitter that is not sampled; entry 0 is no emitter's and tells so.
        found: Any = dr.reinterpret_array(mi.UInt32, emitter)
        known: Any = found < dr.width(self.index_by_id)
        return dr.select(known, found, 0)

    def _sphere(self, emitter: Any, active: Any) -> Any:
        return dr.gather(mi.Vector4f, self.sphere_by_id, self._id(emitter), active)


def sample_sphere(ref: Any, u: Any, emitter: Any, sphere: Any, active: Any) -> tuple[Any, Any]:
    """A point on a sphere light. From outside: uniform in the cone it subtends. From inside or on it: by area.

    Returns (DirectionSample3f, radiance / pdf). sphere: centre and radius, the radius negative if it shines inwards.
    """
    to_centre = mi.Vector3f(sphere.x, sphere.y, sphere.z) - ref.p
    radius = dr.abs(sphere.w)
    is_outside, one_minus_cos = cone(to_centre, radius)
    frame = mi.Frame3f(dr.normalize(to_centre))
    drop = u.x * one_minus_cos  # 1 − cosθ of the direction, exact for tiny cones
    sin_theta_2, sin_max_2 = drop * (2 - drop), one_minus_cos * (2 - one_minus_cos)
    sin_phi, cos_phi = dr.sincos(dr.two_pi * u.y)
    # Angle at the centre between the point and the line of sight: stays exact where p − centre would cancel.
    ratio_2 = sin_theta_2 / sin_max_2
    cos_alpha = dr.clip(dr.sqrt(ratio_2 * sin_theta_2) + (1 - drop) * dr.safe_sqrt(1 - ratio_2), -1, 1)
    sin_alpha = dr.safe_sqrt(1 - dr.square(cos_alpha))
    n = frame.to_world(mi.Vector3f(sin_alpha * cos_phi, sin_alpha * sin_phi, -cos_alpha))
    n = dr.select(is_outside, n, mi.warp.square_to_uniform_sphere(u))

    ds = dr.zeros(mi.DirectionSample3f)
    towards = to_centre + radius * n
    ds.p = ref.p + towards
    ds.dist = dr.norm(towards)
    ds.d = towards / ds.dist
    ds.n = dr.select(sphere.w > 0, n, -n)
    ds.pdf = dr.select(active & (ds.dist > 0), sphere_pdf(ref.p, sphere, ds), 0)

    si = dr.zeros(mi.SurfaceInteraction3f)
    si.p, si.n = ds.p, ds.n
    si.sh_frame = mi.Frame3f(ds.n)
    si.wi = si.to_local(-ds.d)
    si.time, si.wavelengths = ref.time, ref.wavelengths
    return ds, dr.select(ds.pdf > 0, emitter.eval(si, active) / ds.pdf, 0)


def sphere_pdf(p: Any, sphere: Any, ds: Any) -> Any:
    """Solid-angle density with which `sample_sphere` at p draws the point of `ds`."""
    radius = dr.abs(sphere.w)
    is_outside, one_minus_cos = cone(mi.Vector3f(sphere.x, sphere.y, sphere.z) - p, radius)
    by_area = dr.square(ds.dist) / (4 * dr.pi * dr.square(radius) * dr.abs(dr.dot(ds.d, ds.n)))
    return dr.select(is_outside, dr.rcp(dr.two_pi * one_minus_cos), by_area)


def cone(to_centre: Any, radius: Any) -> tuple[Any, Any]:
    """Whether a sphere is seen from outside, and 1 − cos of the half angle of the cone it subtends.

    A point within 1e-4 of the surface counts as on it: rounding must not put it inside here and outside there.
    """
    sin_2 = dr.square(radius) / dr.squared_norm(to_centre)
    is_outside = sin_2 < ON_SURFACE
    return is_outside, dr.select(is_outside, sin_2 / (1 + dr.safe_sqrt(1 - sin_2)), 1)


def choice_probabilities(emitters: list[Any]) -> NDArray[np.float64]:
    """Probability of choosing each emitter; zero only where it emits nothing."""
    infinite = np.array([bool(mi.has_flag(e.flags(), mi.EmitterFlags.Infinite)) for e in emitters])
    probability = np.zeros(len(emitters))
    shares = int(infinite.sum()) + int((~infinite).any())
    probability[infinite] = 1 / shares
    if (~infinite).any():
        finite = _powers([e for e, is_infinite in zip(emitters, infinite, strict=True) if not is_infinite])
        known = np.where(np.isnan(finite), np.nanmean(finite) if np.isfinite(finite).any() else 1.0, finite)
        lit = known > 0
        if lit.any():
            share = UNIFORM_SHARE_OF_FEW if lit.sum() <= FEW_LIGHTS else UNIFORM_SHARE
            mixed = share * lit / lit.sum() + (1 - share) * known / known.sum()
            probability[~infinite] = mixed / shares
    total = probability.sum()
    return probability / total if total > 0 else probability


def _side_by_side(emitters: list[Any]) -> NDArray[np.int64]:
    """An order in which neighbours in space stand beside each other, lights at infinity first (Morton 1966)."""
    centres = np.array([_centre(e) for e in emitters])
    known = np.isfinite(centres).all(axis=1)
    codes = np.zeros(len(emitters), np.int64)
    if known.any():
        low, high = centres[known].min(axis=0), centres[known].max(axis=0)
        cells = (1023 * (centres[known] - low) / max(float(np.max(high - low)), 1e-30)).astype(np.int64)
        codes[known] = 1
        for bit in reversed(range(10)):
            for axis in range(3):
                codes[known] = codes[known] << 1 | cells[:, axis] >> bit & 1
    return np.argsort(codes, kind="stable")


def _centre(emitter: Any) -> list[float]:
    """Of the emitter's bounds; NaN at infinity."""
    if mi.has_flag(emitter.flags(), mi.EmitterFlags.Infinite):
        return [float("nan")] * 3
    bounds = emitter.get_shape().bbox() if emitter.get_shape() is not None else emitter.bbox()
    return [float(x) for x in bounds.center()]


def _powers(emitters: list[Any]) -> NDArray[np.float64]:
    """Emitted powers, from rays that the emitters draw themselves; NaN where one cannot draw any."""
    n = min(POWER_SAMPLES, max(MOST_POWER_SAMPLES // len(emitters), 16))
    try:
        values = _rays(emitters, n)
    except RuntimeError:
        if len(emitters) == 1:
            return np.array([np.nan])
        return np.concatenate([_powers([e]) for e in emitters])
    known = np.isfinite(values)
    mean = np.where(known, values, 0).sum(axis=(0, 2)) / np.maximum(known.sum(axis=(0, 2)), 1)
    return np.where(known.any(axis=(0, 2)), np.maximum(mean, 0), np.nan)


def _rays(emitters: list[Any], n: int) -> NDArray[np.float64]:
    """(channels, emitters, n) weights of n rays from each emitter."""
    i = np.tile(np.arange(n), len(emitters))
    u = [table((i * step + 0.5) % 1, mi.Float) for step in (0.8191725, 0.6710436, 0.5497004, 0.4503, 0.3689)]
    pointer: Any = emitters[0]  # one alone is traced itself, without a call that could be any emitter's
    if len(emitters) > 1:
        ids = np.repeat(np.array([registry_id(e) for e in emitters], np.uint32), n)
        pointer = dr.reinterpret_array(mi.EmitterPtr, table(ids, mi.UInt32))
    _, weight = pointer.sample_ray(mi.Float(0), u[0], mi.Point2f(u[1], u[2]), mi.Point2f(u[3], u[4]))
    found = np.array(weight, np.float64)
    found = found.reshape(len(found) if found.ndim > 1 else 1, -1)
    return np.broadcast_to(found, (len(found), len(i))).reshape(-1, len(emitters), n)


def registry_id(emitter: Any) -> int:
    """The number by which Dr.Jit's pointers name an emitter."""
    pointer: Any = dr.reinterpret_array(mi.UInt32, mi.EmitterPtr(emitter))
    return int(pointer[0])


def is_sampleable(emitter: Any) -> bool:
    """Whether emitter sampling can find an emitter: not on shapes whose surface Mitsuba cannot sample."""
    shape = emitter.get_shape()
    if emitter.class_name() == "DirectionalArea":
        return is_collimated(emitter)
    return shape is None or shape.class_name() not in _UNSAMPLEABLE


def _sphere_of(emitter: Any) -> tuple[float, float, float, float] | None:
    """Centre and radius (negative if it shines inwards) of a sphere light of constant radiance."""
    shape = emitter.get_shape()
    if shape is None or shape.class_name() != "Sphere" or emitter.class_name() != "AreaLight":
        return None
    if mi.has_flag(emitter.flags(), mi.EmitterFlags.SpatiallyVarying):
        return None
    matrix = np.array(mi.traverse(shape)["to_world"].matrix, dtype=np.float64).reshape(4, 4)
    centre, radius = matrix[:3, 3], float(np.linalg.norm(matrix[:3, 0]))
    at = shape.sample_position(0, mi.Point2f(0.3, 0.4))
    outwards = np.array(at.n, dtype=np.float64).ravel() @ (np.array(at.p, dtype=np.float64).ravel() - centre)
    x, y, z = (float(c) for c in centre)
    return x, y, z, radius if outwards > 0 else -radius
