"""Numbers at the edge of float32: the formula that one writes down first beside the one that the renderer has.

Enters: the name of an extreme and a place on its ladder. Leaves: what the exact answer is, what the naive formula gives
in plain float32, and what the renderer gives: its kernel on a scene of the kind, its moments on samples, its rays.
Nothing here is written down in advance but the exact answers, which are formulas in float64.
Sources: PBRT 4th ed., section 6.8 (rounding error); Haines, Günther & Akenine-Möller 2019 (spheres); Veach 1997, 9.2
(weights); Welford 1962, Chan, Golub & LeVeque 1979 (variance).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from renderer.backend import mitsuba, using
from renderer.errors import SettingsError
from renderer.estimate.interval import t_quantile
from renderer.estimate.moments import Moments
from renderer.scene.compile import load_scene
from renderer.scene.rewrite import passes
from renderer.settings import Settings

ALBEDO = 0.5
REPLICATES = 16  # of each pixel
REPLICATE = 64  # samples that are added in float32 before float64 takes over, as in the kernel
CONSTANT = np.float32(0.7)
LANES = 4096  # moments that are folded side by side, then merged
ACCUMULATED = 1 << 20  # samples whose float32 sums are in memory together


@dataclass(frozen=True, slots=True)
class Rung:
    """One place on a ladder. at: the place. naive: in float32, and may be inf or nan. half: half-width of the 95 %
    interval of what was rendered; 0 where nothing is random.
    """

    at: float
    exact: float
    naive: float
    ours: float
    half: float = 0.0


# ------------------------------ Lights ------------------------------


def small_light(angle: float) -> Rung:
    """Irradiance of a floor from a sphere light that looks `angle` radians in radius, and the larger its radiance.

    Naive: Lₑ ∫ cosθ dω = Lₑ π (1 − cos)(1 + cos) of that angle: the first is the difference of two numbers that are
    nearly equal. Exact: Lₑ π sin².
    """
    sine = angle  # of a sphere of that radius at distance 1
    radiance = 1 / (math.pi * sine**2)
    f = np.float32
    cosine = np.sqrt(f(1) - f(sine) * f(sine))
    naive = f(radiance) * f(math.pi) * (f(1) - cosine) * (f(1) + cosine)
    lamp = {"type": "sphere", "center": [0, 0, 1], "radius": angle, "emitter": _area(radiance)}
    mean, half = _rendered(_over_a_floor(lamp))
    to_irradiance = math.pi / ALBEDO
    return Rung(angle, 1.0, float(naive), mean * to_irradiance, half * to_irradiance)


def far_light(distance: float) -> Rung:
    """Irradiance of a floor from a light of 1×1 at a distance, of radiance distance²: 1 wherever it is.

    Naive: the power heuristic as it stands in books, a² / (a² + b²), on the light's density per solid angle.
    """
    f = np.float32
    by_light, by_surface = f(distance) * f(distance), f(1 / math.pi)
    with np.errstate(over="ignore", invalid="ignore"):
        naive = by_light * by_light / (by_light * by_light + by_surface * by_surface)
    transform = mitsuba().ScalarTransform4f
    place = transform().translate([0, 0, distance]).rotate([1, 0, 0], 180).scale(0.5)
    mean, half = _rendered(_over_a_floor({"type": "rectangle", "to_world": place, "emitter": _area(distance**2)}))
    return Rung(distance, 1.0, float(naive), mean * math.pi / ALBEDO, half * math.pi / ALBEDO)


def _area(radiance: float) -> dict[str, Any]:
    return {"type": "area", "radiance": radiance}


def _over_a_floor(lamp: dict[str, Any]) -> dict[str, Any]:
    """A small patch of floor at the origin, seen from above."""
    transform = mitsuba().ScalarTransform4f
    look = transform().look_at([0, 0, 0.5], [0, 0, 0], [0, 1, 0]).scale([1e-3, 1e-3, 1])
    film = {"type": "hdrfilm", "width": 8, "height": 8, "rfilter": {"type": "box"}}
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 2},
        "sensor": {"type": "orthographic", "to_world": look, "film": film},
        "floor": {"type": "rectangle", "bsdf": {"type": "diffuse", "reflectance": ALBEDO}},
        "lamp": lamp,
    }


def _rendered(
    scene: dict[str, Any], rewrites: Collection[str] = passes.ALL, *, by_tree: bool = False
) -> tuple[float, float]:
    """Mean luminance of the picture and the half-width of its 95 % interval, always from samples of the same numbers.

    by_tree: with Mitsuba's rays, which start a hair above surfaces, instead of the renderer's own.
    """
    loaded = load_scene(scene, rewrites=rewrites)
    settings = loaded.resolved(Settings(independent_pixels=True), REPLICATE)
    model = loaded.model(settings)
    if by_tree:
        model = replace(model, has_tree=True)
    n = loaded.width * loaded.height
    lanes = np.arange(n * REPLICATES, dtype=np.uint32)
    radiance, invalid, *_ = loaded.kernel_of(model).launch(lanes % n, lanes // n, 1)
    values, not_finite = np.array(radiance, dtype=np.float64).T, np.array(invalid)
    moments = Moments.empty(n)
    for i in range(REPLICATES):
        part = slice(i * n, (i + 1) * n)
        moments.add(slice(None), values[part], not_finite[part], REPLICATE)
    error = math.sqrt(float(moments.variance_of_mean()[:, 3].sum())) / n
    return float(moments.luminance().mean()), float(t_quantile(0.975, n * (REPLICATES - 1))) * error


# ------------------------------ Places ------------------------------


def far_scene(offset: float) -> Rung:
    """Mean of the picture of a lit room of 2×2×2 that lies `offset` from the origin along each axis.

    Naive: rays that start a hair above their surface, 9e-5·(1 + largest coordinate), on coordinates as they are
    written; ours moves the scene to the origin first. Exact: the room at the origin, with the same samples: what noise
    they have is the same.
    """
    exact, _ = _rendered(_room(0.0))
    as_written = [name for name in passes.ALL if name != passes.SIMILARITY]
    naive, _ = _rendered(_room(offset), as_written, by_tree=True)
    ours, _ = _rendered(_room(offset))
    return Rung(offset, exact, naive, ours)


def _room(offset: float) -> dict[str, Any]:
    transform = mitsuba().ScalarTransform4f
    here = transform().translate([offset, offset, offset])
    white, lamp = {"type": "diffuse", "reflectance": ALBEDO}, here.translate([0, 0, 0.98]).rotate([1, 0, 0], 180)
    turns = {"floor": ([1, 0, 0], 0), "ceiling": ([1, 0, 0], 180), "left": ([0, 1, 0], 90), "right": ([0, 1, 0], -90)}
    turns |= {"back": ([1, 0, 0], 90)}
    walls = {
        name: {"type": "rectangle", "to_world": here.rotate(axis, angle).translate([0, 0, -1]), "bsdf": white}
        for name, (axis, angle) in turns.items()
    }
    look = here.look_at([0, -3.5, 0], [0, 0, 0], [0, 0, 1])
    film = {"type": "hdrfilm", "width": 12, "height": 12, "rfilter": {"type": "box"}}
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 4},
        "sensor": {"type": "perspective", "fov": 40, "to_world": look, "film": film},
        "ball": {"type": "sphere", "radius": 0.4, "to_world": here, "bsdf": white},
        "lamp": {"type": "rectangle", "to_world": lamp.scale(0.3), "emitter": _area(10.0)},
        **walls,
    }


def thin_gap(gap: float) -> Rung:
    """Length of a ray that leaves a ball of radius 1 along its normal, to a shell that is `gap` larger.

    Naive: the quadratic formula, whose c = |o|² − r² is the difference of two numbers that are nearly equal, and which
    starts a hair above the ball, lest it meet that again: 9e-5·(1 + largest coordinate), and beyond the shell if that
    is nearer. Exact: for the radius that float32 can have.
    """
    f = np.float32
    radius = f(1) + f(gap)
    hair = f(9e-5) * (f(1) + f(1))
    start = f(1) + hair
    b, c = f(2) * start, start * start - radius * radius
    with np.errstate(invalid="ignore"):
        t = (-b + np.sqrt(b * b - f(4) * c)) / f(2) + hair
    naive = float(t) if start < radius else math.nan
    return Rung(gap, float(radius) - 1.0, naive, _length_of_ray(float(radius)))


def _length_of_ray(radius: float) -> float:
    """From the ball to the shell, by the renderer's rays, in the units of the scene as it was written."""
    from renderer.equation.rays import NOWHERE

    scene = load_scene(
        {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 2},
            "sensor": {"type": "perspective", "film": {"type": "hdrfilm", "width": 1, "height": 1}},
            "ball": {"type": "sphere", "radius": 1.0},
            "shell": {"type": "sphere", "radius": radius, "bsdf": {"type": "null"}},
            "sky": {"type": "constant"},
        }
    )
    with using(scene.variant):
        mi = mitsuba()
        rays = scene.kernel(scene.resolved(Settings(), 1)).rays
        # From above through the shell onto the ball, then back from where that ray has arrived.
        top = [float(c) for c in scene.similarity.moved([0, 0, 3.0])]
        down = mi.Ray3f(mi.Point3f(*top), mi.Vector3f(0, 0, -1))
        outer = rays.meet(down, mi.UInt32(NOWHERE), mi.Mask(True))
        met = rays.meet(mi.Ray3f(rays.origin(outer.si, down.d), down.d), outer.surface, mi.Mask(True))
        up = mi.Vector3f(0, 0, 1)
        found = rays.meet(mi.Ray3f(rays.origin(met.si, up), up), met.surface, mi.Mask(True))
        length = float(np.array(found.si.t, dtype=np.float64).ravel()[0])
    return float(scene.similarity.original_distance(length))


