"""The replicate kernel: the path-tracing estimator of the rendering equation.

Enters: lanes, each a (pixel, replicate). Leaves: per lane the mean radiance of its `replicate_size` samples and the
number of samples that were not finite. A lane runs its samples one after the other and starts the next as soon as a
path ends, with the sum in registers: memory does not grow with samples, and no lane waits for another's long path.

    L(p, ωo) = Le(p, ωo) + ∫ f(p, ωi, ωo) L(r(p, ωi), −ωi) cosθi dωi

The techniques differ in how ωi is drawn (see `techniques.py`). Source: Kajiya 1986; Veach 1997; pbrt-v4 ch. 13–14.
`oracle.py` holds the same mathematics without the tricks.
"""

from __future__ import annotations

import copy
import gc
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import drjit as dr

from renderer.backend import mitsuba, using
from renderer.equation import roulette
from renderer.equation.camera import camera_of
from renderer.equation.emitters import EmitterSampler
from renderer.equation.filter import PixelFilter
from renderer.equation.loaded import loaded_scenes, note_loaded
from renderer.equation.matte import Matte
from renderer.equation.mis import power_heuristic
from renderer.equation.primitives import listed
from renderer.equation.rays import NOWHERE, ListRays, TreeRays
from renderer.equation.sequence import Sequence
from renderer.equation.tables import arrays_in, table
from renderer.equation.techniques import Directions

mi: Any = mitsuba()

# Dimension pairs: the camera takes the first three, each path vertex three more.
PIXEL, LENS, TIME_AND_WAVELENGTH = 0, 1, 2
PER_VERTEX = 3
EMITTER, BSDF_DIRECTION, LOBE_AND_ROULETTE = 0, 1, 2

NO_LIMIT = 0xFFFFFFFF
RECORDINGS = 4  # kept by a kernel
Sizes = tuple[Any, ...]  # width, height, replicate size, depth limit, roulette depth


@dataclass(frozen=True, slots=True)
class Model:
    """What the kernel contains. Features are Python `if`s while tracing: what is absent is not in the kernel.

    technique: see `Settings`. max_depth: −1 = unlimited. rr_depth: see `roulette`.
    has_sampleable_emitters: whether emitter sampling can find anything. hide_emitters: lights unseen by the camera.
    has_lens: whether the camera has an aperture. splits_lobes: see `Directions`.
    has_transmission: whether light passes any surface. has_visible_emitters: whether a ray can hit a light (not where
    all are points and directions). needs_time: whether the picture depends on the time within the shutter's opening.
    has_delta: whether some directions are those of mirrors and clear glass. has_roulette: whether paths get so long.
    stratified: Owen-scrambled points, else independent ones. surveys_lights: choose among lights by the place.
    has_tree: whether rays find surfaces by Mitsuba's tree, else by trying all of the scene's few primitives. needs_uv:
    whether anything looks at texture coordinates or tangents.
    """

    technique: str
    max_depth: int
    rr_depth: int
    replicate_size: int
    has_sampleable_emitters: bool = True
    hide_emitters: bool = False
    has_lens: bool = True
    splits_lobes: bool = False
    has_transmission: bool = True
    has_visible_emitters: bool = True
    needs_time: bool = True
    has_delta: bool = True
    has_roulette: bool = True
    stratified: bool = True
    surveys_lights: bool = True
    has_tree: bool = True
    needs_uv: bool = True

    @property
    def samples_emitters(self) -> bool:
        """Whether the kernel samples points on emitters (the area form)."""
        return self.technique in ("mis", "emitter") and self.has_sampleable_emitters and self.max_depth not in (0, 1)


