"""How fast a scene's rays could be cast if nothing else had to be done.

Paths are walked by the rules of the kernel, one vertex at a time, and their rays are kept. Then the same rays are cast
alone, by pure `ray_intersect` and `ray_test`: a kernel that spends no time on anything else would take that long.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

import renderer
from renderer.backend import mitsuba, using
from renderer.equation import roulette

mi: Any = mitsuba()
PATHS = 2**18
MOST_VERTICES = 64  # paths of more are rare, and then few rays are left


class RayCasts:
    """The rays of PATHS camera paths. rays: per camera path, shadow rays included."""

    def __init__(self, scene: renderer.Scene) -> None:
        self.scene = scene
        with using(scene.variant), dr.suspend_grad():
            found, shadows = _rays(scene)
            # Cast at once: launching a kernel for each depth takes longer than casting the few rays of late ones.
            self.found, self.shadows = ([_joined(rays)] if rays else [] for rays in (found, shadows))
            self.rays = sum(dr.width(ray.o) for ray in self.found + self.shadows) / PATHS
            self.seconds()  # compiles

    def seconds(self) -> float:
        """That the rays of one camera path take when cast alone."""
        with using(self.scene.variant):
            return _cast(self.scene.mitsuba_scene, self.found, self.shadows) / PATHS


def _cast(scene: Any, found: list[Any], shadows: list[Any]) -> float:
    """Seconds in kernels: writing down what they shall do takes longer than casting a few rays."""
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        sums = []
        for ray in found:
            si = scene.ray_intersect(ray)
            # All of the interaction is wanted, as the kernel wants it.
            sums.append(dr.sum(dr.select(si.is_valid(), si.t + si.n.x + si.sh_frame.n.x + si.uv.x + si.wi.z, 0)))
        sums += [dr.sum(mi.Float(scene.ray_test(ray))) for ray in shadows]
        dr.eval(sums)
        dr.sync_thread()
        return sum(kernel["execution_time"] for kernel in dr.kernel_history()) / 1000


def _rays(scene: renderer.Scene) -> tuple[list[Any], list[Any]]:
    """Rays to the next vertex, and shadow rays, of PATHS camera paths: one array for each depth."""
    settings = scene.resolved(renderer.Settings(width=scene.width, height=scene.height), 16)
    kernel, model = scene.kernel(settings), scene.model(settings)
    rng = mi.PCG32(PATHS)

    def pair() -> Any:
        return mi.Point2f(rng.next_float32(), rng.next_float32())

    # A grid of pixels in their order: what is neighbours in memory is neighbours on the film, as in a pass.
    side = int(np.sqrt(PATHS))
    index = dr.arange(mi.UInt32, PATHS)
    position = mi.Point2f(mi.Float(index % side), mi.Float(index // side)) + pair()
    ray, throughput = kernel.camera.sample_ray(kernel.shutter_open, rng.next_float32(), position / side, pair(), True)
    throughput, eta, typical = mi.Spectrum(throughput), mi.Float(1), mi.Float(0)
    limit = model.max_depth if model.max_depth >= 0 else MOST_VERTICES
    found, shadows = [], []
    for depth in range(limit):
        found.append(mi.Ray3f(ray))
        si = scene.mitsuba_scene.ray_intersect(ray)
        bsdf = si.bsdf()
        active = si.is_valid() & dr.opaque(mi.Bool, depth + 1 < limit)
        if kernel.samples_emitters:
            is_smooth = active & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)
            place = mi.UInt32(0)
            if kernel.emitters.knows_places:
                facing = dr.select(dr.dot(si.n, ray.d) > 0, -si.n, si.n)
                place = kernel.emitters.place(si.p, facing, is_smooth)
            ds, weight = kernel.emitters.sample(si, pair(), is_smooth, place)
            value = bsdf.eval(mi.BSDFContext(), si, si.to_local(ds.d), is_smooth)
            matters = is_smooth & (ds.pdf != 0) & dr.any(value * weight != 0)
            shadows.append(_only(si.spawn_ray_to(ds.p), matters))
        bs, weight = bsdf.sample(mi.BSDFContext(), si, rng.next_float32(), pair(), active)
        throughput, eta = throughput * weight, eta * bs.eta
        active &= dr.any(throughput != 0)
        is_smooth = ~mi.has_flag(bs.sampled_type, mi.BSDFFlags.Delta)
        typical = dr.select(is_smooth & (typical == 0), roulette.carried(throughput, eta), typical)
        u = rng.next_float32()
        if model.has_roulette and depth + 1 >= roulette.first_play(model.rr_depth):
            done, most = mi.UInt32(depth + 1), mi.UInt32(model.rr_depth)
            carried, is_limited = roulette.carried(throughput, eta), mi.Bool(model.max_depth >= 0)
            survival = roulette.survival_probability(carried, typical, done, most, is_limited)
            active &= u < survival
            throughput = throughput / survival
        following = si.spawn_ray(si.to_world(bs.wo))
        kept: Any = dr.compress(active)
        if dr.width(kept) == 0:
            break
        ray = _gathered(following, kept)
        throughput, eta = dr.gather(mi.Spectrum, throughput, kept), dr.gather(mi.Float, eta, kept)
        typical = dr.gather(mi.Float, typical, kept)
        rng = mi.PCG32(dr.width(kept), initstate=dr.opaque(mi.UInt64, depth + 1))
    return found, [ray for ray in shadows if dr.width(ray.o) > 0]


def _joined(rays: list[Any]) -> Any:
    """One array of all."""

    def whole(*parts: Any) -> NDArray[np.float32]:
        widths = [dr.width(ray.o) for ray in rays]
        rows = (np.atleast_2d(np.array(part, np.float32)) for part in parts)
        return np.concatenate([np.broadcast_to(r, (len(r), n)) for r, n in zip(rows, widths, strict=True)], axis=1)

    o, d = whole(*(ray.o for ray in rays)), whole(*(ray.d for ray in rays))
    ray = mi.Ray3f(mi.Point3f(o), mi.Vector3f(d), mi.Float(whole(*(ray.time for ray in rays))[0]), rays[0].wavelengths)
    ray.maxt = mi.Float(whole(*(ray.maxt for ray in rays))[0])
    dr.eval(ray)
    return ray


def _only(ray: Any, active: Any) -> Any:
    return _gathered(ray, dr.compress(active))


def _gathered(ray: Any, index: Any) -> Any:
    parts = dr.gather(mi.Point3f, ray.o, index), dr.gather(mi.Vector3f, ray.d, index)
    n = dr.width(ray.o)
    maxt, time_, wavelengths = (x + dr.zeros(type(x), n) for x in (ray.maxt, ray.time, ray.wavelengths))
    chosen = mi.Ray3f(*parts, dr.gather(mi.Float, time_, index), dr.gather(type(wavelengths), wavelengths, index))
    chosen.maxt = dr.gather(mi.Float, maxt, index)
    dr.eval(chosen)
    return chosen
