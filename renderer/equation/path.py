"""The replicate kernel: the path-tracing estimator of the rendering equation.

Enters: lanes, each a (pixel, replicate). Leaves: per lane the mean radiance of its `replicate_size` samples and the
number of samples that were not finite. A lane runs its samples one after the other and starts the next as soon as a
path ends, with the sum in registers: memory does not grow with samples, and no lane waits for another's long path.
Nor does anyone wait for long paths: after so many segments a lane is suspended, and goes on in a later kernel launch.

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
import numpy as np
from numpy.typing import NDArray

from renderer.backend import mitsuba, using
from renderer.equation import mueller, roulette
from renderer.equation.camera import camera_of
from renderer.equation.film import Lanes, SharedFilm, generator_of
from renderer.equation.filter import PixelFilter
from renderer.equation.guide import Guide, GuideTables
from renderer.equation.launch import Launch, SharedLaunch
from renderer.equation.lights.sampler import EmitterSampler, useful_survey
from renderer.equation.lights.scene_lights import lights_of
from renderer.equation.loaded import loaded_scenes, note_loaded
from renderer.equation.matte import Matte
from renderer.equation.mis import power_heuristic
from renderer.equation.primitives import listed
from renderer.equation.rays import NOWHERE, ListRays, TreeRays
from renderer.equation.sequence import Sequence
from renderer.equation.tables import arrays_in, table
from renderer.equation.techniques import Directions, GuidedDirections

mi: Any = mitsuba()

# Dimension pairs: the camera takes the first three, each path vertex three more.
PIXEL, LENS, TIME_AND_WAVELENGTH = 0, 1, 2
PER_VERTEX = 3
EMITTER, BSDF_DIRECTION, LOBE_AND_ROULETTE = 0, 1, 2

NO_LIMIT = 0xFFFFFFFF
RECORDINGS = 4  # kept by a kernel
SEGMENTS_PER_SAMPLE = 128  # in the mean of a replicate, after which its lane is suspended: see `launch`
Sizes = tuple[Any, ...]  # width, height, replicate size, depth limit, roulette depth


@dataclass(frozen=True, slots=True)
class Model:
    """What the kernel contains. Features are Python `if`s while tracing: what is absent is not in the kernel.

    technique: see `Settings`. max_depth: −1 = unlimited. rr_depth: see `roulette`.
    has_sampleable_emitters: whether emitter sampling can find anything. hide_emitters: lights unseen by the camera.
    has_lens: whether the camera has an aperture. splits_lobes: see `Directions`.
    has_transmission: whether light passes any surface. has_visible_emitters: whether a ray can hit a light (not where
    all are points and directions). needs_time: whether the picture depends on the time within the shutter's opening.
    has_delta: whether some directions are those of mirrors and clear glass. has_null: whether light may pass some
    surface as if it were not there. has_roulette: whether paths get so long.
    stratified: Owen-scrambled points, else independent ones. surveys_lights: choose among lights by the place.
    has_tree: whether rays find surfaces by Mitsuba's tree, else by trying all of the scene's few primitives. needs_uv:
    whether anything looks at texture coordinates or tangents. shares_samples: whether a sample counts in all pixels
    that the film's filter reaches (see `film`), else in one alone. is_meter: whether paths begin on a metered surface.
    has_media: whether light may be scattered between surfaces (see `volume_path`). is_guided: whether directions are
    drawn by a learned guide, too (see `guide`).
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
    has_null: bool = True
    has_roulette: bool = True
    stratified: bool = True
    surveys_lights: bool = True
    has_tree: bool = True
    needs_uv: bool = True
    shares_samples: bool = False
    is_meter: bool = False
    has_media: bool = False
    is_guided: bool = False

    @property
    def samples_emitters(self) -> bool:
        """Whether the kernel samples points on emitters (the area form)."""
        return self.technique in ("mis", "emitter") and self.has_sampleable_emitters and self.max_depth not in (0, 1)

    @property
    def has_eta(self) -> bool:
        """Whether what a path carries, for roulette, is anything but its throughput."""
        return self.has_transmission or self.is_guided

    @property
    def hides_behind(self) -> bool:
        """Whether lights are hidden behind surfaces that the camera looks through, too."""
        return self.hide_emitters and self.has_null


