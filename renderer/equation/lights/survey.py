"""Walks through a scene once and measures what each of its lights gives where light matters.

Enters: a scene, a sensor and a way to sample one emitter. Leaves: points on surfaces that paths from the sensor reach,
and for each point one visible sample of every light. A fixed set of random numbers: equal scenes give equal surveys.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from renderer.backend import mitsuba
from renderer.equation.lights import survey_in_media
from renderer.equation.mueller import intensity
from renderer.equation.sequence import Sequence
from renderer.equation.tables import table

mi: Any = mitsuba()

# An eighth of the samples leaves a room of 200 lights 1.15 times the variance; skies lose more.
WALKS, VERTICES = 8192, 3  # paths, and how far each goes
MOST_SAMPLES = 2**21  # of lights, over all points
METERED = 4  # of so many points, one more lies on the surface of a meter
POINTS_PER_PLACE = 16
MOST_PLACES = 512
SEED = 0x5EED


@dataclass(frozen=True, slots=True)
class Seen:
    """features: (n, 6) of the points, position less `centre` over `size`, and normal. given: (n, m) light received.
    depth: of the tree of places that so many points can fill."""

    features: NDArray[np.float64]
    centre: tuple[float, float, float]
    size: float
    given: NDArray[np.float32]
    depth: int


def survey(scene: Any, sensor: Any, sample_light: Any, n_entries: int, has_media: bool = False) -> Seen | None:
    """What lights give where. None where paths from the sensor meet nothing that could be lit.

    sample_light: (reference, entry, u, active) → (direction sample, radiance / pdf) of one of `n_entries` lights.
    has_media: points in media count, and their borders are no walls (see `survey_in_media`).
    """
    wanted = min(WALKS * VERTICES, MOST_SAMPLES // n_entries)
    places = max(1, min(MOST_PLACES, wanted // POINTS_PER_PLACE))
    points, normals, transmits = (_points_in_media if has_media else _vertices)(scene, sensor, wanted)
    if hasattr(sensor, "vertex"):  # of a meter, where all its paths begin
        metered = _metered(sensor, max(wanted // METERED, 1))
        points, normals = np.concatenate([points, metered[0]]), np.concatenate([normals, metered[1]])
        transmits = np.concatenate([transmits, np.zeros(len(metered[0]), bool)])
    if len(points) == 0:
        return None
    is_within = ~normals.any(axis=1) if has_media else None
    given = _given(scene, points, normals, transmits, is_within, sample_light, n_entries, _mid_time(sensor))
    low, middle, high = np.quantile(points, [0.05, 0.5, 0.95], axis=0)
    size = float(np.max(high - low)) or 1.0
    centre = (float(middle[0]), float(middle[1]), float(middle[2]))
    features = np.concatenate([(points - middle) / size, normals], axis=1)
    return Seen(features, centre, size, given, places.bit_length() - 1)


def _vertices(scene: Any, sensor: Any, wanted: int) -> tuple[Any, ...]:
    """Up to `wanted` points, normals on the side they are seen from, and whether light may pass, of smooth surfaces."""
    found = _walk(scene, sensor, mi.UInt32(dr.arange(mi.UInt32, WALKS)))
    dr.eval(found)
    p, n, kind = (np.array(values) for values in found)
    p, n, kind = p.reshape(-1, 3).astype(np.float64), n.reshape(-1, 3).astype(np.float64), kind.astype(np.int64)
    good = np.flatnonzero((kind > 0) & np.isfinite(p).all(axis=1) & np.isfinite(n).all(axis=1))
    if len(good) > wanted:
        good = good[np.arange(wanted) * len(good) // wanted]
    return p[good], n[good], kind[good] > 1


def _points_in_media(scene: Any, sensor: Any, wanted: int) -> tuple[Any, ...]:
    """As `_vertices`; points in media have no normal."""
    start = _even_points(dr.arange(mi.UInt32, WALKS))
    p, n, kind = survey_in_media.points(scene, sensor, WALKS, SEED, start, _mid_time(sensor))
    some = np.arange(min(wanted, len(p))) * len(p) // max(min(wanted, len(p)), 1)
    return p[some], n[some], kind[some] == survey_in_media.PASSED


def _metered(sensor: Any, n: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(n, 3) points of the shape that a meter is on, and their normals."""
    ray = dr.zeros(mi.Ray3f)
    ray.time = _mid_time(sensor)
    si, _ = sensor.vertex(ray, _even_points(dr.arange(mi.UInt32, n)))
    # All of them equal on a point-like or flat shape: then they may be one number.
    p, n_ = (np.broadcast_to(np.array(v, np.float64).reshape(3, -1), (3, n)).T for v in (si.p, si.n))
    return p, n_


