"""Camera paths that look up what light paths left: how bright that makes each part of the image, and in what finds.

Enters: a kernel and the arrivals of light. Leaves: for each vertex of a few camera paths the luminance that arrivals
near it send to the camera, and what the same light would be worth to a path that meets it by chance. Arrivals within a
disk count as spread over it; of those in each of eight cells around a vertex one stands for all, drawn at random: the
sum is that of photon mapping, at a cost that does not depend on their number.

Source: Jensen 2001; Hachisuka & Jensen 2009 for directions drawn at the vertex. What is blurred here is judged within a
factor of two, never shown.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from renderer.backend import mitsuba
from renderer.equation import roulette
from renderer.equation.light_paths import Arrivals, rgb
from renderer.equation.sequence import Sequence, mix, unit
from renderer.equation.tables import number, table

mi: Any = mitsuba()

VERTICES = 16  # of a camera path, panes that it passes among them: more bounces of hidden light are left out
STREAM = 0xA0D17
BUCKETS_BITS = 18
FACING = 0.7  # cosine between normals that belong to one surface, from either side: frosted glass sends light through
FLAT = 0.3  # of the radius, that arrivals may lie above or below
LEAST_COSINE = 0.02
PER_VERTEX = 4  # pairs of dimensions
LUMINANCE = (0.2126, 0.7152, 0.0722)


@dataclass(frozen=True, slots=True)
class Gathered:
    """One row per vertex that found something. tile: (n,) of the image. batch: (n,). luminance: (n,) that the path
    brings. worth: (n,) of a find by chance; infinite where there is none. arrival: (n,) which one it was."""

    tile: NDArray[np.int64]
    batch: NDArray[np.int64]
    luminance: NDArray[np.float64]
    worth: NDArray[np.float64]
    arrival: NDArray[np.int64]


_NO_NUMBERS, _NO_VALUES = np.zeros(0, np.int64), np.zeros(0)
NOTHING = Gathered(_NO_NUMBERS, _NO_NUMBERS, _NO_VALUES, _NO_VALUES, _NO_NUMBERS)


class Gatherer:
    """Camera paths over the tiles of an image, and the arrivals that they look up, within `radius`."""

    def __init__(self, kernel: Any, tiles: NDArray[np.float64], arrivals: Arrivals, radius: float) -> None:
        self.kernel, self.radius = kernel, number(radius)
        self.n_tiles = len(tiles)
        self._tiles = table(tiles.ravel(), mi.Float)  # x, y, width and height of each, as shares of the image
        keys = _keys_of(arrivals, radius)
        self.order = np.argsort(keys & np.uint32(2**BUCKETS_BITS - 1), kind="stable")
        counts = np.bincount(keys & np.uint32(2**BUCKETS_BITS - 1), minlength=2**BUCKETS_BITS)
        self._starts = table(np.concatenate([[0], np.cumsum(counts)]), mi.UInt32)
        self._keys = table(keys[self.order], mi.UInt32)
        self._links = table(arrivals.links[self.order], mi.UInt32)
        every = (arrivals.p, arrivals.d, arrivals.normal, arrivals.flux, arrivals.radiance)
        self._p, self._d, self._n, self._flux, self._radiance = (table(a[self.order].ravel(), mi.Float) for a in every)

    def gather(self, batches: int, per_tile: int, seed: int) -> Gathered:
        """`per_tile` paths in each tile for each of the batches."""
        per_batch = per_tile * self.n_tiles
        lane = dr.arange(mi.UInt32, batches * per_batch)
        numbers = (seed & 0xFFFFFFFF, seed >> 32, per_batch, self.n_tiles)
        with dr.suspend_grad():
            found = self._walk(lane, *(dr.opaque(mi.UInt32, n) for n in numbers), *self.kernel.sizes[3:5])
            dr.eval(*found)
        luminance, worth, arrival = (np.array(x) for x in found)
        rows = np.flatnonzero((luminance > 0) & np.isfinite(luminance))
        lanes = rows // VERTICES
        return Gathered(
            tile=(lanes % per_batch) % self.n_tiles,
            batch=lanes // per_batch,
            luminance=luminance[rows].astype(np.float64),
            worth=np.nan_to_num(worth[rows].astype(np.float64), nan=np.inf, posinf=np.inf),  # ∞ · 0 is of ∞
            arrival=self.order[arrival[rows]],
        )

    @dr.syntax
    def _walk(
        self, lane: Any, low: Any, high: Any, per_batch: Any, n_tiles: Any, depth_limit: Any, rr_depth: Any
    ) -> Any:
        kernel, rays = self.kernel, self.kernel.rays
        key_a, key_b = Sequence.keys(low, high, lane, mi.UInt32(STREAM))
        sequence = Sequence(mi, key_a, key_b, mi.UInt32(1), stratified=False)
        batch = lane // per_batch
        tile = dr.gather(mi.Vector4f, self._tiles, (lane - batch * per_batch) % n_tiles)
        ctx = mi.BSDFContext()
        u = sequence.point(mi.UInt32(0), 0)
        extra = sequence.point(mi.UInt32(0), 2)
        position = mi.Point2f(dr.fma(u.x, tile.z, tile.x), dr.fma(u.y, tile.w, tile.y))
        time = kernel.shutter_open + kernel.shutter_time * extra.x
        camera_ray, weight = kernel.camera.sample_ray(time, extra.y, position, sequence.point(mi.UInt32(0), 1), True)
        origin, direction = mi.Point3f(camera_ray.o), mi.Vector3f(camera_ray.d)
        wavelengths, longest = camera_ray.wavelengths, mi.Float(camera_ray.maxt)
        # Of wavelengths light paths take care; what the camera weighs otherwise is little.
        throughput = mi.Spectrum(1) if dr.hint(mi.is_spectral, mode="scalar") else mi.Spectrum(weight)
        eta, typical = mi.Float(1), mi.Float(0)  # as the kernel's roulette needs them
        start = mi.UInt32(0xFFFFFFFF)
        depth = mi.UInt32(0)
        step = mi.UInt32(0)
        n = VERTICES * dr.width(lane)
        out_luminance, out_worth = dr.zeros(mi.Float, n), dr.zeros(mi.Float, n)
        out_arrival = dr.zeros(mi.UInt32, n)
        active = mi.Bool(True)

        while dr.hint(active, label="audit"):
            # ------------------------------ Next vertex ------------------------------

            ray = mi.Ray3f(origin, direction, time, wavelengths)
            ray.maxt = dr.select(step == 0, longest, ray.maxt)
            met = rays.meet(ray, start, active)
            si, bsdf = met.si, met.bsdf
            active &= si.is_valid()
            passes_through = mi.Bool(False)
            if dr.hint(self.kernel.model.hide_emitters, mode="scalar"):
                passes_through = active & (depth == 0) & (si.shape.emitter() != None)  # noqa: E711
            active &= passes_through | (depth + 1 < depth_limit)

            # ------------------------------ Light that came to lie here ------------------------------

            looks = active & ~passes_through & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)
            chosen, density, looks = self._pick(si.p, si.n, batch, key_a ^ mix(key_b + step), looks)
            links = dr.gather(mi.UInt32, self._links, chosen, looks)
            looks &= (depth_limit == 0xFFFFFFFF) | (depth + links + 1 < depth_limit)
            wo = si.to_local(-dr.gather(mi.Vector3f, self._d, chosen, looks))
            value, pdf = kernel.directions.eval_pdf(bsdf, ctx, si, wo, looks)
            looks &= pdf > 0
            carried = rgb_of(throughput * si.to_world_mueller(value, -wo, si.wi), wavelengths)
            cosine = dr.maximum(dr.abs(wo.z), LEAST_COSINE)
            sent = luminance(carried * dr.gather(mi.Color3f, self._flux, chosen, looks)) * density / cosine
            worth = luminance(carried * dr.gather(mi.Color3f, self._radiance, chosen, looks)) / pdf
            slot = lane * VERTICES + step
            dr.scatter(out_luminance, sent, slot, looks)
            dr.scatter(out_worth, worth, slot, looks)
            dr.scatter(out_arrival, chosen, slot, looks)

            # ------------------------------ Next ray ------------------------------

            u_lobe = sequence.point(mi.UInt32(0), 3 + 2 * step)
            u_direction = sequence.point(mi.UInt32(0), 4 + 2 * step)
            goes_on = active & ~passes_through
            bs, weight = kernel.directions.sample(bsdf, ctx, si, u_lobe.x, u_direction, goes_on)
            throughput[goes_on] = throughput * weight
            next_direction = dr.select(passes_through, direction, si.to_world(bs.wo))
            origin, direction, start = rays.origin(si, next_direction), next_direction, met.surface
            eta[goes_on] = eta * bs.eta
            depth[goes_on] = depth + 1
            step += 1
            active &= dr.any(throughput != 0) & (step < VERTICES)

            # ------------------------------ Roulette, as the kernel plays it ------------------------------

            if dr.hint(self.kernel.model.has_roulette, mode="scalar"):
                carried_on = roulette.carried(throughput, eta)
                is_first = goes_on & (typical == 0) & ~mi.has_flag(bs.sampled_type, mi.BSDFFlags.Delta)
                typical[is_first] = carried_on
                is_bounded = depth_limit != 0xFFFFFFFF
                survival = roulette.survival_probability(carried_on, typical, depth, rr_depth, is_bounded)
                plays = goes_on & (depth >= roulette.first_play(rr_depth))
                active &= ~plays | (u_lobe.y < survival)
                throughput[plays] = throughput / survival
        return out_luminance, out_worth, out_arrival

    def _pick(self, p: Any, normal: Any, batch: Any, key: Any, active: Any) -> tuple[Any, Any, Any]:
        """One of the arrivals near p, drawn by what it carries; its share of 1/area, in place of the sum over all; and
        whether there is one."""
        corner = dr.floor((p - self.radius) / (2 * self.radius))
        chosen, total, taken = mi.UInt32(0), mi.Float(0), mi.Float(1)
        for k in range(8):
            cell = [mi.Int32(corner[i]) + (k >> i & 1) for i in range(3)]
            wanted = _hashed(mi.UInt32(cell[0]), mi.UInt32(cell[1]), mi.UInt32(cell[2]), batch)
            bucket = wanted & (2**BUCKETS_BITS - 1)
            first = dr.gather(mi.UInt32, self._starts, bucket, active)
            count = dr.gather(mi.UInt32, self._starts, bucket + 1, active) - first
            draw = mix(key + ((0x9E3779B9 * (k + 1)) & 0xFFFFFFFF))
            there = active & (count > 0)
            one = first + dr.minimum(mi.UInt32(unit(draw, mi.Float) * mi.Float(count)), dr.maximum(count, 1) - 1)
            away = dr.gather(mi.Point3f, self._p, one, there) - p
            flux = dr.gather(mi.Color3f, self._flux, one, there)
            there &= dr.gather(mi.UInt32, self._keys, one, there) == wanted
            there &= dr.squared_norm(away) < dr.square(self.radius)
            there &= dr.abs(dr.dot(away, normal)) < FLAT * self.radius
            cosine: Any = dr.dot(dr.gather(mi.Normal3f, self._n, one, there), normal)
            there &= dr.square(cosine) > FACING**2
            weight = dr.select(there, luminance(flux) * mi.Float(count), 0)
            total += weight
            takes = there & (unit(mix(draw ^ 0x68BC21EB), mi.Float) * total < weight)
            chosen[takes], taken[takes] = one, luminance(flux)
        return chosen, total / (taken * (dr.pi * dr.square(self.radius))), active & (total > 0)


def luminance(colour: Any) -> Any:
    """Of linear sRGB; infinite where a part of it is."""
    return sum(factor * part for factor, part in zip(LUMINANCE, colour, strict=True))


def rgb_of(throughput: Any, wavelengths: Any) -> Any:
    """What is carried, as a colour; between different wavelengths its mean has to do."""
    return mi.Color3f(dr.mean(throughput)) if mi.is_spectral else rgb(throughput, wavelengths)


def _hashed(x: Any, y: Any, z: Any, batch: Any) -> Any:
    return mix(mix(mix(mix(x + 0x9E3779B9) ^ y) + 0x85EBCA6B * z) ^ batch)


def _keys_of(arrivals: Arrivals, radius: float) -> NDArray[np.uint32]:
    """(n,) hash of the cell and batch of each arrival, as the kernel computes it."""
    cells = [table_of(np.floor(arrivals.p[:, i] / np.float32(2 * radius)).astype(np.int32)) for i in range(3)]
    if len(arrivals.p) == 0:
        return np.zeros(0, np.uint32)
    return np.array(_hashed(cells[0], cells[1], cells[2], mi.UInt32(arrivals.batch)), np.uint32)


def table_of(values: NDArray[np.int32]) -> Any:
    """Whole numbers of either sign, as the bits that a kernel sees."""
    return mi.UInt32(values.view(np.uint32))
