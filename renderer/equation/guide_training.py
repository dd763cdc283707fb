"""Learns a guide: paths from the sensor in a few short passes, each drawn by what those before have learned.

Enters: a kernel that has no guide yet. Leaves: a `Guide`. Its random numbers are fixed: equal scenes and settings give
equal guides on equal devices, whatever the seed. Memory: COLUMNS floats for each of VERTICES vertices of
PATHS << (PASSES − 1) paths in a pass, 27 MB, and 0.2 GB in NumPy while a guide is fitted; the guide has 2.2 MB at most.
"""

from __future__ import annotations

import copy
from typing import Any

import drjit as dr
import numpy as np

from renderer.backend import mitsuba
from renderer.equation.guide import Guide, GuideTables
from renderer.equation.guide_fit import Records, fit
from renderer.equation.path import PER_VERTEX, Before
from renderer.equation.rays import NOWHERE
from renderer.equation.sequence import Sequence
from renderer.equation.techniques import GuidedDirections, is_served_by_guide

mi: Any = mitsuba()

SEED = 0x60D3
PATHS, PASSES = 2**14, 3  # in the first pass, and twice as many in each that follows
VERTICES = 6  # of a path that are learned from
SEGMENTS = 12  # of a path, at most
MOST = 1e30  # a radiance beyond has no square
COLUMNS = 17


def learn(kernel: Any) -> Guide | None:
    """The guide of a scene; None where paths meet no surface that a guide could serve."""
    walker = copy.copy(kernel)
    guide: Guide | None = None
    kept: list[Records] = []
    centre, size = np.zeros(3), 1.0
    for number in range(PASSES):
        if guide is not None:
            walker.directions = GuidedDirections(kernel.directions, GuideTables(guide))
        records = _records(walker, PATHS << number, number)
        if len(records) == 0:
            return None
        if number == 0:
            low, centre, high = np.quantile(records.p, [0.02, 0.5, 0.98], axis=0)
            size = float(np.max(high - low)) or 1.0
        kept = [*kept, records] if number < 2 else [*kept[1:], records]  # the first was drawn without a guide
        guide = fit(Records.joined(kept), centre, size, len(records) if number == PASSES - 1 else 0)
    return guide


def _records(kernel: Any, n: int, number: int) -> Records:
    """Of n paths."""
    table, noted, radiance = _walk(kernel, dr.arange(mi.UInt32, n), n, dr.opaque(mi.UInt32, number))
    dr.eval(table, noted, radiance)
    slots = np.flatnonzero((np.arange(VERTICES) < np.broadcast_to(np.array(noted), n)[:, None]).ravel())
    lane = slots // VERTICES
    values = np.array([np.array(one)[slots] for one in table], np.float64)
    p, normal, d = values[0:3].T, values[3:6].T, values[6:9].T
    before, throughput, so_far, arrived, pdf, blind, depth, served = values[9:]
    final = np.broadcast_to(np.array(radiance, np.float64), n)[lane]  # one number where there is no light
    has_next = np.append((lane[1:] == lane[:-1]) & (depth[1:] == depth[:-1] + 1), False)
    with np.errstate(all="ignore"):
        found = [(np.append(arrived[1:], 0) - so_far) / throughput, (final - so_far) / throughput]
        found = [throughput / before, np.where(has_next, found[0], 0), found[1], (final - arrived) / before]
        is_good = np.isfinite(values).all(axis=0) & np.isfinite(1 / pdf) & (pdf > 0)
    # What is not finite counts as nothing, and so does less than nothing, by rounding.
    found = [np.where(np.isfinite(x) & (x > 0) & (x < MOST), x, 0) for x in found]
    has_next &= np.append(is_good[1:], False)
    p, normal, d, pdf, blind = (one[is_good] for one in (p, normal, d, pdf, blind))
    weight, shone, brought, sent = (one[is_good] for one in found)
    return Records(p, normal, d, pdf, blind, weight, shone, brought, sent, has_next[is_good], served[is_good] > 0)


