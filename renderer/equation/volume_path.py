"""The replicate kernel for scenes with participating media: a vertex is a point on a surface or in a medium.

What enters, what leaves and how lanes run is as in `path.py`; the volume term that is added is in `media.py`. A turn of
the loop takes a path to its next event: a vertex, a surface that lets it pass unchanged (null), or `STEPS` tentative
collisions on the way. All of them count as segments, so that a launch is bounded however dense a medium is. As in
Mitsuba's `volpath`, depth counts vertices: surfaces that are passed unchanged are none.

What the camera sees of lights along its straight line is not left to chance: the line is followed to its end, through
everything that lets light pass, and each light on it counts by its transmittance. So behind a slab of optical depth 20
there is exp(−20) of a light, and not nothing, most of the time.

The random numbers of a vertex come from the replicate's points, like those of surfaces; what has no bound (tentative
collisions, shadow rays, passed surfaces) from a stream by number (`media.Stream`), of which a lane carries the number.
"""

from __future__ import annotations

from typing import Any

import drjit

from renderer.backend import mitsuba
from renderer.equation import roulette
from renderer.equation.media import NO_MEDIUM, Media, Stream
from renderer.equation.path import (
    BSDF_DIRECTION,
    EMITTER,
    LOBE_AND_ROULETTE,
    NO_LIMIT,
    SEGMENTS_PER_SAMPLE,
    Before,
    Model,
    PathKernel,
    Sizes,
)
from renderer.equation.rays import NOWHERE
from renderer.equation.sequence import Sequence

dr: Any = drjit  # its overloads, in a loop of so many variables, take a type checker minutes
mi: Any = mitsuba()

DISTANCE = 3  # the pair of dimensions that a vertex has beside those of a surface
PER_VERTEX = 4