# ------------------------------ Sums ------------------------------


def many_samples(n: float) -> Rung:
    """Mean of n samples that are all 0.7. Naive: one running sum in float32. Ours: replicates of 64 in float32, folded
    into moments in float64."""
    count = round(n)
    total, left = np.float32(0), count
    while left > 0 and total + CONSTANT != total:  # from there on no further sample changes it
        part = np.full(min(left, ACCUMULATED), CONSTANT, np.float32)
        part[0] += total
        total = np.add.accumulate(part)[-1]
        left -= len(part)
    exact = float(CONSTANT)
    return Rung(float(count), exact, float(total / np.float32(count)), _folded(count))


def _folded(count: int) -> float:
    """Mean of `count` equal samples, at least; lanes side by side as in a picture, then merged."""
    replicates = -(-count // REPLICATE)
    lanes = min(LANES, 1 << max(0, int(math.log2(replicates))))
    mean = np.add.accumulate(np.full(REPLICATE, CONSTANT, np.float32))[-1] / np.float32(REPLICATE)
    value = np.full((lanes, 3), mean, np.float32)
    nothing = np.zeros(lanes, np.uint32)
    moments = Moments.empty(lanes)
    for _ in range(-(-replicates // lanes)):
        moments.add(slice(None), value, nothing, REPLICATE)
    return float(_merged(moments).mean[0, 1])


def _merged(moments: Moments) -> Moments:
    """One pixel's moments from those of a power of two of them."""
    while len(moments.count) > 1:
        half = len(moments.count) // 2
        moments = moments.at(slice(0, half)).merge(moments.at(slice(half, None)))
    return moments


def small_variance(mean: float) -> Rung:
    """Variance of 4096 samples of standard deviation 1 about a mean. Naive: E[x²] − E[x]² in float32. Exact: about the
    mean, in float64, of the very same samples."""
    n = 4096
    x = (mean + np.random.default_rng(1).standard_normal(n)).astype(np.float32)
    squares, values = np.float32(0), np.float32(0)
    for value in x:
        values += value
        squares += value * value
    average = values / np.float32(n)
    naive = (squares / np.float32(n) - average * average) * np.float32(n) / np.float32(n - 1)
    lanes = 64
    moments, nothing = Moments.empty(lanes), np.zeros(lanes, np.uint32)
    for part in x.reshape(-1, lanes):
        moments.add(slice(None), np.repeat(part[:, None], 3, axis=1), nothing, 1)
    wide = x.astype(np.float64)
    exact = float(np.square(wide - wide.mean()).sum() / (n - 1))
    return Rung(mean, exact, float(naive), float(_merged(moments).variance()[0, 1]))


def _decades(first: int, last: int) -> tuple[float, ...]:
    step = 1 if last >= first else -1
    return tuple(10.0**k for k in range(first, last + step, step))


LADDERS: dict[str, tuple[Callable[[float], Rung], tuple[float, ...]]] = {
    "small-light": (small_light, (1e-1, 1e-2, 4.65e-3, 1e-3, 2e-4, 1e-4, 1e-6)),
    "far-light": (far_light, (1e2, 1e5, 1e7, 1e8, 1e9, 1e10, 1e12)),
    "far-scene": (far_scene, _decades(0, 6)),
    "thin-gap": (thin_gap, (1e-1, 1e-2, 1e-3, 2e-4, 4e-5, 4e-6, 1e-6)),
    "many-samples": (many_samples, _decades(2, 8)),
    "small-variance": (small_variance, _decades(0, 6)),
}


def rung(name: str, k: int) -> Rung:
    """Place number `k` on the ladder of an extreme. Raises SettingsError where there is none."""
    if name not in LADDERS:
        raise SettingsError(f"there is no extreme {name!r}; choose from {', '.join(LADDERS)}")
    compute, ladder = LADDERS[name]
    if not 0 <= k < len(ladder):
        raise SettingsError(f"{name} has no place {k}; its places are 0 to {len(ladder) - 1}")
    return compute(ladder[k])
