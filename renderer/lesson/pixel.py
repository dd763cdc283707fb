"""What an estimator sees and does at the first vertex of one pixel.

Enters: a scene and a pixel. Leaves: the surface that the pixel's centre sees; the radiance that arrives there from
every direction, rendered by the product's own kernel behind a camera that stands on the surface; the directions that
each technique draws there; and the pixel's samples by each technique. Nothing here is an approximation for show.

Directions are told in the local frame of the surface: a map of width 2π in φ and height π in θ from the shading normal,
or π/2 where no light comes through the surface.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from renderer.backend import mitsuba
from renderer.equation.lights.sampler import EmitterSampler
from renderer.equation.lights.scene_lights import lights_of
from renderer.equation.path import Model, PathKernel
from renderer.equation.sequence import Sequence
from renderer.equation.techniques import Directions
from renderer.errors import SettingsError
from renderer.estimate.moments import Moments
from renderer.scene.compile import Scene
from renderer.settings import UNLIMITED_DEPTH, Settings

mi: Any = mitsuba()

MAP_COLUMNS = 128
REPLICATE_SIZE = 4  # samples per replicate of the map
_LOBES = (
    *("DiffuseReflection", "DiffuseTransmission", "GlossyReflection", "GlossyTransmission"),
    *("DeltaReflection", "DeltaTransmission", "Null"),
)
TECHNIQUES = ("uniform", "cosine", "bsdf", "emitter", "mis")


@dataclass(frozen=True, slots=True)
class Vertex:
    """The surface that a pixel's centre sees; is_hit False where it sees none.

    position, distance: in the units of the scene as it was written; distance is the channel depth, from the camera's
    near plane. emitted: luminance that it sends to the camera by itself. lobes: how it scatters, in Mitsuba's words.
    passes_light: whether directions below the surface count.
    """

    is_hit: bool
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    normal: tuple[float, float, float] = (0.0, 0.0, 0.0)
    distance: float = 0.0
    emitted: float = 0.0
    lobes: tuple[str, ...] = ()
    is_smooth: bool = False
    passes_light: bool = False


@dataclass(frozen=True, slots=True)
class Drawn:
    """Directions that one technique drew: u, v in [0, 1) on the map.

    found: whether light was found there (emitter sampling: the light is visible), None for techniques that do not look
    for light. lost: how many directions lie below the surface, where no light counts.
    """

    lost: int
    u: NDArray[np.float32]
    v: NDArray[np.float32]
    found: NDArray[np.bool_] | None


class Lesson:
    """One pixel of one scene, loaded with colour rgb. Raises SettingsError for a pixel outside the picture."""

    def __init__(self, scene: Scene, x: int, y: int) -> None:
        if scene.colour != "rgb":
            raise SettingsError(f"colour is {scene.colour!r}; a lesson needs a scene loaded with colour rgb")
        if scene.requirements.media:
            raise SettingsError(
                "the scene has participating media, and a lesson shows the light that arrives at a surface through "
                "empty space; take a scene without media"
            )
        if not (0 <= x < scene.width and 0 <= y < scene.height):
            raise SettingsError(f"pixel ({x}, {y}) is outside the picture of {scene.width}×{scene.height}")
        self.scene, self.x, self.y = scene, x, y
        position = mi.Point2f((x + 0.5) / scene.width, (y + 0.5) / scene.height)
        open_at, open_for = float(scene.sensor.shutter_open()), float(scene.sensor.shutter_open_time())
        self.ray, _ = scene.sensor.sample_ray(open_at + 0.5 * open_for, 0.5, position, mi.Point2f(0.5))
        self.si = scene.mitsuba_scene.ray_intersect(self.ray)
        dr.eval(self.ray, self.si)

    @cached_property
    def vertex(self) -> Vertex:
        """What the pixel's centre sees."""
        si = self.si
        if not _only(si.is_valid()):
            return Vertex(is_hit=False)
        flags = _only(si.bsdf().flags())
        placing = self.scene.similarity  # what is told is in the units of the scene as it was written
        emitter = si.emitter(self.scene.mitsuba_scene)
        light = PathKernel.to_rgb(emitter.eval(si), self.ray.wavelengths)
        return Vertex(
            is_hit=True,
            position=_triple(placing.original_position(np.array(si.p, dtype=np.float64).reshape(-1)[:3])),
            normal=_triple(si.sh_frame.n),
            distance=float(placing.original_distance(_only(si.t))),
            emitted=float(_only(mi.luminance(light))),
            lobes=tuple(name for name in _LOBES if flags & int(getattr(mi.BSDFFlags, name))),
            is_smooth=bool(flags & int(mi.BSDFFlags.Smooth)),
            passes_light=bool(flags & int(mi.BSDFFlags.Transmission)),
        )

    @property
    def polar_range(self) -> float:
        """Radians of θ that the map covers."""
        return math.pi if self.vertex.passes_light else math.pi / 2

    def incident(self, replicates: range, seed: int = 0) -> Moments:
        """Moments of the radiance that arrives from each direction of the map, row-major, θ downwards."""
        columns, rows = self.map_size
        kernel = self._map_kernel()
        n = columns * rows
        pixels = np.tile(np.arange(n, dtype=np.uint32), len(replicates))
        numbers = np.repeat(np.asarray(replicates, dtype=np.uint32), n)
        radiance, invalid, _ = kernel.launch(pixels, numbers, seed)
        moments = Moments.empty(n)
        values = np.array(radiance, dtype=np.float64).T
        not_finite = np.array(invalid)
        for i in range(len(replicates)):
            part = slice(i * n, (i + 1) * n)
            moments.add(slice(None), values[part], not_finite[part], REPLICATE_SIZE)
        return moments

    @property
    def map_size(self) -> tuple[int, int]:
        """Columns and rows of the map."""
        return MAP_COLUMNS, MAP_COLUMNS // (2 if self.vertex.passes_light else 4)

    def integrand(self) -> NDArray[np.float32]:
        """f·cosθ towards the camera for each direction of the map, (rows, columns, 3): times radiance, what is
        integrated. Delta lobes have none."""
        columns, rows = self.map_size
        v, u = np.meshgrid((np.arange(rows) + 0.5) / rows, (np.arange(columns) + 0.5) / columns, indexing="ij")
        wo = _direction(mi.Float(_floats(u)), mi.Float(_floats(v)), self.polar_range)
        value = self.si.bsdf().eval(mi.BSDFContext(), self.si, wo)
        rgb = np.array(PathKernel.to_rgb(value, self.ray.wavelengths), dtype=np.float32)
        return np.broadcast_to(rgb.reshape(3, -1).T, (rows * columns, 3)).reshape(rows, columns, 3)

    def directions(self, technique: str, n: int, seed: int = 0) -> Drawn:
        """The first `n` directions that a technique draws here; `mis` draws those of `bsdf` and of `emitter`."""
        numbers = dr.arange(mi.UInt32, n)
        key_a, key_b = Sequence.keys(mi.UInt32(seed), mi.UInt32(0), mi.UInt32(0), numbers)
        sequence = Sequence(mi, key_a, key_b, mi.UInt32(1), stratified=False)
        first, second = sequence.point(mi.UInt32(0), 0), sequence.point(mi.UInt32(0), 1)
        if technique == "emitter":
            return self._towards_lights(first)
        bs, _ = Directions(technique).sample(self.si.bsdf(), mi.BSDFContext(), self.si, second.x, first, mi.Mask(True))
        return self._on_map(bs.wo, bs.pdf > 0, None)

    def _towards_lights(self, u: Any) -> Drawn:
        sampler = EmitterSampler(lights_of(self.scene.mitsuba_scene))
        if sampler.is_empty:
            return self._on_map(mi.Vector3f(0, 0, 1), mi.Mask(False), mi.Mask(False))
        ds, weight = sampler.sample(self.si, u, mi.Mask(True))
        found = (ds.pdf != 0) & dr.any(weight != 0) & ~self.scene.mitsuba_scene.ray_test(self.si.spawn_ray_to(ds.p))
        return self._on_map(self.si.to_local(ds.d), ds.pdf != 0, found)

    def _on_map(self, wo: Any, is_drawn: Any, found: Any) -> Drawn:
        """Directions that lie on the map; those below a surface that no light passes never count."""
        theta = dr.safe_acos(wo.z)
        phi = dr.atan2(wo.y, wo.x)
        u = np.array(phi, dtype=np.float32) / (2 * math.pi) % 1
        v = np.array(theta, dtype=np.float32) / self.polar_range
        keep = np.array(is_drawn, dtype=np.bool_) & (v < 1)
        u, v, keep = np.broadcast_arrays(u, v, keep)
        seen = None if found is None else np.broadcast_to(np.array(found, dtype=np.bool_), keep.shape)[keep]
        return Drawn(int((~keep).sum()), u[keep], v[keep], seen)

    @cached_property
    def camera_direction(self) -> tuple[float, float]:
        """Place on the map of the direction towards the camera, ωo."""
        x, y, z = np.array(self.si.wi, dtype=np.float64).reshape(-1)[:3]
        return math.atan2(y, x) / (2 * math.pi) % 1, math.acos(min(max(z, -1.0), 1.0)) / self.polar_range

    def samples(
        self, technique: str, replicates: range, seed: int = 0, max_depth: int | None = None
    ) -> NDArray[np.float64]:
        """Luminance of the pixel's samples number `replicates` by a technique: independent, of one path each.

        max_depth: of paths, where it is less than the scene's; 2 is light that was reflected once at most.
        """
        settings = self.scene.resolved(Settings(technique=technique, independent_pixels=True), 1)  # type: ignore[arg-type]
        pixel = np.full(len(replicates), self.y * self.scene.width + self.x, dtype=np.uint32)
        kernel = self.scene.kernel(settings)
        if max_depth is not None and not 0 <= (settings.max_depth or UNLIMITED_DEPTH) <= max_depth:
            kernel = kernel.with_depth_limit(max_depth)
        radiance, *_ = kernel.launch(pixel, np.asarray(replicates, dtype=np.uint32), seed)
        return np.array(mi.luminance(mi.Color3f(radiance)), dtype=np.float64)

    def _map_kernel(self) -> PathKernel:
        columns, rows = self.map_size
        needs = self.scene.requirements
        depth = self.scene.resolved(Settings(), 1).max_depth or UNLIMITED_DEPTH
        model = Model(
            technique="mis",
            # One vertex of the path is this one.
            max_depth=depth if depth < 0 else max(depth - 1, 1),
            rr_depth=needs.rr_depth,
            replicate_size=REPLICATE_SIZE,
            has_sampleable_emitters=bool(needs.emitters),
            has_lens=False,
        )
        sensor = _SurfaceCamera(self.scene.sensor, self.si, self.polar_range)
        return PathKernel(self.scene.mitsuba_scene, sensor, (columns, rows), model)