class VolumeKernel(PathKernel):
    """As `PathKernel`."""

    def __init__(self, scene: Any, sensor: Any, size: tuple[int, int], model: Model) -> None:
        super().__init__(scene, sensor, size, model)
        flags = [shape.bsdf().flags() for shape in scene.shapes() if shape.bsdf() is not None]
        # Surfaces that let light pass, or scatter it: only they draw a lobe without being a vertex for sure.
        self.mixes_null = any(mi.has_flag(f, mi.BSDFFlags.Null) and f & self.real_lobes for f in flags) or any(
            shape.class_name() == "Instance" for shape in scene.shapes()
        )

        # A meter looks along no line; what is hidden is not looked for.
        self.looks_straight = model.has_visible_emitters and not model.hide_emitters and not model.is_meter

    def _media_of(self, scene: Any, sensor: Any) -> Media:
        return Media(scene, sensor.get_medium())

    def extra_state(self, n: int) -> tuple[Any, ...]:
        """What a lane carries beside the state of `PathKernel`, at the beginning of a sample, as `_run` orders it."""
        return dr.zeros(mi.UInt32, n), dr.zeros(mi.UInt32, n), dr.full(mi.Bool, True, n), dr.full(mi.Bool, True, n)

    @dr.syntax
    def _run(self, pixel: Any, replicate: Any, seed: tuple[Any, Any], sizes: Sizes, suspended: Any, kept: Any) -> Any:
        """As of `PathKernel`."""
        rays, media = self.rays, self.media
        width, height, replicate_size, depth_limit, rr_depth = sizes
        key_a, key_b = Sequence.keys(*seed, pixel, replicate)
        sequence = Sequence(mi, key_a, key_b, replicate_size, self.model.stratified)
        stride = width + 2 * self.reach
        square = mi.Point2f(mi.Float(pixel % stride) - self.reach, mi.Float(pixel // stride) - self.reach)
        film_size = mi.Vector2f(mi.Float(width), mi.Float(height))
        ctx = mi.BSDFContext()

        # ------------------------------ Loop state ------------------------------

        medium = mi.UInt32(NO_MEDIUM)  # the one that the next ray is in
        drawn = mi.UInt32(0)  # numbers of the sample's stream that were taken
        is_first_stretch = mi.Bool(True)  # no distance was drawn since the last vertex
        is_first_surface = mi.Bool(True)  # no lobe was drawn since the last vertex
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
        is_straight = mi.Bool(True)  # kept for the common order of states: depth says it here
        throughput = mi.Spectrum(1)
        eta = mi.Float(1)  # product of relative indices of refraction
        typical = mi.Float(0)  # what the path carried behind its first vertex that is no mirror or clear glass
        radiance = mi.Spectrum(0)  # of the current sample
        total = mi.Color3f(0)  # of the finished samples
        invalid = mi.UInt32(0)
        segments = mi.UInt32(0)
        active = mi.Bool(True)
        until = replicate_size * SEGMENTS_PER_SAMPLE
        if dr.hint(suspended is not None, mode="scalar"):
            # All that is declared above, in the order of `state` below.
            until, state = suspended
            medium, drawn, is_first_stretch, is_first_surface = dr.copy(state[:4])
            index, depth, is_new, origin, direction, start, time, wavelengths = dr.copy(state[4:12])
            prev_p, prev_pdf, prev_delta, prev_place, is_straight = dr.copy(state[12:17])
            throughput, eta, typical, radiance, total, invalid, segments, active = dr.copy(state[17:])

        # A turn may have many segments: the number wraps, their difference does not.
        while dr.hint(active & (mi.Int32(until - segments) > 0), label="replicate"):
            # ------------------------------ Camera ray ------------------------------

            film_sample = index, replicate, seed, kept
            camera_ray, camera_weight, position = self._camera_ray(sequence, film_sample, square, film_size, is_new)
            origin[is_new] = camera_ray.o
            direction[is_new] = camera_ray.d
            if dr.hint(self.model.needs_time, mode="scalar"):
                time[is_new] = camera_ray.time
            if dr.hint(mi.is_spectral, mode="scalar"):
                wavelengths[is_new] = camera_ray.wavelengths
            start[is_new] = NOWHERE
            throughput[is_new] = camera_weight
            medium[is_new] = media.sensor_key
            drawn[is_new] = 0
            is_first_stretch[is_new] = True
            is_first_surface[is_new] = True
            typical[is_new] = 0
            eta[is_new] = 1
            prev_delta[is_new] = True
            radiance[is_new] = 0
            stream = Stream(key_a, key_b, index)

            # ------------------------------ Lights in the camera's line ------------------------------

            ray = mi.Ray3f(origin, direction, time, wavelengths)
            ray.maxt = dr.select(is_new, camera_ray.maxt, ray.maxt)  # the camera's far plane
            if dr.hint(self.looks_straight, mode="scalar"):
                seen, drawn, segments = self._seen_straight(ray, medium, stream, drawn, segments, active & is_new)
                radiance[is_new] = throughput * seen

            # ------------------------------ Next event ------------------------------

            is_within = active & (medium != NO_MEDIUM)
            if dr.hint(self.model.is_meter, mode="scalar"):
                is_within &= ~is_new  # the first vertex is on the metered surface, and nothing is before it
            t = mi.Float(dr.inf)
            far = mi.Float(ray.maxt)
            if dr.hint(media.has_homogeneous, mode="scalar"):
                u_distance = self._point(sequence, stream, index, depth, DISTANCE, drawn, is_first_stretch)
                drawn[is_within & ~is_first_stretch] = drawn + 2
                t = media.free_path(ray, medium, throughput, u_distance, is_within)
                ray.maxt = dr.minimum(ray.maxt, t)
            met = self._vertex(ray, start, position, is_new, active)
            si, bsdf = met.si, met.bsdf
            segments += 1
            is_scattered = mi.Bool(False)
            is_under_way = mi.Bool(False)
            mei = dr.zeros(mi.MediumInteraction3f)
            if dr.hint(media.has_homogeneous, mode="scalar"):
                end = dr.minimum(si.t, far)
                mei, weight = media.collide_evenly(ray, medium, throughput, t, end, is_within)
                is_scattered = is_within & (t < end)
                throughput[is_within] = throughput * weight
            if dr.hint(media.has_grids, mode="scalar"):
                end = dr.minimum(si.t, far)
                found = media.collide(ray, medium, throughput, end, stream, drawn, is_within)
                if dr.hint(media.has_homogeneous, mode="scalar"):
                    is_grid = is_within & ~media.is_homogeneous(medium)
                    mei = dr.select(is_grid, found.interaction, mei)
                else:
                    mei = found.interaction
                is_scattered |= found.is_real
                is_under_way = found.is_under_way
                throughput[is_within] = throughput * found.weight
                drawn = found.drawn
                segments += found.steps
            is_first_stretch &= ~is_within
            at_surface = active & ~is_scattered & ~is_under_way

            # ------------------------------ Emission ------------------------------

            # What the camera sees in its line has been counted, or is hidden.
            sees_emitter = at_surface & (met.emitter != None) & (depth > 0)  # noqa: E711 (a Dr.Jit comparison)
            before = Before(prev_p, time, prev_pdf, prev_delta, prev_place)
            radiance[sees_emitter] = radiance + self._emitted(throughput, met, before, sees_emitter)

            # ------------------------------ Go on? ------------------------------

            # The camera looks through area lights that are hidden: same sample, same depth, from behind the light.
            passes_through = self._passes_through(si, depth, at_surface)
            at_surface &= si.is_valid() & ~passes_through
            is_last = depth + 1 >= depth_limit
            is_scattered &= ~is_last
            lets_pass = at_surface & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Null)
            at_surface &= ~is_last | lets_pass
            at_vertex = is_scattered | at_surface

            # ------------------------------ Emitter sampling ------------------------------

            u_lobe = self._point(sequence, stream, index, depth, LOBE_AND_ROULETTE, drawn, is_first_surface)
            u_direction = self._point(sequence, stream, index, depth, BSDF_DIRECTION, drawn + 2, is_first_surface)
            contribution = mi.Spectrum(0)
            place = mi.UInt32(0)
            active_em, asks_in_medium, passes = mi.Bool(False), mi.Bool(False), mi.Bool(False)
            ref_em, ds = dr.zeros(mi.Interaction3f), dr.zeros(mi.DirectionSample3f)
            if dr.hint(self.samples_emitters, mode="scalar"):
                is_smooth = at_surface & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth) & ~is_last
                asks_in_medium = media.samples_emitters(medium, is_scattered)
                active_em = is_smooth | asks_in_medium
                passes = mi.has_flag(bsdf.flags(), mi.BSDFFlags.Transmission)
                ref_em.p = dr.select(is_scattered, mei.p, dr.select(passes, si.p, rays.origin(si, -met.direction)))
                ref_em.time, ref_em.wavelengths = time, wavelengths
                u_light = self._point(sequence, stream, index, depth, EMITTER, drawn + 4, is_first_surface)
                if dr.hint(self.emitters.knows_places, mode="scalar"):
                    # Points in media have no side that they are seen from.
                    facing = dr.select(dr.dot(si.n, met.direction) > 0, -si.n, si.n)
                    seen_p = dr.select(is_scattered, mei.p, si.p)
                    place = self.emitters.place(seen_p, dr.select(is_scattered, 0, facing), active_em)
                ds, emitter_weight = self.emitters.sample(ref_em, u_light, active_em, place)
                active_em &= ds.pdf != 0
                wo = si.to_local(ds.d)
                value, pdf, bs, bsdf_weight = self.directions.eval_pdf_sample(
                    bsdf, ctx, si, wo, u_lobe.x, u_direction, at_surface
                )
                phase_value, phase_pdf = media.eval_phase(medium, mei, ds.d, active_em & is_scattered)
                value = dr.select(is_scattered, phase_value, value)
                pdf = dr.select(is_scattered, phase_pdf, pdf)
                weight_em = self._weight_against_directions(ds, pdf)
                contribution = throughput * value * emitter_weight * weight_em
                active_em &= dr.any(contribution != 0)
            else:
                bs, bsdf_weight = self.directions.sample(bsdf, ctx, si, u_lobe.x, u_direction, at_surface)
            if dr.hint(self.mixes_null, mode="scalar"):
                drawn[at_vertex & ~is_first_surface] = drawn + 6

            # ------------------------------ Visibility ------------------------------

            if dr.hint(self.samples_emitters, mode="scalar"):
                beside = media.target(si, ds.d, medium, at_surface)
                shadow_start = dr.select(is_scattered, NOWHERE, met.surface)
                shadow_origin = dr.select(passes & at_surface, rays.origin(si, ds.d), ref_em.p)
                if dr.hint(self.model.has_null, mode="scalar"):
                    to_light = ds.p - shadow_origin
                    shadow_ray = mi.Ray3f(shadow_origin, dr.normalize(to_light), time, wavelengths)
                    rest = dr.norm(to_light) * mi.math.ShadowEpsilon
                    shadow_ray.maxt = dr.norm(to_light) - rest
                    passed, drawn, segments = self._transmitted(
                        shadow_ray, rest, shadow_start, beside, stream, drawn, segments, active_em
                    )
                else:
                    side = passes & at_surface
                    active_em &= ~rays.is_blocked(si, ref_em.p, ds, side, shadow_start, active_em)
                    shadow_ray = mi.Ray3f(shadow_origin, ds.d, time, wavelengths)
                    passed, drawn = media.transmittance(shadow_ray, beside, ds.dist, stream, drawn, active_em)
                radiance[active_em] = radiance + contribution * passed

            # ------------------------------ Next direction ------------------------------

            phase_wo, phase_weight, phase_pdf = self._sample_phase(medium, mei, u_lobe.x, u_direction, is_scattered)
            is_null = at_surface & mi.has_flag(bs.sampled_type, mi.BSDFFlags.Null)
            if dr.hint(self.mixes_null, mode="scalar"):
                # Some wrappers let light pass and stop shadow rays: passing them is a vertex, as of a mirror.
                is_null &= dr.any(bsdf.eval_null_transmission(si, is_null) != 0)
            at_surface &= ~is_last | is_null
            is_vertex = is_scattered | (at_surface & ~is_null)
            next_direction = dr.select(is_scattered, phase_wo, si.to_world(bs.wo))
            next_direction[is_null | passes_through | is_under_way] = ray.d
            next_origin = dr.select(is_scattered | is_under_way, mei.p, rays.origin(si, next_direction))
            throughput[is_scattered] = throughput * phase_weight
            throughput[at_surface] = throughput * bsdf_weight
            eta[at_surface] = eta * bs.eta
            medium = media.target(si, next_direction, medium, at_surface)

            # ------------------------------ Update ------------------------------

            if dr.hint(self.samples_emitters, mode="scalar"):
                prev_p[is_vertex] = ref_em.p
                prev_place[is_vertex] = place
                prev_delta[is_scattered] = ~asks_in_medium
            prev_pdf[is_vertex] = dr.select(is_scattered, phase_pdf, bs.pdf)
            prev_delta[is_vertex & ~is_scattered] = mi.has_flag(bs.sampled_type, mi.BSDFFlags.Delta)
            if dr.hint(self.mixes_null, mode="scalar"):
                is_first_surface &= ~(is_null & ((bsdf.flags() & self.real_lobes) != 0))
                is_first_surface |= is_vertex
            is_first_stretch |= is_vertex
            depth[is_vertex] = depth + 1
            origin = next_origin
            direction = next_direction
            start = dr.select(is_scattered | is_under_way, NOWHERE, met.surface)
            active_next = active & (is_vertex | is_null) & dr.any(throughput != 0)

            # ------------------------------ Stopping ------------------------------

            if dr.hint(self.model.has_roulette, mode="scalar"):
                carried = roulette.carried(throughput, eta)
                typical[is_vertex & (typical == 0) & (is_scattered | ~prev_delta)] = carried
                survival = roulette.survival_probability(carried, typical, depth, rr_depth, depth_limit != NO_LIMIT)
                plays = is_vertex & (depth >= roulette.first_play(rr_depth))
                active_next &= ~plays | (u_lobe.y < survival)
                throughput[plays] = throughput / survival
            active_next |= active & (passes_through | is_under_way)

            # ------------------------------ Next sample ------------------------------

            ended = active & ~active_next
            rgb, is_finite = self._developed(radiance, wavelengths, film_sample, ended)
            total[ended & is_finite] = total + rgb
            invalid[ended & ~is_finite] = invalid + 1
            index[ended] = index + 1
            depth[ended] = 0
            is_new = ended
            active &= index < replicate_size

        valid = mi.Float(replicate_size - invalid)
        mean = dr.select(valid > 0, total / valid, 0)
        state = (medium, drawn, is_first_stretch, is_first_surface)
        state += (index, depth, is_new, origin, direction, start, time, wavelengths)
        state += (prev_p, prev_pdf, prev_delta, prev_place, is_straight)
        state += (throughput, eta, typical, radiance, total, invalid, segments, active)
        results = dr.select(active, total, mean), invalid, segments, index
        return results if suspended is None else (*results, state)

    # ------------------------------ Straight lines ------------------------------

    @dr.syntax
    def _seen_straight(self, ray: Any, medium: Any, stream: Stream, drawn: Any, segments: Any, active: Any) -> Any:
        """Radiance of the lights along a ray, each by its transmittance, without anything that is scattered.
        Returns it with the numbers of the stream's draws and of segments."""
        rays, media = self.rays, self.media
        seen, passed = mi.Spectrum(0), mi.Spectrum(1)
        start = mi.UInt32(NOWHERE)
        medium, ray, going = mi.UInt32(medium), mi.Ray3f(ray), mi.Bool(active)
        while dr.hint(going, label="straight line"):
            met = rays.meet(ray, start, going)
            si, emitter = met.si, met.emitter
            segments += 1
            ratio, drawn = media.transmittance(ray, medium, dr.minimum(si.t, ray.maxt), stream, drawn, going)
            passed *= ratio
            sees_emitter = going & (emitter != None)  # noqa: E711 (a Dr.Jit comparison)
            hit = self.emitters.hit(ray.d, emitter, sees_emitter)
            seen[sees_emitter] = seen + passed * self.emitters.emission(si, hit, sees_emitter)
            going &= si.is_valid()
            passed[going] = passed * met.bsdf.eval_null_transmission(si, going)
            medium = media.target(si, ray.d, medium, going)
            going &= dr.any(passed != 0)
            ray = mi.Ray3f(rays.origin(si, ray.d), ray.d, ray.time, ray.wavelengths)
            start = met.surface
        return seen, drawn, segments

    @dr.syntax
    def _transmitted(
        self, ray: Any, rest: Any, start: Any, medium: Any, stream: Stream, drawn: Any, segments: Any, active: Any
    ) -> Any:
        """An unbiased estimate of what passes along a ray to its end, through media and surfaces, and from there on for
        `rest`, the hair by which the ray ends before the light.
        Returns it with the numbers of the stream's draws and of segments."""
        rays, media = self.rays, self.media
        passed = mi.Spectrum(1)
        medium, start, ray, going = mi.UInt32(medium), mi.UInt32(start), mi.Ray3f(ray), mi.Bool(active)
        while dr.hint(going, label="shadow ray"):
            met = rays.meet(ray, start, going)
            si = met.si
            segments += 1
            end = dr.select(si.is_valid(), si.t, ray.maxt + rest)
            ratio, drawn = media.transmittance(ray, medium, end, stream, drawn, going)
            passed *= ratio
            going &= si.is_valid()
            passed[going] = passed * met.bsdf.eval_null_transmission(si, going)
            medium = media.target(si, ray.d, medium, going)
            left = ray.maxt - si.t
            going &= dr.any(passed != 0) & (left > 0)
            ray = mi.Ray3f(rays.origin(si, ray.d), ray.d, ray.time, ray.wavelengths)
            ray.maxt = left
            start = met.surface
        return passed, drawn, segments

    # ------------------------------ Parts of the loop ------------------------------

    def _point(
        self, sequence: Sequence, stream: Stream, index: Any, depth: Any, pair: int, drawn: Any, is_first: Any
    ) -> Any:
        """A vertex's point of a pair of dimensions the first time, and two numbers of the stream from then on."""
        point = sequence.point(index, PER_VERTEX * (depth + 1) + pair)
        if pair != DISTANCE and not self.mixes_null:
            return point
        return dr.select(is_first, point, mi.Point2f(stream.at(drawn), stream.at(drawn + 1)))

    def _sample_phase(self, medium: Any, mei: Any, u_lobe: Any, u: Any, active: Any) -> tuple[Any, Any, Any]:
        """Direction, weight and pdf: by the phase function, or all around where the technique takes no heed of what
        scatters."""
        if self.directions.by_bsdf:
            return self.media.sample_phase(medium, mei, u_lobe, u, active)
        wo = mi.warp.square_to_uniform_sphere(u)
        value, _ = self.media.eval_phase(medium, mei, wo, active)
        return wo, value / dr.inv_four_pi, mi.Float(dr.inv_four_pi)