def _even_points(lane: Any) -> Any:
    """The most even points of any number in the square (Roberts 2018)."""
    at = mi.Point2f(mi.Float(lane) * 0.7548776662466927, mi.Float(lane) * 0.5698402909980532)
    return at - dr.floor(at)


@dr.syntax
def _walk(scene: Any, sensor: Any, lane: Any) -> Any:
    key_a, key_b = Sequence.keys(mi.UInt32(SEED), mi.UInt32(0), lane, mi.UInt32(0))
    sequence = Sequence(mi, key_a, key_b, mi.UInt32(1), stratified=False)
    u = sequence.point(mi.UInt32(0), 0)
    opening = _mid_time(sensor)
    ray, _ = sensor.sample_ray(opening, u.x, _even_points(lane), sequence.point(mi.UInt32(0), 1), True)
    p, n = dr.zeros(mi.Float, WALKS * VERTICES * 3), dr.zeros(mi.Float, WALKS * VERTICES * 3)
    kind = dr.zeros(mi.UInt32, WALKS * VERTICES)  # 1: light is reflected; 2: it may pass, too
    step = mi.UInt32(0)
    origin, direction = mi.Point3f(ray.o), mi.Vector3f(ray.d)
    wavelengths = ray.wavelengths
    active = mi.Bool(True)
    while dr.hint(active, label="survey"):
        si = scene.ray_intersect(mi.Ray3f(origin, direction, opening, wavelengths), mi.RayFlags.All, False, active)
        active &= si.is_valid()
        bsdf = si.bsdf()
        is_smooth = active & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)
        slot = lane * VERTICES + step
        facing = dr.select(dr.dot(si.n, direction) > 0, -si.n, si.n)
        passes = mi.has_flag(bsdf.flags(), mi.BSDFFlags.Transmission)
        for i in range(3):
            dr.scatter(p, si.p[i], slot * 3 + i, is_smooth)
            dr.scatter(n, facing[i], slot * 3 + i, is_smooth)
        dr.scatter(kind, dr.select(passes, mi.UInt32(2), 1), slot, is_smooth)
        first, second = sequence.point(mi.UInt32(0), 2 * step + 2), sequence.point(mi.UInt32(0), 2 * step + 3)
        bs, weight = bsdf.sample(mi.BSDFContext(), si, first.x, second, active)
        active &= dr.any(intensity(weight) != 0)
        following = si.spawn_ray(si.to_world(bs.wo))
        origin, direction = following.o, following.d
        step += 1
        active &= step < VERTICES
    return p, n, kind


def _mid_time(sensor: Any) -> float:
    return float(sensor.shutter_open()) + 0.5 * float(sensor.shutter_open_time())


def _given(
    scene: Any,
    points: Any,
    normals: Any,
    transmits: Any,
    is_within: Any,
    sample_light: Any,
    n_entries: int,
    time: float,
) -> NDArray[np.float32]:
    """(n, m) light that falls on each point from one sample of each light. is_within: whether it is in a medium; None
    where there is none."""
    n = len(points)
    p, normal = (table(a.ravel(), mi.Float) for a in (points, normals))
    passes = table(transmits, mi.UInt32)
    lane = dr.arange(mi.UInt32, n * n_entries)
    entries = dr.opaque(mi.UInt32, n_entries)
    point = lane // entries
    key_a, key_b = Sequence.keys(mi.UInt32(SEED), mi.UInt32(1), lane, mi.UInt32(0))
    u = Sequence(mi, key_a, key_b, mi.UInt32(1), stratified=False).point(mi.UInt32(0), 0)
    ref = dr.zeros(mi.Interaction3f, n * n_entries)
    ref.time = time
    ref.p, ref.n = dr.gather(mi.Point3f, p, point), dr.gather(mi.Normal3f, normal, point)
    scale = mi.UnpolarizedSpectrum(1)
    if mi.is_spectral:
        ref.wavelengths, scale = mi.sample_rgb_spectrum(mi.sample_shifted(u.y))
    ds, weight = sample_light(ref, lane - point * entries, u, mi.Bool(True))
    cosine = dr.dot(ds.d, ref.n)
    cosine = dr.select(dr.gather(mi.UInt32, passes, point) != 0, dr.abs(cosine), cosine)
    if is_within is not None:
        cosine = dr.select(dr.gather(mi.UInt32, table(is_within, mi.UInt32), point) != 0, 1, cosine)
    light = dr.mean(weight * scale) * cosine
    lit = (ds.pdf != 0) & (light > 0)
    if is_within is None:
        lit &= ~scene.ray_test(ref.spawn_ray_to(ds.p), False, lit)
    else:
        lit = survey_in_media.is_seen(scene, ref.spawn_ray_to(ds.p), lit)
    return np.array(dr.select(lit, light, 0), np.float32).reshape(n, n_entries)