class _SurfaceCamera:
    """Looks from a point of a surface into all directions: what `PathKernel` asks of a sensor, and no more."""

    def __init__(self, sensor: Any, si: Any, polar_range: float) -> None:
        # Opaque, so that one compiled kernel serves all points of a scene.
        self._sensor = sensor
        self._si = si
        self._polar_range = dr.opaque(mi.Float, polar_range)
        self._filter = mi.load_dict({"type": "box"})

    def film(self) -> Any:
        return self

    def rfilter(self) -> Any:
        return self._filter

    def shutter_open(self) -> float:
        return float(_only(self._si.time))

    def shutter_open_time(self) -> float:
        return 0.0

    def sample_ray(self, time: Any, u_wavelength: Any, position: Any, lens: Any, active: Any) -> tuple[Any, Any]:
        """A ray from the surface and the weight 1."""
        si = self._si
        ray = si.spawn_ray(si.to_world(_direction(position.x, position.y, self._polar_range)))
        wavelengths, weight = self._sensor.sample_wavelengths(dr.zeros(mi.SurfaceInteraction3f), u_wavelength, active)
        if mi.is_spectral:
            ray.wavelengths = wavelengths
        return ray, weight


def _direction(u: Any, v: Any, polar_range: Any) -> Any:
    """The local direction at (u, v) of the map."""
    sin_phi, cos_phi = dr.sincos(dr.two_pi * u)
    sin_theta, cos_theta = dr.sincos(polar_range * v)
    return mi.Vector3f(sin_theta * cos_phi, sin_theta * sin_phi, cos_theta)


