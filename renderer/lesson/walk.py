"""One light path, vertex by vertex: the ray-casting operator at work.

    Li(p, ω) = Lo(r(p, ω), −ω)      r(p, ω): the point that a ray from p in direction ω meets first

Enters: a lesson's pixel and a number. Leaves: where the path goes from the pixel's centre, with directions drawn by the
BSDF as by technique `bsdf`; what each vertex shines by itself, what the path still carries when it gets there, and so
what it adds to the pixel. The sum over the vertices is one sample of the radiance at the pixel's centre.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from renderer.backend import mitsuba
from renderer.equation.path import BSDF_DIRECTION, LOBE_AND_ROULETTE, PER_VERTEX, PathKernel
from renderer.equation.sequence import Sequence
from renderer.equation.techniques import Directions
from renderer.lesson.pixel import Lesson

mi: Any = mitsuba()

MOST_VERTICES = 24  # where the scene asks for no less
Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Step:
    """A vertex of each of n paths, in the coordinates of the rendered scene.

    is_there: whether the path came so far. is_sky: it left the scene: then position is where it was last, and direction
    whither. position, direction: (n, 3), direction towards this vertex. distance: from the vertex before.
    emitted: luminance of what it shines towards the vertex before, Le(p, −ω). throughput: luminance of what the path
    carries there. added: luminance of their product over the channels. cos_theta, pdf: of the next direction; f_cos:
    luminance of f·cosθ of that direction, nan for mirrors and clear glass, whose f is no number; is_seen: from the
    camera, straight.
    """

    is_there: NDArray[np.bool_]
    is_sky: NDArray[np.bool_]
    position: Array
    direction: Array
    distance: Array
    emitted: Array
    throughput: Array
    added: Array
    cos_theta: Array
    pdf: Array
    f_cos: Array
    is_seen: NDArray[np.bool_]


def walk(lesson: Lesson, numbers: range, seed: int = 0) -> list[Step]:
    """Paths number `numbers` from the pixel's centre, until they leave the scene, carry nothing, or are as long as the
    scene asks, at most MOST_VERTICES vertices.
    """
    scene, n = lesson.scene, len(numbers)
    depth = scene.requirements.max_depth
    most = MOST_VERTICES if depth < 0 else min(depth, MOST_VERTICES)
    number = mi.UInt32(np.asarray(numbers, dtype=np.uint32))
    keys = Sequence.keys(mi.UInt32(seed), mi.UInt32(0), mi.UInt32(lesson.y * scene.width + lesson.x), number)
    sequence = Sequence(mi, *keys, mi.UInt32(1), stratified=False)
    directions = Directions("bsdf", "blendbsdf" in scene.requirements.bsdfs and scene.requirements.has_delta)
    ray = dr.gather(type(lesson.ray), lesson.ray, dr.zeros(mi.UInt32, n))
    camera = mi.Point3f(ray.o)
    # Opaque, so that one compiled kernel serves all vertices.
    throughput, active = mi.Spectrum(dr.opaque(mi.Float, 1, n)), dr.opaque(mi.Bool, True, n)
    steps: list[Step] = []
    for vertex in range(most):
        si = scene.mitsuba_scene.ray_intersect(ray, active)
        emitter = si.emitter(scene.mitsuba_scene, active)
        is_shown = dr.opaque(mi.Bool, vertex > 0 or not scene.requirements.hide_emitters)
        emission = dr.select(active & (emitter != None) & is_shown, emitter.eval(si, active), 0)  # noqa: E711
        bsdf = si.bsdf(ray)
        dimension = dr.opaque(mi.UInt32, PER_VERTEX * (vertex + 1))
        lobe = sequence.point(mi.UInt32(0), dimension + LOBE_AND_ROULETTE).x
        u = sequence.point(mi.UInt32(0), dimension + BSDF_DIRECTION)
        goes_on = active & si.is_valid()
        bs, weight = directions.sample(bsdf, mi.BSDFContext(), si, lobe, u, goes_on)
        f_cos = bsdf.eval(mi.BSDFContext(), si, bs.wo, goes_on)
        towards = mi.Ray3f(si.spawn_ray_to(camera))
        is_seen = goes_on & ~scene.mitsuba_scene.ray_test(towards, goes_on)
        told = (
            active,
            active & ~si.is_valid(),
            dr.select(si.is_valid(), si.p, ray.o),
            mi.Vector3f(ray.d),
            dr.select(si.is_valid(), si.t, dr.inf),
            _luminance(emission, ray),
            _luminance(throughput, ray),
            _luminance(dr.select(active, throughput * emission, 0), ray),
            mi.Frame3f.cos_theta(bs.wo),
            bs.pdf,
            dr.select(mi.has_flag(bs.sampled_type, mi.BSDFFlags.Delta), dr.nan, _luminance(f_cos, ray)),
            is_seen,
        )
        throughput = dr.select(goes_on, throughput * weight, 0)
        active = goes_on & dr.any(throughput != 0)
        ray = si.spawn_ray(si.to_world(bs.wo))
        ray.wavelengths = lesson.ray.wavelengths
        dr.eval(told, ray, throughput, active)  # in one kernel: each by itself would trace the rays anew
        steps.append(Step(*(_array(values, n) for values in told)))
        if not dr.any(active):
            break
    return steps


def _array(values: Any, n: int) -> Any:
    """(n,) flags or numbers, or (n, 3) of vectors; what is equal for all paths is one value to Dr.Jit."""
    told = np.array(values)
    if told.ndim == 2:
        return np.broadcast_to(told.T.astype(np.float64), (n, 3))
    return np.broadcast_to(told if told.dtype == np.bool_ else told.astype(np.float64), (n,))


def _luminance(spectrum: Any, ray: Any) -> Any:
    return mi.luminance(PathKernel.to_rgb(mi.Spectrum(spectrum), ray.wavelengths))