class PathKernel:
    """Compiled once per (scene, model); `launch` runs it over any lanes without compiling again."""

    def __init__(self, scene: Any, sensor: Any, size: tuple[int, int], model: Model) -> None:
        self.variant: str = mi.variant()
        self.mitsuba_scene = scene
        note_loaded(self)
        self.camera = camera_of(sensor)
        self.model = model
        self.filter = PixelFilter(mi, sensor.film().rfilter())
        shapes = list(scene.shapes())
        matte = Matte([s.bsdf() for s in shapes], not any(s.class_name() == "Instance" for s in shapes))
        self.directions = Directions(model.technique, model.splits_lobes, matte)
        self.rays = TreeRays(scene) if model.has_tree else ListRays(scene, listed(scene), model.needs_uv)
        surveys = model.samples_emitters and model.surveys_lights
        self.emitters = EmitterSampler(scene, sensor if surveys else None, is_helped=model.technique == "mis")
        self.samples_emitters = model.samples_emitters and not self.emitters.is_empty
        # Sensors take positions relative to the crop window, of which `size` is the number of pixels.
        # Opaque, so that one compiled kernel serves all sizes and depths.
        depth_limit = NO_LIMIT if model.max_depth < 0 else model.max_depth
        numbers = (*size, model.replicate_size, depth_limit, model.rr_depth)
        self.sizes: Sizes = tuple(dr.opaque(mi.UInt32, n) for n in numbers)
        self.shutter_open = float(sensor.shutter_open())
        self.shutter_time = float(sensor.shutter_open_time())
        # Traced once and replayed: tracing a pass anew takes as long as rendering a small one.
        ours = self.camera, self.filter, self.directions, self.emitters, self.rays
        state = (scene, sensor, arrays_in(*ours))
        # Dr.Jit's calls reach the plugins of all scenes of the process: another scene is another recording.
        self._replayed: Any = dr.freeze(
            self._run,
            state_fn=lambda *_: (state, loaded_scenes(self.variant)),
            limit=RECORDINGS,
            warn_after=2**31 - 1,
        )

    def with_replicates_of(self, size: int) -> PathKernel:
        """This kernel for replicates of another size: nothing is traced or compiled anew."""
        other = copy.copy(self)
        other.model = replace(self.model, replicate_size=size)
        other.sizes = (*self.sizes[:2], dr.opaque(mi.UInt32, size), *self.sizes[3:])
        return other

    def launch(self, pixels: Any, replicates: Any, seed: int) -> tuple[Any, Any, Any]:
        """Starts one pass; reading the returned arrays waits for it.

        pixels, replicates: (n,) uint32, row-major pixel index and replicate index of each lane.
        Returns radiance: Color3f of n, the mean of the finite samples; invalid: UInt32 of n, samples not finite;
        segments: UInt32 of n, of all its paths: what the lane cost.
        """
        low, high = dr.opaque(mi.UInt32, seed & 0xFFFFFFFF), dr.opaque(mi.UInt32, seed >> 32)
        with dr.suspend_grad(), using(self.variant), _collector_paused():
            lanes = self._replay(table(pixels, mi.UInt32), table(replicates, mi.UInt32), low, high, self.sizes)
        dr.eval(*lanes)  # apart from what reads them: else their number would be compiled into the kernel
        return lanes

    @property
    def is_recorded(self) -> bool:
        """Whether passes are replayed; else each is traced anew."""
        return hasattr(self._replayed, "n_recordings")

    def _replay(self, *arguments: Any) -> Any:
        try:
            return self._replayed(*arguments)
        except RuntimeError as error:
            if not str(error.__cause__).startswith("record()"):
                raise
            # Some of Mitsuba's sensors and emitters keep numbers where a recording cannot find them.
            self._replayed = self._run
            return self._run(*arguments)

    @dr.syntax
    def _run(self, pixel: Any, replicate: Any, seed_low: Any, seed_high: Any, sizes: Sizes) -> Any:
        rays = self.rays
        width, height, replicate_size, depth_limit, rr_depth = sizes
        key_a, key_b = Sequence.keys(seed_low, seed_high, pixel, replicate)
        sequence = Sequence(mi, key_a, key_b, replicate_size, self.model.stratified)
        column, row = mi.Float(pixel % width), mi.Float(pixel // width)
        ctx = mi.BSDFContext()

        # ------------------------------ Loop state ------------------------------

        index = mi.UInt32(0)  # which sample of the replicate
        depth = mi.UInt32(0)  # of the vertex about to be found
        is_new = mi.Bool(True)  # the next ray is a camera ray
        origin = mi.Point3f(0)  # next ray
        direction = mi.Vector3f(0)
        start = mi.UInt32(NOWHERE)  # the surface that the next ray starts on
        time = mi.Float(0)
        wavelengths = dr.zeros(mi.Ray3f).wavelengths
        prev_p = mi.Point3f(0)  # vertex before, as the emitter pdf needs it
        prev_pdf = mi.Float(0)  # solid-angle density of `direction` at that vertex
        prev_delta = mi.Bool(True)  # `direction` could not have been found by emitter sampling
        prev_place = mi.UInt32(0)  # of the vertex before, for the choice among lights
        throughput = mi.Spectrum(1)
        eta = mi.Float(1)  # product of relative indices of refraction
        typical = mi.Float(0)  # what the path carried behind its first surface that is no mirror or clear glass
        radiance = mi.Spectrum(0)  # of the current sample
        total = mi.Color3f(0)  # of the finished samples
        invalid = mi.UInt32(0)
        segments = mi.UInt32(0)
        active = mi.Bool(True)

        while dr.hint(active, label="replicate"):
            # ------------------------------ Camera ray ------------------------------

            offset, filter_weight = self.filter.sample(sequence.point(index, PIXEL))
            position = (mi.Point2f(column, row) + offset) / mi.Vector2f(mi.Float(width), mi.Float(height))
            lens = sequence.point(index, LENS) if dr.hint(self.model.has_lens, mode="scalar") else mi.Point2f(0.5)
            extra = mi.Point2f(0.5)
            if dr.hint(self.model.needs_time or mi.is_spectral, mode="scalar"):
                extra = sequence.point(index, TIME_AND_WAVELENGTH)
            camera_ray, camera_weight = self.camera.sample_ray(
                self.shutter_open + self.shutter_time * extra.x, extra.y, position, lens, is_new
            )
            origin[is_new] = camera_ray.o
            direction[is_new] = camera_ray.d
            if dr.hint(self.model.needs_time, mode="scalar"):
                time[is_new] = camera_ray.time
            if dr.hint(mi.is_spectral, mode="scalar"):
                wavelengths[is_new] = camera_ray.wavelengths
            if dr.hint(rays.tracks_surfaces, mode="scalar"):
                start[is_new] = NOWHERE
            throughput[is_new] = camera_weight * filter_weight
            if dr.hint(self.model.has_roulette, mode="scalar"):
                typical[is_new] = 0
            if dr.hint(self.model.has_transmission, mode="scalar"):
                eta[is_new] = 1
            if dr.hint(self.model.has_delta, mode="scalar"):
                prev_delta[is_new] = True
            radiance[is_new] = 0

            # ------------------------------ Next vertex ------------------------------

            ray = mi.Ray3f(origin, direction, time, wavelengths)
            ray.maxt = dr.select(is_new, camera_ray.maxt, ray.maxt)  # the camera's far plane
            met = rays.meet(ray, start, active)
            si, bsdf = met.si, met.bsdf
            segments += 1

            # ------------------------------ Emission ------------------------------

            if dr.hint(self.model.has_visible_emitters, mode="scalar"):
                emitter = met.emitter
                sees_emitter = active & (emitter != None)  # noqa: E711 (a Dr.Jit comparison)
                if dr.hint(self.model.hide_emitters, mode="scalar"):
                    sees_emitter &= depth != 0
                # The camera's rays and those of mirrors could not have been found from the light's side.
                is_alone = prev_delta if dr.hint(self.model.has_delta, mode="scalar") else depth == 0
                spot = self.emitters.spot(ray.d, emitter, sees_emitter)
                weight_hit = mi.Float(1)
                if dr.hint(self.samples_emitters, mode="scalar"):
                    if dr.hint(self.model.technique == "emitter", mode="scalar"):
                        weight_hit = dr.select(is_alone, 1, 0)
                    else:
                        ref = dr.zeros(mi.Interaction3f)
                        ref.p = prev_p
                        ref.time = time
                        ds_hit = mi.DirectionSample3f(self.mitsuba_scene, si, ref)
                        ds_hit.emitter = emitter
                        pdf_em = self.emitters.pdf(ref, ds_hit, sees_emitter & ~is_alone, prev_place, spot)
                        weight_hit = dr.select(is_alone, 1, power_heuristic(prev_pdf, pdf_em))
                emission = self.emitters.emission(si, emitter, sees_emitter, spot)
                radiance[sees_emitter] = radiance + throughput * weight_hit * emission

            # ------------------------------ Go on? ------------------------------

            passes_through = mi.Bool(False)
            if dr.hint(self.model.hide_emitters, mode="scalar"):
                # The camera looks through area lights: same sample, same depth, from behind the light.
                passes_through = active & (depth == 0) & si.is_valid() & (si.shape.emitter() != None)  # noqa: E711
            active_next = active & si.is_valid() & (depth + 1 < depth_limit)

            # ------------------------------ Sampling ------------------------------

            vertex = PER_VERTEX * (depth + 1)
            lobe_and_roulette = sequence.point(index, vertex + LOBE_AND_ROULETTE)
            u_direction = sequence.point(index, vertex + BSDF_DIRECTION)
            contribution = mi.Spectrum(0)
            active_em = mi.Bool(False)
            ref_em = dr.zeros(mi.Interaction3f)
            ds = dr.zeros(mi.DirectionSample3f)
            passes = None
            active_next &= ~passes_through
            if dr.hint(self.samples_emitters, mode="scalar"):
                # Emitter sampling: a point on a light; visibility last, and only where it can matter.
                active_em = mi.Bool(active_next)
                if dr.hint(self.model.has_delta, mode="scalar"):
                    active_em &= mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)
                # It is seen from where the next ray starts, a hair above the surface: then both techniques have the
                # same directions to find it, and their weights sum to one even where a light touches the surface.
                ref_em.p = rays.origin(si, -ray.d)
                if dr.hint(self.model.has_transmission, mode="scalar"):
                    passes = mi.has_flag(bsdf.flags(), mi.BSDFFlags.Transmission)
                    ref_em.p = dr.select(passes, si.p, ref_em.p)
                ref_em.time, ref_em.wavelengths = si.time, si.wavelengths
                u_light = sequence.point(index, vertex + EMITTER)
                place = mi.UInt32(0)
                if dr.hint(self.emitters.knows_places, mode="scalar"):
                    facing = dr.select(dr.dot(si.n, ray.d) > 0, -si.n, si.n)
                    place = self.emitters.place(si.p, facing, active_em)
                    prev_place[active_next] = place
                ds, emitter_weight = self.emitters.sample(ref_em, u_light, active_em, place)
                active_em &= ds.pdf != 0
                wo = si.to_local(ds.d)
                value, pdf, bs, bsdf_weight = self.directions.eval_pdf_sample(
                    bsdf, ctx, si, wo, lobe_and_roulette.x, u_direction, active_next
                )
                weight_em = mi.Float(1)
                if dr.hint(self.model.technique == "mis" and self.model.has_visible_emitters, mode="scalar"):
                    weight_em = dr.select(ds.delta, 1, power_heuristic(ds.pdf, pdf))
                contribution = throughput * si.to_world_mueller(value, -wo, si.wi) * emitter_weight * weight_em
                active_em &= dr.any(contribution != 0)
            else:
                # Direction sampling alone: by the BSDF, or uniform or cosine for comparison.
                bs, bsdf_weight = self.directions.sample(bsdf, ctx, si, lobe_and_roulette.x, u_direction, active_next)

            # ------------------------------ Visibility ------------------------------

            if dr.hint(self.samples_emitters, mode="scalar"):
                is_visible = ~rays.is_blocked(si, ref_em.p, ds, passes, met.surface, active_em)
                radiance[active_em & is_visible] = radiance + contribution

            # ------------------------------ Update ------------------------------

            next_direction = si.to_world(bs.wo)
            if dr.hint(self.model.hide_emitters, mode="scalar"):
                next_direction[passes_through] = ray.d
            next_origin = rays.origin(si, next_direction)
            throughput[active_next] = throughput * bsdf_weight
            if dr.hint(self.model.has_transmission, mode="scalar"):
                eta[active_next] = eta * bs.eta
            origin = next_origin
            direction = next_direction
            if dr.hint(rays.tracks_surfaces, mode="scalar"):
                start = met.surface
            if dr.hint(self.model.has_transmission, mode="scalar"):
                prev_p[active_next] = dr.select(mi.has_flag(bsdf.flags(), mi.BSDFFlags.Transmission), si.p, next_origin)
            else:
                prev_p[active_next] = next_origin
            prev_pdf[active_next] = bs.pdf
            if dr.hint(self.model.has_delta, mode="scalar"):
                prev_delta[active_next] = mi.has_flag(bs.sampled_type, mi.BSDFFlags.Delta)
            depth[active_next] = depth + 1

            # ------------------------------ Stopping ------------------------------

            active_next &= dr.any(throughput != 0)
            if dr.hint(self.model.has_roulette, mode="scalar"):
                carried = roulette.carried(throughput, eta)
                is_first = active_next & (typical == 0)
                if dr.hint(self.model.has_delta, mode="scalar"):
                    is_first &= ~prev_delta
                typical[is_first] = carried
                survival = roulette.survival_probability(carried, typical, depth, rr_depth, depth_limit != NO_LIMIT)
                plays = depth >= roulette.first_play(rr_depth)
                active_next &= ~plays | (lobe_and_roulette.y < survival)
                throughput[plays] = throughput / survival
            active_next |= passes_through

            # ------------------------------ Next sample ------------------------------

            ended = active & ~active_next
            rgb = self.to_rgb(radiance, wavelengths)
            is_finite = dr.all(dr.isfinite(rgb))
            total[ended & is_finite] = total + rgb
            invalid[ended & ~is_finite] = invalid + 1
            index[ended] = index + 1
            depth[ended] = 0
            is_new = ended
            active &= index < replicate_size

        valid = mi.Float(replicate_size - invalid)
        return dr.select(valid > 0, total / valid, 0), invalid, segments

    @staticmethod
    def to_rgb(radiance: Any, wavelengths: Any) -> Any:
        """Linear sRGB of a radiance sample."""
        if mi.is_monochromatic:
            return mi.Color3f(radiance.x)
        if mi.is_spectral:
            return mi.spectrum_to_srgb(radiance, wavelengths)
        return mi.Color3f(radiance)


@contextmanager
def _collector_paused() -> Iterator[None]:
    """No garbage is collected inside: a scene that is freed while a kernel is recorded would end the process."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()
