"""What lies behind each pixel: albedo, normal, depth, position, shape, alpha. For denoisers, compositing and masks.

Enters: a loaded scene and its camera. Leaves: one array per channel, from the first hit of the same camera rays that a
pixel's first replicate starts with. Conventions, where they matter:

- albedo, normal: mean over the samples, a miss counting as 0, as denoisers expect. normal is the shading normal in
  world space; albedo the diffuse reflectance (0 for mirrors and glass), linear sRGB.
- depth, position: mean over the samples that hit something, 0 where none did. depth is the distance along the ray from
  the camera, in the scene's units; position is in world space.
- shape_index: of the first sample, the position in `scene.shapes()`; −1 where it hits nothing. Mitsuba merges meshes
  that share a material into one shape.
- alpha: as `path` of Mitsuba has it, mean over the samples: 1 where a path meets a surface that does more than let it
  pass, and everywhere under a sky that is not hidden. Of a medium, the share that does not pass it straight; all other
  channels are of the first surface, be it the border of a medium.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from renderer.backend import mitsuba, using
from renderer.equation.media import Stream
from renderer.equation.mueller import intensity
from renderer.equation.path import (
    BSDF_DIRECTION,
    LENS,
    LOBE_AND_ROULETTE,
    PER_VERTEX,
    PIXEL,
    TIME_AND_WAVELENGTH,
    PathKernel,
)
from renderer.equation.sequence import Sequence

mi: Any = mitsuba()

SAMPLES = 16
ONE_VALUE = ("depth", "shape_index", "alpha")
MOST_PASSED = 64  # surfaces that a ray may pass before what is behind counts as seen
MAX_LANES = 2**20  # of one launch: bounds memory on large images


def render_channels(
    kernel: PathKernel, names: tuple[str, ...], width: int, height: int, seed: int
) -> dict[str, NDArray[np.float32]]:
    """The named channels, each (H, W, 1) or (H, W, 3) float32."""
    n = width * height
    with dr.suspend_grad(), using(kernel.variant):
        parts = [_chunk(kernel, names, start, min(n, start + MAX_LANES), seed) for start in range(0, n, MAX_LANES)]
    joined = {name: np.concatenate([part[name] for part in parts]) for name in names}
    return {name: values.reshape(height, width, -1).astype(np.float32) for name, values in joined.items()}


def _chunk(kernel: PathKernel, names: tuple[str, ...], start: int, stop: int, seed: int) -> dict[str, NDArray]:
    """Channels of pixels start … stop − 1."""
    sums = {name: np.zeros((stop - start, 1 if name in ONE_VALUE else 3)) for name in names}
    white = np.zeros((stop - start, 3))
    hits = np.zeros((stop - start, 1))
    for index in range(SAMPLES):
        found = _sample(kernel, names, start, stop - start, seed, index)
        hits += found["hit"]
        white += found["white"]
        for name in names:
            if name != "shape_index" or index == 0:
                sums[name] += found[name]
    for name in names:
        if name in ("depth", "position"):
            sums[name] /= np.maximum(hits, 1)
        elif name in ("normal", "alpha"):
            sums[name] /= SAMPLES
        elif name == "albedo":
            # Relative to what a white surface would give: with sampled wavelengths both vary together.
            sums[name] /= np.where(white > 0, white, SAMPLES)
    return sums


def _sample(
    kernel: PathKernel, names: tuple[str, ...], start: int, n: int, seed: int, index: int
) -> dict[str, NDArray[np.float64]]:
    """One sample of each of n pixels from `start` on."""
    width, height, replicate_size = kernel.sizes[:3]
    pixel = dr.arange(mi.UInt32, n) + dr.opaque(mi.UInt32, start)
    low, high = dr.opaque(mi.UInt32, seed & 0xFFFFFFFF), dr.opaque(mi.UInt32, seed >> 32)
    key_a, key_b = Sequence.keys(low, high, pixel, mi.UInt32(0))
    # A sequence repeats itself after as many points as its replicates have.
    sequence = Sequence(mi, key_a, key_b, dr.maximum(replicate_size, SAMPLES), kernel.model.stratified)
    sample = dr.opaque(mi.UInt32, index)
    offset, weight = kernel.filter.sample(sequence.point(sample, PIXEL))
    corner = mi.Point2f(mi.Float(pixel % width), mi.Float(pixel // width))
    position = (corner + offset) / mi.Vector2f(mi.Float(width), mi.Float(height))
    extra = sequence.point(sample, TIME_AND_WAVELENGTH)
    time = kernel.shutter_open + kernel.shutter_time * extra.x
    ray, spectral_weight = kernel.camera.sample_ray(time, extra.y, position, sequence.point(sample, LENS))
    si = kernel.mitsuba_scene.ray_intersect(ray, mi.RayFlags.All, True, True)
    hit = si.is_valid()

    values: dict[str, Any] = {"hit": dr.select(hit, mi.Float(1), 0)}
    spectral_weight = intensity(spectral_weight)
    values["white"] = kernel.to_rgb(spectral_weight, ray.wavelengths) * weight
    if "albedo" in names:
        albedo = si.bsdf().eval_diffuse_reflectance(si, hit)
        albedo = intensity(albedo) * spectral_weight
        values["albedo"] = dr.select(hit, kernel.to_rgb(albedo, ray.wavelengths) * weight, 0)
    if "normal" in names:
        values["normal"] = dr.select(hit, si.sh_frame.n * weight, 0)
    if "depth" in names:
        values["depth"] = dr.select(hit, si.t, 0)
    if "position" in names:
        values["position"] = dr.select(hit, si.p, 0)
    if "alpha" in names:
        values["alpha"] = _alpha(kernel, sequence, sample, ray, si) * weight
    if "shape_index" in names:
        values["shape_index"] = _shape_index(kernel.mitsuba_scene, si, hit)
    dr.eval(values)
    return {name: _columns(value, n) for name, value in values.items()}


def _alpha(kernel: PathKernel, sequence: Sequence, sample: Any, ray: Any, si: Any) -> Any:
    """1 where the sample's path is scattered by a surface, else 0. Hidden lights and null surfaces are passed."""
    hides = kernel.model.hide_emitters
    if not hides and kernel.mitsuba_scene.environment() is not None:
        return mi.Float(1)
    alpha = mi.Float(0)
    media, through = kernel.media, mi.Float(1)
    stream, drawn = Stream(sequence.key_a, sequence.key_b, sample), mi.UInt32(0)
    medium = mi.UInt32(0) if media is None else media.sensor_key
    if media is not None:
        ratio, drawn = media.transmittance(ray, medium, dr.minimum(si.t, ray.maxt), stream, drawn, mi.Bool(True))
        through *= dr.mean(ratio)
    active = si.is_valid()
    is_first = mi.Bool(True)  # as far as depth goes, of which hidden lights take none
    for passed in range(MOST_PASSED):
        is_hidden = active & is_first & (si.shape.emitter() != None) & hides  # noqa: E711 (a Dr.Jit comparison)
        vertex = PER_VERTEX * (passed + 1)
        lobe = sequence.point(sample, vertex + LOBE_AND_ROULETTE).x
        u = sequence.point(sample, vertex + BSDF_DIRECTION)
        bs, _ = si.bsdf(ray).sample(mi.BSDFContext(), si, lobe, u, active)
        passes = is_hidden | mi.has_flag(bs.sampled_type, mi.BSDFFlags.Null)
        alpha[active & ~passes] = 1
        active &= passes
        if not (hides or kernel.model.has_null) or not dr.any(active):
            break
        is_first &= is_hidden
        if media is not None:
            medium = media.target(si, ray.d, medium, active & ~is_hidden)
        ray = si.spawn_ray(ray.d)
        si = kernel.mitsuba_scene.ray_intersect(ray, mi.RayFlags.All, False, active)
        if media is not None:
            ratio, drawn = media.transmittance(ray, medium, si.t, stream, drawn, active)
            through *= dr.mean(ratio)
        active &= si.is_valid()
    return dr.select(alpha == 1, 1, 1 - through)


def _columns(value: Any, n: int) -> NDArray[np.float64]:
    """(n, 1) or (n, 3) of a Dr.Jit array, whose width is 1 where all lanes are equal."""
    rows = np.atleast_2d(np.array(value, dtype=np.float64))
    return np.broadcast_to(rows, (len(rows), n)).T


def _shape_index(scene: Any, si: Any, hit: Any) -> Any:
    """Position in scene.shapes() of what was hit; an instance counts as itself."""
    ids = np.array([np.array(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape)))[0] for shape in scene.shapes()])
    table = np.full(int(ids.max(initial=0)) + 1, -1.0, np.float32)
    table[ids] = np.arange(len(ids))
    found = dr.select(si.instance != None, si.instance, si.shape)  # noqa: E711 (a Dr.Jit comparison)
    key: Any = dr.reinterpret_array(mi.UInt32, found)
    known = hit & (key < len(table))
    return dr.select(known, dr.gather(mi.Float, mi.Float(table), dr.select(known, key, 0), known), -1)