@dataclass(frozen=True, slots=True)
class Vertex:
    """Where a path meets a surface. bsdf, emitter: pointers, null where there is none. surface: its key (see `rays`).
    direction: of the ray that arrives."""

    si: Any
    bsdf: Any
    emitter: Any
    surface: Any
    direction: Any


@dataclass(frozen=True, slots=True)
class Before:
    """The vertex that a ray left, as far as what it meets depends on it. p: from where it saw lights. pdf: solid-angle
    density of the ray's direction. is_alone: whether no light on the ray could have been found by emitter sampling.
    place: for the choice among lights."""

    p: Any
    time: Any
    pdf: Any
    is_alone: Any
    place: Any


@dataclass(frozen=True, slots=True)
class Seen:
    """A point on a light as seen from a vertex, visibility not tested. origin: from where. ds: Mitsuba's direction
    sample. contribution: to the path's radiance. place: for the choice among lights. active: whether it matters."""

    origin: Any
    ds: Any
    contribution: Any
    place: Any
    active: Any

    @staticmethod
    def nothing() -> Seen:
        """Where no light is sampled."""
        ds = dr.zeros(mi.DirectionSample3f)
        return Seen(mi.Point3f(0), ds, mueller.no_light(), mi.UInt32(0), mi.Bool(False))