@dr.syntax
def _walk(kernel: Any, lane: Any, n: int, number: Any) -> Any:
    """n paths, as the kernel traces them, but for roulette. Returns what was noted at their vertices, how many each
    noted, and radiance, of its channels the mean."""
    key_a, key_b = Sequence.keys(mi.UInt32(SEED), number, lane, mi.UInt32(0))
    sequence = Sequence(mi, key_a, key_b, mi.UInt32(1), stratified=False)
    place = sequence.point(mi.UInt32(0), 0)
    u_lens, u_time = sequence.point(mi.UInt32(0), 1), sequence.point(mi.UInt32(0), 2)
    ray_time = kernel.shutter_open + kernel.shutter_time * u_time.x
    camera_ray, camera_weight = kernel.camera.sample_ray(ray_time, u_time.y, place, u_lens, True)
    noted = [dr.zeros(mi.Float, n * VERTICES) for _ in range(COLUMNS)]
    n_noted = mi.UInt32(0)
    depth = mi.UInt32(0)
    origin, direction = mi.Point3f(camera_ray.o), mi.Vector3f(camera_ray.d)
    time, wavelengths = mi.Float(camera_ray.time), camera_ray.wavelengths
    start = mi.UInt32(NOWHERE)
    prev_p, prev_pdf = mi.Point3f(0), mi.Float(0)
    prev_delta, prev_place = mi.Bool(True), mi.UInt32(0)
    throughput, radiance = mi.Spectrum(camera_weight), mi.Spectrum(0)
    active = mi.Bool(True)
    while dr.hint(active, label="guide"):
        ray = mi.Ray3f(origin, direction, time, wavelengths)
        vertex = kernel._vertex(ray, start, place, mi.Bool(False), active)
        si, bsdf = vertex.si, vertex.bsdf
        before = Before(prev_p, time, prev_pdf, prev_delta, prev_place)
        sees_emitter = kernel._sees_emitter(vertex, depth, mi.Bool(False), depth == 0, active)
        radiance[sees_emitter] = radiance + kernel._emitted(throughput, vertex, before, sees_emitter)
        arrived = dr.mean(radiance)

        passes_through = kernel._passes_through(si, depth, active)
        active_next = active & si.is_valid() & (depth + 1 < kernel.sizes[3]) & ~passes_through
        u = [sequence.point(mi.UInt32(0), PER_VERTEX * (depth + 1) + pair) for pair in range(PER_VERTEX)]
        light, bs, bsdf_weight = kernel._scattered(throughput, vertex, u, active_next)
        is_lit = kernel._is_visible(light, vertex)
        radiance[is_lit] = radiance + light.contribution

        next_direction = dr.select(passes_through, ray.d, si.to_world(bs.wo))
        next_origin = kernel.rays.origin(si, next_direction)
        carried = dr.mean(throughput)
        throughput[active_next] = throughput * bsdf_weight
        is_delta = mi.has_flag(bs.sampled_type, mi.BSDFFlags.Delta) | mi.has_flag(bs.sampled_type, mi.BSDFFlags.Null)
        is_noted = active_next & ~is_delta & (n_noted < VERTICES)
        facing = dr.select(si.wi.z < 0, -si.sh_frame.n, si.sh_frame.n)
        values = (*si.p, *facing, *next_direction)
        values += (carried, dr.mean(throughput), dr.mean(radiance), arrived, bs.pdf)
        # Where the guide serves, eta tells how many times denser the mixture is than the BSDF alone.
        served = is_served_by_guide(bsdf)
        blind = dr.select(served, bs.pdf / dr.square(bs.eta), bs.pdf)
        values += (blind, mi.Float(depth), dr.select(served, mi.Float(1), 0))
        for i in range(COLUMNS):
            dr.scatter(noted[i], values[i], lane * VERTICES + n_noted, is_noted)
        n_noted[is_noted] = n_noted + 1
        prev_p[active_next] = kernel._seen_from(vertex, next_origin)
        prev_pdf[active_next] = bs.pdf
        prev_delta[active_next] = mi.has_flag(bs.sampled_type, mi.BSDFFlags.Delta)
        prev_place = light.place
        origin, direction, start = next_origin, next_direction, vertex.surface
        depth[active_next] = depth + 1
        active = (active_next & dr.any(throughput != 0) & (depth < SEGMENTS)) | passes_through
    return noted, n_noted, dr.mean(radiance)
