"""Light paths: from the lights, through mirrors and clear glass, to the first surfaces that scatter.

Enters: a scene, its rays and a ball to aim at. Leaves: `Arrivals`, where light comes to lie and what it carries. These
are exactly the paths that are hard to make from the camera: a direction drawn at the surface has to leave through the
same mirrors and glass and then meet the light by chance, since no point on a light can be connected through them. What
a light path *brings* per direction drawn is kept with it: how rare a find is follows.

Sources: Arvo 1986 (backward ray tracing); Jensen 2001 (caustic photons); Veach 1997, section 8.3 (chains of deltas).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from renderer.backend import mitsuba
from renderer.equation.lights.powers import choice_probabilities, side_by_side
from renderer.equation.lights.scene_lights import is_sampleable
from renderer.equation.rays import NOWHERE
from renderer.equation.reach import is_specular
from renderer.equation.sequence import Sequence
from renderer.equation.tables import number, registry_id, table

mi: Any = mitsuba()

DEPOSITS = 2  # of one path: a coated surface keeps some light and sends some on
MOST_LINKS = 12  # mirrors and panes in a row
NARROW = 1000.0  # per steradian: a lobe that is drawn so densely is as good as a mirror (a roughness of about 0.01)
STREAM = 0x11647  # of the random numbers: apart from those of the camera's paths
THROUGH, LIGHT, WAVELENGTH, LINK = 0, 1, 2, 3  # pairs of dimensions; from LINK on two for each vertex
MOST_LIGHTS = 64  # that each have their own share of the paths;
LIGHTS_OF_MANY = 16  # of more, so many in each batch
MOST_LISTED = 64  # mirrors and panes that are called one by one


@dataclass(frozen=True, slots=True)
class Aim:
    """Where light paths are aimed at: balls around what they shall meet first, one as often as the other. centres:
    (k, 3). radii: (k,). middle, reach: the ball around the whole scene."""

    centres: NDArray[np.float64]
    radii: NDArray[np.float64]
    middle: tuple[float, float, float]
    reach: float


@dataclass(frozen=True, slots=True)
class Arrivals:
    """Light that came to lie on surfaces, n arrivals.

    batch: (n,) which of the independent sets it belongs to. p, d, normal: (n, 3) place, direction of travel, and
    normal. flux: (n, 3) watts, divided by the paths of a batch. radiance: (n, 3) that a ray from here back along the
    path would find; infinite where no ray can. links: (n,) mirrors and panes on the way. light: (n,) number of the
    emitter. via: (n,) registry id of the shape of the first link.
    """

    batch: NDArray[np.uint32]
    p: NDArray[np.float32]
    d: NDArray[np.float32]
    normal: NDArray[np.float32]
    flux: NDArray[np.float32]
    radiance: NDArray[np.float32]
    links: NDArray[np.uint32]
    light: NDArray[np.uint32]
    via: NDArray[np.uint32]


def rgb(spectrum: Any, wavelengths: Any) -> Any:
    """Linear sRGB of a spectrum."""
    if mi.is_monochromatic:
        return mi.Color3f(spectrum.x)
    return mi.spectrum_to_srgb(spectrum, wavelengths) if mi.is_spectral else mi.Color3f(spectrum)


@dataclass(frozen=True, slots=True)
class _Leaving:
    """Rays that leave lights, and what emitter sampling finds those with: a density over directions where they are at
    infinity, else one over their area, and the cosine there."""

    origin: Any
    direction: Any
    start: Any
    wavelengths: Any
    flux: Any
    radiance: Any
    density: Any
    cosine: Any


class LightPaths:
    """Paths from the lights of one scene.

    rays: `TreeRays` or `ListRays`. shortest: links that a path has at least: 1 where lights seen directly are found by
    emitter sampling anyway, else 0. longest: links at most.
    """

    def __init__(self, scene: Any, rays: Any, aim: Aim, shortest: int, longest: int) -> None:
        self.scene, self.rays = scene, rays
        self._balls = table(np.column_stack([aim.centres, aim.radii]).ravel(), mi.Float)
        self._n_balls = dr.opaque(mi.UInt32, len(aim.radii))
        self._middle, self._away = [number(x) for x in aim.middle], number(2 * aim.reach)
        self.shortest, self.longest = shortest, min(longest, MOST_LINKS)
        emitters = [e for e in scene.emitters() if is_sampleable(e)]
        emitters = [emitters[i] for i in side_by_side(emitters)]  # not as they were loaded: that varies
        probabilities = choice_probabilities(emitters) if emitters else np.zeros(0)
        self.emitters = [e for e, p in zip(emitters, probabilities, strict=True) if p > 0]
        self.probabilities = probabilities[probabilities > 0]
        self._specular, self._numbers = _specular_bsdfs(scene)

    def arrivals(self, batches: int, per_batch: int, seed: int, time: float) -> Arrivals:
        """Follows `per_batch` paths for each of the batches. Equal seeds give equal bits."""
        light, weight = self._chosen(batches, per_batch, seed)
        low, high = dr.opaque(mi.UInt32, seed & 0xFFFFFFFF), dr.opaque(mi.UInt32, seed >> 32)
        with dr.suspend_grad():
            opening = dr.opaque(mi.Float, time)
            columns = self._left(light, weight, low, high, opening)
            found = self._follow(dr.arange(mi.UInt32, len(light)), low, high, opening, *columns)
            dr.eval(*found)
        links, via, *vectors = (np.array(x) for x in found)
        p, d, normal, flux, radiance = (v.reshape(-1, 3) for v in vectors)
        kept = np.flatnonzero(np.isfinite(p).all(axis=1) & np.isfinite(flux).all(axis=1) & (flux.max(axis=1) > 0))
        batch = (kept // (DEPOSITS * per_batch)).astype(np.uint32)
        return Arrivals(
            batch=batch,
            p=p[kept],
            d=d[kept],
            normal=normal[kept],
            flux=(flux[kept] / per_batch).astype(np.float32),
            radiance=radiance[kept],
            links=links[kept],
            light=light[kept // DEPOSITS],
            via=via[kept],
        )

    def _chosen(self, batches: int, per_batch: int, seed: int) -> tuple[NDArray[np.uint32], NDArray[np.float64]]:
        """(n,) the light of each path, and one over the probability of that: shares by power, and of many lights some,
        others in each batch."""
        rng = np.random.default_rng(seed)
        at = (np.arange(per_batch) + 0.5) / per_batch
        if len(self.emitters) > MOST_LIGHTS:
            drawn = rng.choice(len(self.emitters), (batches, LIGHTS_OF_MANY), p=self.probabilities)
            light = np.repeat(drawn, -(-per_batch // LIGHTS_OF_MANY), axis=1)[:, :per_batch].ravel()
        else:
            # Equally spaced from a random start: each light has its share of every batch.
            starts = (rng.random(batches)[:, None] - 0.5) / per_batch
            edges = np.cumsum(self.probabilities)
            light = np.minimum(np.searchsorted(edges, at + starts), len(edges) - 1).ravel()
        return light.astype(np.uint32), 1 / self.probabilities[light]

    # ------------------------------ Leaving a light ------------------------------

    def _left(
        self, light: NDArray[np.uint32], weight: NDArray[np.float64], low: Any, high: Any, time: Any
    ) -> list[Any]:
        """Tables of the rays that leave lights, in the order of their lanes. Each light is asked itself: a call to all
        kinds at once would reach those of other scenes, too, which may not know how."""
        parts, lanes_of = [], []
        order = np.argsort(light, kind="stable")
        for number_, lanes in zip(*_runs(light[order], order), strict=True):
            lane = table(lanes, mi.UInt32)
            sequence = Sequence(mi, *Sequence.keys(low, high, lane, mi.UInt32(STREAM)), mi.UInt32(1), stratified=False)
            left = self._leave(self.emitters[number_], sequence, time)
            values = [getattr(left, name) for name in _Leaving.__slots__]
            dr.eval(*values)
            parts.append([_rows(value, len(lanes)) for value in values])
            lanes_of.append(lanes)
        back = np.argsort(np.concatenate(lanes_of), kind="stable")
        columns = [np.concatenate(column)[back] for column in zip(*parts, strict=True)]
        names = list(_Leaving.__slots__)
        columns[names.index("flux")] = columns[names.index("flux")] * weight[:, None]
        is_infinite = np.array([_has(e, "Infinite") for e in self.emitters], np.uint32)[light]
        whole = [
            table(c.ravel(), mi.UInt32 if name == "start" else mi.Float) for name, c in zip(names, columns, strict=True)
        ]
        return [*whole, table(is_infinite, mi.UInt32)]

    def _leave(self, emitter: Any, sequence: Any, time: Any) -> _Leaving:
        u_light, u_through = sequence.point(mi.UInt32(0), LIGHT), sequence.point(mi.UInt32(0), THROUGH)
        u_extra = sequence.point(mi.UInt32(0), WAVELENGTH)
        wavelengths, scale = mi.Float(0), mi.Spectrum(1)  # no wavelengths but in spectral variants
        if mi.is_spectral:
            wavelengths, scale = mi.sample_rgb_spectrum(mi.sample_shifted(u_extra.x))
        never = mi.Spectrum(dr.inf)
        if _has(emitter, "Infinite"):
            ref = dr.zeros(mi.Interaction3f)
            ref.p, ref.time = mi.Point3f(*self._middle), time
            if mi.is_spectral:
                ref.wavelengths = wavelengths
            ds, arriving = emitter.sample_direction(ref, u_light, True)
            ball, _ = self._ball(u_extra.y)
            frame = mi.Frame3f(ds.d)
            disk = ball.w * mi.warp.square_to_uniform_disk_concentric(u_through)
            target = _centre(ball) + frame.to_world(mi.Vector3f(disk.x, disk.y, 0))
            density = self._across(target, ds.d)
            arriving = dr.select((ds.pdf > 0) & (density > 0), arriving * scale, 0)
            radiance = never if _has(emitter, "Delta") else arriving * ds.pdf
            flux = dr.select(density > 0, arriving / density, 0)
            origin = target + ds.d * self._away
            return _Leaving(origin, -ds.d, mi.UInt32(NOWHERE), wavelengths, flux, radiance, ds.pdf, mi.Float(1))
        if emitter.get_shape() is None and not _has(emitter, "DeltaDirection"):
            return self._leave_point(emitter, time, wavelengths, scale, u_through, u_extra.y)
        if emitter.get_shape() is None or _has(emitter, "Delta"):
            ray, flux = emitter.sample_ray(time, u_extra.x, u_light, u_through, True)
            wavelengths = ray.wavelengths if mi.is_spectral else wavelengths
            return _Leaving(ray.o, ray.d, mi.UInt32(NOWHERE), wavelengths, flux, never, mi.Float(0), mi.Float(1))
        at = emitter.get_shape().sample_position(time, u_light)
        d, pdf = self._aimed(at, u_through, u_extra.y)
        si = dr.zeros(mi.SurfaceInteraction3f)
        si.p, si.n, si.uv, si.sh_frame = at.p, at.n, at.uv, mi.Frame3f(at.n)
        si.time, si.shape = time, mi.ShapePtr(emitter.get_shape())
        if mi.is_spectral:
            si.wavelengths = wavelengths
        si.wi = si.to_local(d)
        radiance = emitter.eval(si, True) * scale
        shines = (at.pdf > 0) & (pdf > 0) & (si.wi.z > 0)
        flux = dr.select(shines, radiance * si.wi.z / (at.pdf * pdf), 0)
        origin, start = self.rays.leaving(si, d, mi.EmitterPtr(emitter), mi.Bool(True))
        return _Leaving(origin, d, start, wavelengths, flux, radiance, at.pdf, si.wi.z)

    def _leave_point(self, emitter: Any, time: Any, wavelengths: Any, scale: Any, u: Any, u_choice: Any) -> _Leaving:
        """From a light without extent: what it sends to a point one unit away."""
        ref = dr.zeros(mi.Interaction3f)
        ref.p, ref.time = mi.Point3f(*self._middle), time
        if mi.is_spectral:
            ref.wavelengths = wavelengths
        place = mi.Point3f(emitter.sample_direction(ref, mi.Point2f(0.5), True)[0].p)
        by_chance = mi.warp.square_to_uniform_sphere(u)
        d, in_cones = self._towards_ball(place, u, u_choice, by_chance)
        ref.p = place + d
        ds, arriving = emitter.sample_direction(ref, mi.Point2f(0.5), True)
        pdf = 0.5 * (dr.inv_four_pi + in_cones)
        flux = dr.select((ds.pdf > 0) & (pdf > 0), arriving * scale * dr.squared_norm(ref.p - ds.p) / pdf, 0)
        never = mi.Spectrum(dr.inf)
        return _Leaving(place, d, mi.UInt32(NOWHERE), wavelengths, flux, never, mi.Float(0), mi.Float(1))

    def _aimed(self, at: Any, u: Any, u_choice: Any) -> tuple[Any, Any]:
        """A direction away from a point on a light, half of them into the cones of the balls; and its density."""
        frame = mi.Frame3f(at.n)
        d, in_cones = self._towards_ball(at.p, u, u_choice, frame.to_world(mi.warp.square_to_cosine_hemisphere(u)))
        return d, 0.5 * (dr.maximum(dr.dot(d, at.n), 0) * dr.inv_pi + in_cones)

    # ------------------------------ Balls to aim at ------------------------------

    def _ball(self, u: Any) -> tuple[Any, Any]:
        """One of them, by a number in 0 … 1, and what is left of that as a number in 0 … 1."""
        scaled = u * mi.Float(self._n_balls)
        index = dr.minimum(mi.UInt32(scaled), self._n_balls - 1)
        return dr.gather(mi.Vector4f, self._balls, index), scaled - mi.Float(index)

    def _towards_ball(self, p: Any, u: Any, u_choice: Any, by_chance: Any) -> tuple[Any, Any]:
        """Directions from p, half of them `by_chance`, half into the cone of a ball; and the density of the cones at
        them. A ball around p has all directions for a cone."""
        ball, _ = self._ball(dr.minimum(2 * u_choice, 1))
        to_centre = _centre(ball) - p
        height = _height(to_centre, ball.w)
        drop = u.x * height
        sine, (sin_phi, cos_phi) = dr.safe_sqrt(drop * (2 - drop)), dr.sincos(dr.two_pi * u.y)
        axis = mi.Frame3f(dr.normalize(dr.select(dr.squared_norm(to_centre) > 0, to_centre, mi.Vector3f(0, 0, 1))))
        in_cone = axis.to_world(mi.Vector3f(sine * cos_phi, sine * sin_phi, 1 - drop))
        d = dr.select(u_choice < 0.5, in_cone, by_chance)
        return d, self._into(p, d)

    @dr.syntax
    def _into(self, p: Any, d: Any) -> Any:
        """Density per solid angle of directions d from p, in the cones of all balls."""
        density, k = mi.Float(0), mi.UInt32(0)
        while dr.hint(k < self._n_balls, label="cones"):
            ball = dr.gather(mi.Vector4f, self._balls, k)
            to_centre = _centre(ball) - p
            height = _height(to_centre, ball.w)
            is_in = dr.dot(d, to_centre) >= dr.norm(to_centre) * (1 - height - 1e-7)
            density += dr.select(is_in, dr.rcp(dr.two_pi * height), 0)
            k += 1
        return density / mi.Float(self._n_balls)

    @dr.syntax
    def _across(self, p: Any, d: Any) -> Any:
        """Density per area of lines of direction d through p, over the disks that the balls show them."""
        density, k = mi.Float(0), mi.UInt32(0)
        while dr.hint(k < self._n_balls, label="disks"):
            ball = dr.gather(mi.Vector4f, self._balls, k)
            away = p - _centre(ball)
            away = away - d * dr.dot(away, d)
            area = dr.pi * dr.square(ball.w)
            density += dr.select(dr.squared_norm(away) <= dr.square(ball.w * (1 + 1e-5)), dr.rcp(area), 0)
            k += 1
        return density / mi.Float(self._n_balls)

    # ------------------------------ Through mirrors and glass ------------------------------

    @dr.syntax
    def _follow(
        self,
        lane: Any,
        seed_low: Any,
        seed_high: Any,
        time: Any,
        origins: Any,
        directions: Any,
        starts: Any,
        all_wavelengths: Any,
        fluxes: Any,
        radiances: Any,
        densities: Any,
        cosines: Any,
        at_infinity: Any,
    ) -> Any:
        key_a, key_b = Sequence.keys(seed_low, seed_high, lane, mi.UInt32(STREAM))
        sequence = Sequence(mi, key_a, key_b, mi.UInt32(1), stratified=False)
        n = DEPOSITS * dr.width(lane)
        out = [dr.zeros(mi.Float, 3 * n) for _ in range(5)]  # p, d, normal, flux, radiance
        out_links, out_via = (dr.zeros(mi.UInt32, n) for _ in range(2))
        ctx = mi.BSDFContext(mi.TransportMode.Importance)
        origin, direction = dr.gather(mi.Point3f, origins, lane), dr.gather(mi.Vector3f, directions, lane)
        flux, radiance = dr.gather(mi.Spectrum, fluxes, lane), dr.gather(mi.Spectrum, radiances, lane)
        density, cosine = dr.gather(mi.Float, densities, lane), dr.gather(mi.Float, cosines, lane)
        start, is_infinite = dr.gather(mi.UInt32, starts, lane), dr.gather(mi.UInt32, at_infinity, lane) != 0
        wavelengths = dr.zeros(mi.Ray3f).wavelengths
        if dr.hint(mi.is_spectral, mode="scalar"):
            wavelengths = dr.gather(type(wavelengths), all_wavelengths, lane)
        links, deposits, via = mi.UInt32(0), mi.UInt32(0), mi.UInt32(0)
        active = dr.any(flux > 0)

        while dr.hint(active, label="light paths"):
            # ------------------------------ Next vertex ------------------------------

            met = self.rays.meet(mi.Ray3f(origin, direction, time, wavelengths), start, active)
            si, bsdf = met.si, met.bsdf
            active &= si.is_valid() & (bsdf != None)  # noqa: E711 (a Dr.Jit comparison)
            flags = bsdf.flags()

            # ------------------------------ Light that comes to lie ------------------------------

            lies = active & (links >= self.shortest) & mi.has_flag(flags, mi.BSDFFlags.Smooth)
            slot = lane * DEPOSITS + deposits
            carried, seen = rgb(flux, wavelengths), rgb(radiance, wavelengths)
            for k in range(3):
                for array, value in zip(out, (si.p, direction, si.n, carried, seen), strict=True):
                    dr.scatter(array, value[k], slot * 3 + k, lies)
            dr.scatter(out_links, links, slot, lies)
            dr.scatter(out_via, via, slot, lies)
            deposits[lies] = deposits + 1

            # ------------------------------ Next link ------------------------------

            u_lobe = sequence.point(mi.UInt32(0), LINK + 2 * links)
            u = sequence.point(mi.UInt32(0), LINK + 2 * links + 1)
            bs, weight = self._sample(bsdf, ctx, si, u_lobe.x, u, active)
            is_delta = mi.has_flag(bs.sampled_type, mi.BSDFFlags.Delta)
            active &= (is_delta | (bs.pdf > NARROW)) & (deposits < DEPOSITS) & (links < self.longest)
            # Where the first link is no perfect mirror, emitter sampling there finds the light as well.
            by_emitter = dr.select(is_infinite, density, density * dr.square(si.t) / cosine)
            is_helped = ~is_delta & (links == 0) & (self.shortest > 0)
            helped = dr.select(is_helped, bs.pdf / (bs.pdf + by_emitter), 1)
            flux[active] = flux * weight
            radiance[active] = radiance * weight * dr.square(bs.eta) * helped
            is_first = active & (links == 0)
            via[is_first] = dr.reinterpret_array(mi.UInt32, dr.select(si.instance != None, si.instance, si.shape))  # noqa: E711
            links[active] = links + 1
            next_direction = si.to_world(bs.wo)
            origin, direction, start = self.rays.origin(si, next_direction), next_direction, met.surface
            active &= dr.any(flux > 0)
        return out_links, out_via, *out

    def _sample(self, bsdf: Any, ctx: Any, si: Any, u_lobe: Any, u: Any, active: Any) -> tuple[Any, Any]:
        """How light goes on at a surface, where that is a link: code for all other surfaces takes long to compile."""
        if self._specular is None:
            return bsdf.sample(ctx, si, u_lobe, u, active)
        key: Any = dr.reinterpret_array(mi.UInt32, bsdf)
        number_ = dr.gather(mi.UInt32, self._numbers, key, active)
        is_link = active & (number_ < len(self._specular))
        if not self._specular:
            return dr.zeros(mi.BSDFSample3f), dr.zeros(mi.Spectrum)

        def sample_of(one: Any) -> Any:
            return lambda si, u_lobe, u, active: one.sample(ctx, si, u_lobe, u, active)

        targets = [sample_of(one) for one in self._specular]
        index: Any = dr.select(is_link, mi.UInt32(number_), 0)
        found: Any = dr.switch(index, targets, si, u_lobe, u, is_link, label="links")
        return found


def _specular_bsdfs(scene: Any) -> tuple[list[Any] | None, Any]:
    """The surfaces that links are made of, each once, and by registry id which one a surface is, past the last for all
    others. None and an empty table where there are many, or where some are not known: within instances."""
    shapes = list(scene.shapes())
    each = {registry_id(b): b for shape in shapes if (b := shape.bsdf()) is not None}
    links = [key for key in sorted(each) if is_specular(each[key])]
    if len(links) > MOST_LISTED or any(shape.class_name() == "Instance" for shape in shapes):
        return None, table([0], mi.UInt32)
    numbers = np.full(max(each, default=0) + 1, len(links), np.uint32)
    numbers[links] = np.arange(len(links))
    return [each[key] for key in links], table(numbers, mi.UInt32)


def shape_id(shape: Any) -> int:
    """The number by which Dr.Jit's pointers name a shape."""
    number: Any = dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape))
    return int(number[0])


