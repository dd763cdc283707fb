"""Lights behind glass: which of them reach what the camera sees only in ways that its paths hardly find.

Told for `inspect`, before anything is rendered: some thousand paths leave each light, and those that come to lie near
what the camera sees, or what lies in view of that, are counted by how they came: straight, or through mirrors and clear
glass. Of the latter, light of radiance L that makes the irradiance E is met by a direction drawn at a surface with the
probability E / (π L): where that is small, the light is small.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from renderer.audit.gather import LUMINANCE
from renderer.audit.run import aim_of, extent_of, is_needed, probe_rays, specular_shapes, surface_name
from renderer.audit.value import CLASSES, RARE, class_of
from renderer.backend import mitsuba, using
from renderer.equation.light_paths import Arrivals, LightPaths, shape_id
from renderer.equation.reach import named

if TYPE_CHECKING:
    from renderer.scene.compile import Scene
    from renderer.settings import Settings

PATHS = 2**14
MOST_PASSED = 8  # panes that a look at the scene passes
NEAR = 0.1  # of what the camera sees: how near to it light has to come
SHARE = 0.25  # of a light's light, from which on it is named
SEED = 0xBE41


def lights_behind(scene: Scene, settings: Settings) -> tuple[str, ...]:
    """A sentence for each light of which much arrives through mirrors or clear glass and is hardly found so."""
    if settings.technique not in ("mis", "emitter") or not is_needed(scene, settings):
        return ()
    with using(scene.variant):
        depth = scene.model(settings).max_depth
        kernel = scene.kernel_of(scene.model(settings))
        paths = LightPaths(kernel.mitsuba_scene, kernel.rays, aim_of(scene, 1), 0, 64 if depth < 0 else depth - 2)
        if not paths.emitters:
            return ()
        arrivals = paths.arrivals(1, PATHS, SEED, kernel.shutter_open)
        points = _looked_at(kernel, [shape_id(shape) for shape in specular_shapes(scene)])
        if not len(arrivals.p) or len(points) < 2:
            return ()
        return _told(scene, paths, arrivals, points)


def _told(scene: Scene, paths: LightPaths, arrivals: Arrivals, points: NDArray[np.float64]) -> tuple[str, ...]:
    near = NEAR * extent_of(points)
    distance, _ = KDTree(points).query(arrivals.p, distance_upper_bound=near)
    seen = np.isfinite(distance)
    flux, radiance = (values.astype(np.float64) @ LUMINANCE for values in (arrivals.flux, arrivals.radiance))
    shapes = {shape_id(shape): shape for shape in scene.mitsuba_scene.shapes()}
    said = []
    for number, emitter in enumerate(paths.emitters):
        of_it = seen & (arrivals.light == number)
        through = np.flatnonzero(of_it & (arrivals.links > 0))
        total = float(flux[of_it].sum())
        if total <= 0 or not len(through):
            continue
        rare = through[_is_rare(flux[through], radiance[through], _area(arrivals.p[through], near))]
        if float(flux[rare].sum()) < SHARE * total:
            continue
        vias, of_via = np.unique(arrivals.via[rare], return_inverse=True)
        via = int(vias[np.argmax(np.bincount(of_via, flux[rare]))])
        (light,) = named([emitter])
        share = 100 * float(flux[through].sum()) / total
        said.append(
            f"light behind glass: {share:.0f} % of what the {light} sends to where it can be seen comes through "
            f"{surface_name(shapes.get(via))}, where it is too small for a camera's paths to find; expect fireflies or "
            "missing light, or make it larger"
        )
    return tuple(said)


def _is_rare(flux: NDArray[np.float64], radiance: NDArray[np.float64], area: float) -> NDArray[np.bool_]:
    """Which arrivals are of the light so bright that all as bright or brighter is met by fewer than RARE samples."""
    kind = class_of(radiance)
    met = np.bincount(kind, flux / (np.pi * area * radiance), minlength=CLASSES + 1)
    return (np.cumsum(met[::-1])[::-1] < RARE)[kind]


def _area(p: NDArray[np.float32], side: float) -> float:
    """Of the surfaces that these places lie on, about: that of the cells that they are in."""
    return float(len(np.unique(np.floor(p / side), axis=0))) * side * side


def _looked_at(kernel: Any, passed: list[int]) -> NDArray[np.float64]:
    """(n, 3) places that the camera sees, straight through mirrors and glass, and that are seen from there."""
    mi = mitsuba()
    rng = np.random.default_rng(SEED)
    found = []
    ray = probe_rays(kernel.camera, kernel.shutter_open)
    for _ in range(2):
        p, n = _first_that_scatters(kernel.mitsuba_scene, ray, passed)
        found.append(p)
        if not len(p):
            break
        d = rng.normal(size=p.shape)
        d = d / np.linalg.norm(d, axis=1, keepdims=True) + n  # by the cosine
        d /= np.maximum(np.linalg.norm(d, axis=1, keepdims=True), 1e-6)
        origin = p + 1e-4 * np.abs(p).max() * n
        ray = mi.Ray3f(mi.Point3f(origin.T.astype(np.float32)), mi.Vector3f(d.T.astype(np.float32)))
    return np.concatenate(found)


def _first_that_scatters(scene: Any, ray: Any, passed: list[int]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(n, 3) places and normals towards the ray."""
    import drjit as dr

    mi = mitsuba()
    ids = np.array(passed, np.uint32)
    places, normals = [], []
    for _ in range(MOST_PASSED):
        si = scene.ray_intersect(ray)
        shape = dr.select(si.instance != None, si.instance, si.shape)  # noqa: E711 (a Dr.Jit comparison)
        number = np.array(dr.reinterpret_array(mi.UInt32, shape))
        valid = np.array(si.is_valid()).ravel()
        ends = valid & ~np.isin(np.broadcast_to(number, valid.shape), ids)
        # All rays of an orthographic camera have one direction.
        p, n, d = (
            np.broadcast_to(np.array(x, np.float64).T.reshape(-1, 3), (len(valid), 3)) for x in (si.p, si.n, ray.d)
        )
        n = np.where((n * d).sum(axis=1, keepdims=True) > 0, -n, n)
        places.append(p[ends])
        normals.append(n[ends])
        on = np.flatnonzero(valid & ~ends)
        if not len(on):
            break
        away = p[on] + 1e-4 * np.abs(p).max() * d[on]
        ray = mi.Ray3f(mi.Point3f(away.T.astype(np.float32)), mi.Vector3f(d[on].T.astype(np.float32)))
    return np.concatenate(places), np.concatenate(normals)