@dataclass(frozen=True, slots=True)
class Running:
    """Moments of the first n samples. m2, m3, m4: sums of powers of the deviations from the mean; the fourth tells how
    well the variance itself is known. lit: samples that found any light.
    """

    n: int
    mean: float
    m2: float
    m3: float
    m4: float
    lit: int


def running(values: NDArray[np.float64], first: int) -> list[Running]:
    """Moments of ever more of these samples, at geometric steps, up to all of them.

    first: number of the first sample, so that steps fall on the same numbers however samples are cut into parts.
    """
    ends = sorted({*(e - first for e in checkpoints(first + len(values)) if e > first), len(values)})
    return [moments_of(values[:end]) for end in ends if end > 0]


def moments_of(values: NDArray[np.float64]) -> Running:
    """Moments of all of these samples."""
    mean = float(values.mean())
    off = values - mean
    square = off * off
    m2, m3, m4 = (float(power.sum()) for power in (square, square * off, square * square))
    return Running(len(values), mean, m2, m3, m4, int(np.count_nonzero(values)))


def checkpoints(most: int) -> list[int]:
    """Whole numbers a factor of about 2^(1/2) apart, up to `most`."""
    return sorted({round(2 ** (i / 2)) for i in range(2, 64) if 2 ** (i / 2) <= most})


def _only(value: Any) -> Any:
    """The one entry of an array of width one, or the value itself."""
    array = np.array(value)
    return array.reshape(-1)[0].item() if array.size else value


def _triple(vector: Any) -> tuple[float, float, float]:
    x, y, z = np.array(vector, dtype=np.float64).reshape(-1)[:3]
    return float(x), float(y), float(z)


def _floats(values: NDArray[np.float64]) -> NDArray[np.float32]:
    return values.ravel().astype(np.float32)