def _centre(ball: Any) -> Any:
    return mi.Point3f(ball.x, ball.y, ball.z)


def _height(to_centre: Any, radius: Any) -> Any:
    """Of the cap of unit directions into a ball: 1 − cos, exact for narrow cones; 2, all of them, from within."""
    sin_2 = dr.square(radius) / dr.squared_norm(to_centre)
    return dr.select(sin_2 < 0.999, sin_2 / (1 + dr.safe_sqrt(1 - sin_2)), 2)


def _has(emitter: Any, flag: str) -> bool:
    return bool(mi.has_flag(emitter.flags(), getattr(mi.EmitterFlags, flag)))


def _runs(sorted_: NDArray[np.uint32], order: NDArray[np.int64]) -> tuple[list[int], list[NDArray[np.int64]]]:
    """The numbers that occur, and the places of each."""
    numbers, first = np.unique(sorted_, return_index=True)
    return numbers.tolist(), np.split(order, first[1:])


def _rows(value: Any, n: int) -> NDArray[Any]:
    """(n, components) of a Dr.Jit array, which may stand for n equal values."""
    found = np.array(value)
    if found.ndim <= 1:
        return np.broadcast_to(found.reshape(-1, 1), (n, 1))
    return np.broadcast_to(found.T, (n, found.shape[0]))