class PathKernel:
    """Compiled once per (scene, model); `launch` runs it over any lanes without compiling again. guide: that directions
    are drawn by, too; None also where a guided model found nothing to learn from.
    """

    def __init__(
        self, scene: Any, sensor: Any, size: tuple[int, int], model: Model, guide: Guide | None = None
    ) -> None:
        self.variant: str = mi.variant()
        self.mitsuba_scene = scene
        note_loaded(self)
        self.camera = camera_of(sensor)
        self.model = model
        # Of a meter the first vertex scatters all ways, and its light has no frame of its own.
        self.has_stokes: bool = mi.is_polarized and not model.is_meter
        self.frame: Any = mueller.SensorFrame(sensor) if self.has_stokes else None
        kinds = mi.BSDFFlags
        self.real_lobes = int(kinds.Smooth | kinds.DeltaReflection | kinds.DeltaTransmission)  # all but null ones
        self.filter = PixelFilter(mi, sensor.film().rfilter())
        self.film: Any = SharedFilm(sensor.film().rfilter(), self.has_stokes) if model.shares_samples else None
        self.width = size[0]
        shapes = list(scene.shapes())
        white = [self.camera.white] if model.is_meter else []
        matte = Matte([*(s.bsdf() for s in shapes), *white], not any(s.class_name() == "Instance" for s in shapes))
        self.directions: Any = Directions(model.technique, model.splits_lobes, matte)
        self.guide = guide
        if guide is not None:
            self.directions = GuidedDirections(self.directions, GuideTables(guide))
        self.rays = TreeRays(scene) if model.has_tree else ListRays(scene, listed(scene), model.needs_uv)
        surveys = model.samples_emitters and model.surveys_lights
        lights = lights_of(scene, is_helped=model.technique == "mis")
        seen = useful_survey(scene, sensor, lights, model.has_media) if surveys else None
        self.emitters = EmitterSampler(lights, seen)
        self.samples_emitters = model.samples_emitters and not self.emitters.is_empty
        self.reach = 0 if self.film is None else self.film.reach  # squares around the image that lanes are rendered in
        # Sensors take positions relative to the crop window, of which `size` is the number of pixels.
        # Opaque, so that one compiled kernel serves all sizes and depths.
        depth_limit = NO_LIMIT if model.max_depth < 0 else model.max_depth
        numbers = (*size, model.replicate_size, depth_limit, model.rr_depth)
        self.sizes: Sizes = tuple(dr.opaque(mi.UInt32, n) for n in numbers)
        self.lattice = (self.sizes[2], dr.opaque(mi.UInt32, generator_of(model.replicate_size)))
        self.shutter_open = float(sensor.shutter_open())
        self.shutter_time = float(sensor.shutter_open_time())
        self.media: Any = self._media_of(scene, sensor)
        # Traced once and replayed: tracing a pass anew takes as long as rendering a small one.
        ours = self.camera, self.filter, self.directions, self.emitters, self.rays, self.media, self.frame
        state = (scene, sensor, arrays_in(*ours))
        # Dr.Jit's calls reach the plugins of all scenes of the process: another scene is another recording.
        self._replayed: Any = dr.freeze(
            self._run,
            state_fn=lambda *_: (state, loaded_scenes(self.variant)),
            limit=RECORDINGS,
            warn_after=2**31 - 1,
        )
        if self.film is not None:
            self._added_up: Any = dr.freeze(self.film.added_up, limit=RECORDINGS, warn_after=2**31 - 1)

    @property
    def guide_digest(self) -> str | None:
        """Identity of the guide; None where nothing was there to learn from."""
        return None if self.guide is None else self.guide.digest

    def _media_of(self, scene: Any, sensor: Any) -> Any:
        """What this kernel knows of participating media: nothing (see `volume_path`)."""
        return None

    def extra_state(self, n: int) -> tuple[Any, ...]:
        """What n lanes carry before the state that `_run` declares, at the beginning of a sample."""
        return ()

    def with_replicates_of(self, size: int) -> PathKernel:
        """This kernel for replicates of another size: nothing is traced or compiled anew."""
        other = copy.copy(self)
        other.model = replace(self.model, replicate_size=size)
        other.sizes = (*self.sizes[:2], dr.opaque(mi.UInt32, size), *self.sizes[3:])
        other.lattice = (other.sizes[2], dr.opaque(mi.UInt32, generator_of(size)))
        return other

    def with_depth_limit(self, most: int) -> PathKernel:
        """This kernel for paths of so many vertices at most, as `Model.max_depth` counts; nothing is traced anew."""
        other = copy.copy(self)
        other.sizes = (*self.sizes[:3], dr.opaque(mi.UInt32, most), self.sizes[4])
        return other

    def launch(self, pixels: Any, replicates: Any, seed: int) -> tuple[Any, Any, Any]:
        """One pass, to its end.

        pixels, replicates: (n,) uint32, row-major pixel index and replicate index of each lane.
        Returns radiance: (3, n) float32, the mean of the finite samples, or (12, n) where light is polarised: R, G, B
        of S0 to S3; invalid: (n,) uint32, samples not finite;
        segments: (n,) uint32, of all its paths: what the lane cost.
        """
        return self.begin(pixels, replicates, seed).finished()

    def begin(self, pixels: Any, replicates: Any, seed: int) -> Launch | SharedLaunch:
        """Starts one pass; `Launch.step` waits for it. Arguments as of `launch`."""
        return (Launch if self.film is None else SharedLaunch)(self, pixels, replicates, seed)

    def replay(self, pixel: Any, replicate: Any, seed: int, suspended: Any = None, kept: Any = None) -> tuple[Any, ...]:
        """Starts lanes, or goes on with suspended ones: what `_run` takes and returns."""
        with dr.suspend_grad(), using(self.variant), _collector_paused():
            kept = None if kept is None else (self.lattice, *kept)
            lanes = self._replay(pixel, replicate, _keys(seed), self.sizes, suspended, kept)
        dr.eval(*lanes, kept)  # apart from what reads them: else their number would be compiled into the kernel
        return lanes

    def look(self, pixels: Any, seed: int) -> Launch:
        """As `begin`, for replicate 0 of pixels far from each other: what their own squares show, unfiltered. Where
        samples are shared, whole replicates of single pixels would cost many times as much.
        """
        rows, columns = np.divmod(np.asarray(pixels, np.int64), self.width)
        places = (rows + self.reach) * (self.width + 2 * self.reach) + columns + self.reach
        return Launch(self, places, np.zeros(len(places)), seed)

    def added_up(self, samples: Any, invalid: Any, needed: Lanes, replicates: Any, seed: int) -> NDArray[np.float32]:
        """(3, n) radiance, or (12, n) with S1 to S3, of the replicates that `needed` are the lanes of, from all of
        their samples."""
        with dr.suspend_grad(), using(self.variant), _collector_paused():
            wanted = (table(numbers, mi.UInt32) for numbers in (invalid, needed.starts, needed.targets, replicates))
            stride = dr.opaque(mi.UInt32, needed.stride)
            radiance = self._added_up(samples, *wanted, stride, _keys(seed), self.lattice)
            dr.eval(radiance)
        return mueller.columns(radiance)

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
    def _run(self, pixel: Any, replicate: Any, seed: tuple[Any, Any], sizes: Sizes, suspended: Any, kept: Any) -> Any:
        """Lanes until they are done or have used up their segments.

        kept: where samples are shared, the lattice of their places, what each of them is written to, and the number of
        each lane's first one; then `pixel` is a square of the image with its border.
        suspended: None, or until how many segments lanes go on, and their loop state as an earlier call returned it.
        Returns radiance (the sum of the finished samples where a lane is not done), invalid, segments, the number of
        finished samples, and the loop state if one came in: storing it costs memory that ordinary passes do not need.
        """
        rays = self.rays
        width, height, replicate_size, depth_limit, rr_depth = sizes
        key_a, key_b = Sequence.keys(*seed, pixel, replicate)
        sequence = Sequence(mi, key_a, key_b, replicate_size, self.model.stratified)
        stride = width + 2 * self.reach
        square = mi.Point2f(mi.Float(pixel % stride) - self.reach, mi.Float(pixel // stride) - self.reach)
        film_size = mi.Vector2f(mi.Float(width), mi.Float(height))

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
        is_straight = mi.Bool(True)  # the camera looks along the ray, through surfaces that let it pass
        throughput = mi.Spectrum(1)
        eta = mi.Float(1)  # product of relative indices of refraction, and of what a guide adds to them
        typical = mi.Float(0)  # what the path carried behind its first surface that is no mirror or clear glass
        radiance = mueller.no_light()  # of the current sample
        total = mueller.zeros(mi.Color3f, self.has_stokes)  # of the finished samples
        invalid = mi.UInt32(0)
        segments = mi.UInt32(0)
        active = mi.Bool(True)
        until = replicate_size * SEGMENTS_PER_SAMPLE
        if dr.hint(suspended is not None, mode="scalar"):
            # All that is declared above, in the order of `state` below.
            until, state = suspended
            index, depth, is_new, origin, direction, start, time, wavelengths = dr.copy(state[:8])
            prev_p, prev_pdf, prev_delta, prev_place, is_straight = dr.copy(state[8:13])
            throughput, eta, typical, radiance, total, invalid, segments, active = dr.copy(state[13:])

        while dr.hint(active & (segments != until), label="replicate"):
            # ------------------------------ Camera ray ------------------------------

            film_sample = index, replicate, seed, kept
            camera_ray, camera_weight, position = self._camera_ray(sequence, film_sample, square, film_size, is_new)
            origin[is_new] = camera_ray.o
            direction[is_new] = camera_ray.d
            throughput[is_new] = camera_weight
            radiance[is_new] = 0
            if dr.hint(self.model.needs_time, mode="scalar"):
                time[is_new] = camera_ray.time
            if dr.hint(mi.is_spectral, mode="scalar"):
                wavelengths[is_new] = camera_ray.wavelengths
            if dr.hint(rays.tracks_surfaces, mode="scalar"):
                start[is_new] = NOWHERE
            if dr.hint(self.model.has_roulette, mode="scalar"):
                typical[is_new] = 0
            if dr.hint(self.model.has_eta, mode="scalar"):
                eta[is_new] = 1
            if dr.hint(self.model.has_delta, mode="scalar"):
                prev_delta[is_new] = True
            if dr.hint(self.model.hides_behind, mode="scalar"):
                is_straight[is_new] = True

            # ------------------------------ Next vertex ------------------------------

            ray = mi.Ray3f(origin, direction, time, wavelengths)
            ray.maxt = dr.select(is_new, camera_ray.maxt, ray.maxt)  # the camera's far plane
            vertex = self._vertex(ray, start, position, is_new, active)
            si = vertex.si
            segments += 1

            # ------------------------------ Emission ------------------------------

            # The camera's rays and those of mirrors could not have been found from the light's side.
            is_alone = prev_delta if dr.hint(self.model.has_delta, mode="scalar") else depth == 0
            before = Before(prev_p, time, prev_pdf, is_alone, prev_place)
            sees_emitter = self._sees_emitter(vertex, depth, is_new, is_straight, active)
            radiance[sees_emitter] = radiance + self._emitted(throughput, vertex, before, sees_emitter)

            # ------------------------------ Go on? ------------------------------

            # The camera looks through area lights that are hidden: same sample, same depth, from behind the light.
            passes_through = self._passes_through(si, depth, active)
            active_next = active & si.is_valid() & (depth + 1 < depth_limit) & ~passes_through

            # ------------------------------ Emitter sampling, direction sampling ------------------------------

            u = [sequence.point(index, PER_VERTEX * (depth + 1) + pair) for pair in range(PER_VERTEX)]
            light, bs, bsdf_weight = self._scattered(throughput, vertex, u, active_next)

            # ------------------------------ Visibility ------------------------------

            is_lit = self._is_visible(light, vertex)
            radiance[is_lit] = radiance + light.contribution

            # ------------------------------ Update ------------------------------

            next_direction = dr.select(passes_through, ray.d, si.to_world(bs.wo))
            next_origin = rays.origin(si, next_direction)
            throughput[active_next] = mueller.applied(throughput, si.to_world_mueller(bsdf_weight, -bs.wo, si.wi))
            prev_p[active_next] = self._seen_from(vertex, next_origin)
            prev_pdf[active_next] = bs.pdf
            prev_place = light.place
            if dr.hint(self.model.has_eta, mode="scalar"):
                eta[active_next] = eta * bs.eta
            if dr.hint(rays.tracks_surfaces, mode="scalar"):
                start = vertex.surface
            if dr.hint(self.model.has_delta, mode="scalar"):
                prev_delta[active_next] = mi.has_flag(bs.sampled_type, mi.BSDFFlags.Delta)
            if dr.hint(self.model.hides_behind, mode="scalar"):
                is_straight[active_next] = is_straight & mi.has_flag(bs.sampled_type, mi.BSDFFlags.Null)
            origin = next_origin
            direction = next_direction
            depth[active_next] = depth + 1

            # ------------------------------ Stopping ------------------------------

            active_next &= dr.any(mueller.intensity(throughput) != 0)
            if dr.hint(self.model.has_roulette, mode="scalar"):
                carried = roulette.carried(mueller.intensity(throughput), eta)
                is_first = active_next & (typical == 0)
                if dr.hint(self.model.has_delta, mode="scalar"):
                    is_first &= ~prev_delta
                typical[is_first] = carried
                survival = roulette.survival_probability(carried, typical, depth, rr_depth, depth_limit != NO_LIMIT)
                plays = depth >= roulette.first_play(rr_depth)
                active_next &= ~plays | (u[LOBE_AND_ROULETTE].y < survival)
                throughput[plays] = throughput / survival
            active_next |= passes_through

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
        state = (index, depth, is_new, origin, direction, start, time, wavelengths)
        state += (prev_p, prev_pdf, prev_delta, prev_place, is_straight)
        state += (throughput, eta, typical, radiance, total, invalid, segments, active)
        mean = mueller.each(lambda sums: dr.select(active, sums, dr.select(valid > 0, sums / valid, 0)), total)
        results = mean, invalid, segments, index
        return results if suspended is None else (*results, state)

    # ------------------------------ Camera and film ------------------------------

    def _camera_ray(self, sequence: Sequence, sample: Any, square: Any, size: Any, is_new: Any) -> tuple[Any, Any, Any]:
        """A sample's ray, its weight, and where on the film it is (0 … 1). sample: its index and replicate, the seed,
        and what `_run` calls kept. square: column and row of the lane's pixel. size: of the image."""
        index, replicate, seed, kept = sample
        if self.model.shares_samples:
            offset, weight = self.film.offset(index, replicate, seed, kept[0]), mi.Float(1)
        else:
            offset, weight = self.filter.sample(sequence.point(index, PIXEL))
        position = (square + offset) / size
        lens = sequence.point(index, LENS) if self.model.has_lens else mi.Point2f(0.5)
        has_extra = self.model.needs_time or mi.is_spectral
        extra = sequence.point(index, TIME_AND_WAVELENGTH) if has_extra else mi.Point2f(0.5)
        time = self.shutter_open + self.shutter_time * extra.x
        ray, camera_weight = self.camera.sample_ray(time, extra.y, position, lens, is_new)
        if self.has_stokes:
            camera_weight = self.frame.towards(ray.d) @ camera_weight
        return ray, camera_weight * weight, position

    def _developed(self, radiance: Any, wavelengths: Any, sample: Any, ended: Any) -> tuple[Any, Any]:
        """Linear sRGB of the samples that have ended, or Stokes vectors of it, and which are finite; kept one by one
        where pixels share them."""
        index, _, _, kept = sample
        light = radiance if self.has_stokes else mueller.intensity(radiance)
        rgb = mueller.each(lambda one: self.to_rgb(one, wavelengths), light)
        is_finite = mueller.is_finite(rgb)
        if self.model.shares_samples:
            self.film.keep(kept[1], kept[2] + index, rgb, is_finite, ended)
        return rgb, is_finite

    # ------------------------------ A vertex ------------------------------

    def _vertex(self, ray: Any, start: Any, position: Any, is_new: Any, active: Any) -> Vertex:
        """What a ray meets. A meter's first vertex lies on the metered surface: seen from outside, white, no light."""
        met = self.rays.meet(ray, start, active, is_new)
        if not self.model.is_meter:
            return Vertex(met.si, met.bsdf, met.emitter, met.surface, ray.d)
        metered, white = self.camera.vertex(ray, position, is_new)
        si, bsdf = dr.select(is_new, metered, met.si), dr.select(is_new, white, met.bsdf)
        return Vertex(si, bsdf, met.emitter, met.surface, dr.select(is_new, -metered.n, ray.d))

    def _sees_emitter(self, vertex: Vertex, depth: Any, is_new: Any, is_straight: Any, active: Any) -> Any:
        """Whether what light a vertex sends counts."""
        if not self.model.has_visible_emitters:
            return mi.Bool(False)
        sees_emitter = active & (vertex.emitter != None)  # noqa: E711 (a Dr.Jit comparison)
        if self.model.is_meter:
            sees_emitter &= ~is_new
        if self.model.hide_emitters:
            is_hidden = depth == 0
            if self.model.hides_behind:
                # As Mitsuba has it: what is left to see is a light's own surface, where it has one.
                is_real = (vertex.bsdf.flags() & self.real_lobes) != 0
                is_hidden |= is_straight & ~(vertex.si.is_valid() & is_real)
            sees_emitter &= ~is_hidden
        return sees_emitter

    def _emitted(self, throughput: Any, vertex: Vertex, before: Before, active: Any) -> Any:
        """Light that a vertex sends back along the ray, weighted against sampling it from the vertex before."""
        if not self.model.has_visible_emitters:
            return mueller.no_light()
        si, emitter = vertex.si, vertex.emitter
        hit = self.emitters.hit(vertex.direction, emitter, active)
        weight = mi.Float(1)
        if self.samples_emitters and self.model.technique == "emitter":
            weight = dr.select(before.is_alone, 1, 0)
        elif self.samples_emitters:
            ref = dr.zeros(mi.Interaction3f)
            ref.p, ref.time = before.p, before.time
            ds = mi.DirectionSample3f(self.mitsuba_scene, si, ref)
            ds.emitter = emitter
            pdf_em = self.emitters.pdf(ref, ds, si, active & ~before.is_alone, before.place, hit)
            weight = dr.select(before.is_alone, 1, power_heuristic(before.pdf, pdf_em))
        return mueller.lit(throughput * weight, self.emitters.emission(si, hit, active))

    def _passes_through(self, si: Any, depth: Any, active: Any) -> Any:
        """Whether the camera looks through a surface because it is that of a hidden light."""
        if not self.model.hide_emitters:
            return mi.Bool(False)
        return active & (depth == 0) & si.is_valid() & (si.shape.emitter() != None)  # noqa: E711

    def _scattered(self, throughput: Any, vertex: Vertex, u: list[Any], active: Any) -> tuple[Seen, Any, Any]:
        """A light as seen from a vertex, and where the path goes on: a BSDF sample with its weight f·cosθ/pdf.
        u: the vertex's points."""
        ctx, (u_lobe, _), u_direction = mi.BSDFContext(), u[LOBE_AND_ROULETTE], u[BSDF_DIRECTION]
        si, bsdf = vertex.si, vertex.bsdf
        if not self.samples_emitters:
            # Direction sampling alone: by the BSDF, or uniform or cosine for comparison.
            return Seen.nothing(), *self.directions.sample(bsdf, ctx, si, u_lobe, u_direction, active)
        # A point on a light; whether it is visible is asked last, and only where it can matter.
        active_em = active
        if self.model.has_delta:
            active_em = active & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)
        ref = dr.zeros(mi.Interaction3f)
        ref.p = self._seen_from(vertex, self.rays.origin(si, -vertex.direction))
        ref.time, ref.wavelengths = si.time, si.wavelengths
        place = mi.UInt32(0)
        if self.emitters.knows_places:
            facing = dr.select(dr.dot(si.n, vertex.direction) > 0, -si.n, si.n)
            place = self.emitters.place(si.p, facing, active_em)
        ds, emitter_weight = self.emitters.sample(ref, u[EMITTER], active_em, place)
        wo = si.to_local(ds.d)
        value, pdf, *sampled = self.directions.eval_pdf_sample(bsdf, ctx, si, wo, u_lobe, u_direction, active)
        value = si.to_world_mueller(value, -wo, si.wi)
        contribution = mueller.lit(mueller.applied(throughput, value), emitter_weight)
        contribution = contribution * self._weight_against_directions(ds, pdf)
        active_em = active_em & (ds.pdf != 0) & dr.any(mueller.intensity(contribution) != 0)
        return Seen(ref.p, ds, contribution, place, active_em), *sampled

    def _weight_against_directions(self, ds: Any, pdf: Any) -> Any:
        """Of a point on a light that direction sampling finds with density pdf."""
        if self.model.technique != "mis" or not self.model.has_visible_emitters:
            return mi.Float(1)
        return dr.select(ds.delta, 1, power_heuristic(ds.pdf, pdf))

    def _seen_from(self, vertex: Vertex, origin: Any) -> Any:
        """From where a vertex sees lights, if rays leave it at `origin`: there, a hair above the surface. Then both
        techniques have the same directions to find a light, and their weights sum to one even where it touches the
        surface. Where light passes the surface, rays leave on either side: from the surface itself."""
        if not self.model.has_transmission:
            return origin
        return dr.select(mi.has_flag(vertex.bsdf.flags(), mi.BSDFFlags.Transmission), vertex.si.p, origin)

    def _is_visible(self, light: Seen, vertex: Vertex) -> Any:
        """Whether nothing lies between a vertex and the point of the light that it is to see."""
        if not self.samples_emitters:
            return mi.Bool(False)
        passes = None
        if self.model.has_transmission:
            passes = mi.has_flag(vertex.bsdf.flags(), mi.BSDFFlags.Transmission)
        return light.active & ~self.rays.is_blocked(
            vertex.si, light.origin, light.ds, passes, vertex.surface, light.active
        )

    @staticmethod
    def to_rgb(radiance: Any, wavelengths: Any) -> Any:
        """Linear sRGB of a radiance sample."""
        if mi.is_monochromatic:
            return mi.Color3f(radiance.x)
        if mi.is_spectral:
            return mi.spectrum_to_srgb(radiance, wavelengths)
        return mi.Color3f(radiance)


def _keys(seed: int) -> tuple[Any, Any]:
    return dr.opaque(mi.UInt32, seed & 0xFFFFFFFF), dr.opaque(mi.UInt32, seed >> 32)


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
