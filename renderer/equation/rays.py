"""Where a ray meets the scene, and what it meets there.

Two ways, of which a kernel contains one. `TreeRays` asks Mitsuba (Embree's tree on a processor, OptiX on a GPU).
`ListRays` tries every primitive: with a few dozen plates and balls that takes a fifth of the time, since all lanes do
the same at once and the scene's numbers are part of the code. It knows on which surface a ray starts and passes over
that alone, so no ray needs to start a hair above: surfaces may be as near to each other as float32 can tell.

Sources: Möller & Trumbore 1997 (plates, here with the plane's axes precomputed); Haines, Günther & Akenine-Möller 2019
(precision of spheres).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from renderer.backend import mitsuba
from renderer.equation.primitives import Ball, Plate, Primitives, Tube
from renderer.equation.tables import registry_id, table

mi: Any = mitsuba()

NOWHERE = 0xFFFFFFFF  # a ray that starts on no surface
EDGE = 1e-6  # by which a plate is larger than it is: no ray may slip between two that meet
SHADOW_EPSILON = 1e-5  # of the distance to a light that is known, within which nothing is in its way


@dataclass(frozen=True, slots=True)
class Met:
    """si: Mitsuba's surface interaction. bsdf, emitter: pointers, null where there is none. surface: its key."""

    si: Any
    bsdf: Any
    emitter: Any
    surface: Any


class TreeRays:
    """Mitsuba's own tree."""

    tracks_surfaces = False

    def __init__(self, scene: Any) -> None:
        self.scene = scene

    def meet(self, ray: Any, start: Any, active: Any, is_coherent: Any = False) -> Met:
        """The first surface along the ray. start: key of the surface that it starts on. is_coherent: whether the rays
        beside it are much like it, as the camera's are."""
        si = self.scene.ray_intersect(ray, mi.RayFlags.All, is_coherent, active)
        return Met(si, si.bsdf(), si.emitter(self.scene), start)

    def origin(self, si: Any, direction: Any) -> Any:
        """Where a ray from a surface starts: a hair above, so that it does not meet it again."""
        return si.spawn_ray(direction).o

    def leaving(self, si: Any, direction: Any, emitter: Any, active: Any) -> tuple[Any, Any]:
        """Where a ray from a point of a light starts, and the key of the surface that it starts on."""
        return self.origin(si, direction), mi.UInt32(NOWHERE)

    def is_blocked(self, si: Any, origin: Any, ds: Any, passes: Any, start: Any, active: Any) -> Any:
        """Whether anything lies between a surface and a point on a light. origin: as `origin` says on the side of the
        viewer. passes: whether light passes the surface: then the point may lie on the other side."""
        shadow_ray = si.spawn_ray_to(ds.p)
        if passes is not None:
            shadow_ray.o = dr.select(passes, shadow_ray.o, origin)
            shadow_ray.d = dr.select(passes, shadow_ray.d, ds.d)
            shadow_ray.maxt = dr.select(passes, shadow_ray.maxt, ds.dist * (1 - mi.math.ShadowEpsilon))
        else:
            shadow_ray.o, shadow_ray.d = origin, ds.d
            shadow_ray.maxt = ds.dist * (1 - mi.math.ShadowEpsilon)
        return self.scene.ray_test(shadow_ray, False, active)


class ListRays:
    """All primitives, one after the other.

    needs_uv: whether anything looks at texture coordinates or tangents: then Mitsuba works out the interaction.
    """

    tracks_surfaces = True

    def __init__(self, scene: Any, primitives: Primitives, needs_uv: bool) -> None:
        self.scene = scene
        self.primitives = primitives
        self.by_mitsuba = needs_uv or primitives.has_normals or bool(primitives.tubes)
        each = primitives.all
        shapes = list(scene.shapes())
        of = [shapes[one.shape] for one in each]
        environment = scene.environment()
        self._shapes = _pointers(mi.ShapePtr, of)
        self._bsdfs = _pointers(mi.BSDFPtr, [shape.bsdf() for shape in of])
        # Behind the last primitive: what a ray that meets nothing sees.
        self._emitters = _pointers(mi.EmitterPtr, [*(shape.emitter() for shape in of), environment])
        self._keys = table([*(one.key for one in each), NOWHERE], mi.UInt32)
        self._lit, self._lights = _light_keys(scene, primitives)
        if self.by_mitsuba:
            self._faces, self._barycentric = _face_tables(primitives)
        else:
            self._normals = table(_normal_table(self._shapes, primitives).ravel(), mi.Float)

    # ------------------------------ What is met ------------------------------

    def meet(self, ray: Any, start: Any, active: Any, is_coherent: Any = False) -> Met:
        """The first surface along the ray. start: key of the surface that it starts on."""
        t, number, u, v = self._nearest(ray, start)
        is_hit = active & (number < len(self.primitives.all))
        safe = dr.select(is_hit, number, 0)
        shape = dr.gather(mi.ShapePtr, self._shapes, safe, is_hit)
        if self.by_mitsuba:
            si = self._interaction_by_mitsuba(ray, t, number, u, v, shape, is_hit, active)
        else:
            si = self._interaction(ray, t, safe, shape, is_hit)
        bsdf = dr.gather(mi.BSDFPtr, self._bsdfs, safe, is_hit)
        emitter = dr.gather(mi.EmitterPtr, self._emitters, number, active)
        return Met(si, bsdf, emitter, dr.gather(mi.UInt32, self._keys, number, active))

    def _interaction(self, ray: Any, t: Any, number: Any, shape: Any, is_hit: Any) -> Any:
        si = dr.zeros(mi.SurfaceInteraction3f)
        p = ray.o + t * ray.d
        stored = dr.gather(mi.Vector4f, self._normals, number, is_hit)
        n = mi.Normal3f(stored.x, stored.y, stored.z)
        if self.primitives.balls:
            # Of a ball its centre and its radius, negative if it is seen from within; of a plate its normal and 0.
            is_ball = stored.w != 0
            outwards = dr.normalize(p - mi.Point3f(n))
            p = dr.select(is_ball, mi.Point3f(n) + dr.abs(stored.w) * outwards, p)
            n = dr.select(is_ball, mi.Normal3f(outwards * dr.sign(stored.w)), n)
        si.t = dr.select(is_hit, t, dr.inf)
        si.p, si.n, si.shape = p, n, shape
        si.sh_frame = mi.Frame3f(n)
        si.time, si.wavelengths = ray.time, ray.wavelengths
        si.wi = dr.select(is_hit, si.to_local(-ray.d), -ray.d)
        return si

    def _interaction_by_mitsuba(
        self, ray: Any, t: Any, number: Any, u: Any, v: Any, shape: Any, is_hit: Any, active: Any
    ) -> Any:
        pi = dr.zeros(mi.PreliminaryIntersection3f)
        pi.t = dr.select(is_hit, t, dr.inf)
        pi.valid, pi.shape = is_hit, shape
        if self.primitives.plates:
            is_plate = is_hit & (number < len(self.primitives.plates))
            at = 2 * number + dr.select(v > u, mi.UInt32(1), 0)
            pi.prim_index = dr.gather(mi.UInt32, self._faces, at, is_plate)
            b = [dr.gather(mi.Vector4f, self._barycentric, 2 * at + i, is_plate) for i in range(2)]
            pi.prim_uv = mi.Point2f(*(dr.fma(w.y, u, dr.fma(w.z, v, w.x)) for w in b))
        return pi.compute_surface_interaction(ray, mi.RayFlags.All, active)

    def origin(self, si: Any, direction: Any) -> Any:
        """Where a ray from a surface starts: on it, since it passes over that one."""
        return si.p

    def leaving(self, si: Any, direction: Any, emitter: Any, active: Any) -> tuple[Any, Any]:
        """Where a ray from a point of a light starts, and the key of the surface that it starts on: a hair above where
        the light is more than one surface."""
        light: Any = dr.reinterpret_array(mi.UInt32, emitter)
        surface = dr.gather(mi.UInt32, self._lights, light, active)
        return dr.select(surface == NOWHERE, si.spawn_ray(direction).o, si.p), surface

    def is_blocked(self, si: Any, origin: Any, ds: Any, passes: Any, start: Any, active: Any) -> Any:
        """Whether anything lies between a surface and a point on a light."""
        # A plate or a ball does not hide its own points: those that turn away send nothing.
        light: Any = dr.reinterpret_array(mi.UInt32, ds.emitter)
        target = dr.gather(mi.UInt32, self._lights, light, active)
        margin = dr.select(target == NOWHERE, mi.math.ShadowEpsilon, SHADOW_EPSILON)
        return active & self._any(origin, ds.d, ds.dist * (1 - margin), start, target)

    # ------------------------------ Trying all ------------------------------

    def _nearest(self, ray: Any, start: Any) -> tuple[Any, Any, Any, Any]:
        """Distance, number, u and v of the nearest primitive; the number is that of all primitives if there is none."""
        nearest, number = mi.Float(ray.maxt), mi.UInt32(len(self.primitives.all))
        best_u, best_v = mi.Float(0), mi.Float(0)
        o, d = ray.o, ray.d
        inverse = dr.rcp(d)
        for i, one in enumerate(self.primitives.all):
            t, hit, u, v = _try(one, o, d, inverse, start)
            hit &= t < nearest
            nearest = dr.select(hit, t, nearest)
            number = dr.select(hit, mi.UInt32(i), number)
            if self.by_mitsuba and u is not None:
                best_u, best_v = dr.select(hit, u, best_u), dr.select(hit, v, best_v)
        return nearest, number, best_u, best_v

    def _any(self, o: Any, d: Any, most: Any, start: Any, target: Any) -> Any:
        inverse = dr.rcp(d)
        found = mi.Bool(False)
        for one in self.primitives.all:
            t, hit, _, _ = _try(one, o, d, inverse, start)
            hit &= t < most
            if one.key in self._lit:
                hit &= target != one.key
            found |= hit
        return found


def _try(one: Plate | Ball | Tube, o: Any, d: Any, inverse: Any, start: Any) -> tuple[Any, Any, Any, Any]:
    """Distance to a primitive, whether it is met at all, and where on a plate."""
    if isinstance(one, Plate):
        return _try_plate(one, o, d, inverse, start)
    t, hit = _try_ball(one, o, d, start) if isinstance(one, Ball) else _try_tube(one, o, d, start)
    return t, hit, None, None


def _try_plate(plate: Plate, o: Any, d: Any, inverse: Any, start: Any) -> tuple[Any, Any, Any, Any]:
    along = np.flatnonzero(plate.normal)
    if len(along) == 1:
        k = int(along[0])
        t = (float(plate.offset * plate.normal[k]) - o[k]) * inverse[k]
    else:
        t = (plate.offset - _dot(plate.normal, o)) / _dot(plate.normal, d)
    p = [dr.fma(t, d[k], o[k]) if np.any(plate.axes[:, k] != 0) else None for k in range(3)]
    u, v = (_dot(plate.axes[i], p, float(plate.origin[i])) for i in range(2))
    if plate.is_triangle:
        inside = (u >= -EDGE) & (v >= -EDGE) & (u + v <= 1 + EDGE)
    else:
        inside = dr.maximum(dr.abs(u), dr.abs(v)) <= 1 + EDGE
    return t, inside & (t > 0) & (start != plate.key), u, v


def _dot(factors: Any, x: Any, constant: float = 0.0) -> Any:
    """Σ factors·x + constant, without the terms that are zero."""
    total: Any = None if constant == 0 else constant
    for factor, part in zip(factors, x, strict=True):
        if factor != 0:
            total = float(factor) * part if total is None else dr.fma(part, float(factor), total)
    return total if total is not None else mi.Float(0)


def _try_ball(ball: Ball, o: Any, d: Any, start: Any) -> tuple[Any, Any]:
    is_on = start == ball.key  # then one root is zero, and the other needs no rounding
    f = o - mi.Point3f(*map(float, ball.centre))
    b = dr.dot(f, d)
    beside = dr.fma(-b, d, f)
    under = ball.radius**2 - dr.squared_norm(beside)
    root = dr.select(is_on, dr.abs(b), dr.safe_sqrt(under))
    rest = dr.select(is_on, 0, dr.squared_norm(f) - ball.radius**2)
    q = root + dr.abs(b)
    other = rest / q
    near, far = dr.select(b < 0, other, -q), dr.select(b < 0, q, -other)
    t = dr.select(near > 0, near, far)
    return t, (is_on | (under >= 0)) & (t > 0)


def _try_tube(tube: Tube, o: Any, d: Any, start: Any) -> tuple[Any, Any]:
    is_on = start == tube.key
    axis = mi.Vector3f(*map(float, tube.axis))
    from_start = o - mi.Point3f(*map(float, tube.start))
    height, rise = dr.dot(from_start, axis), dr.dot(d, axis)
    f, across = from_start - height * axis, d - rise * axis
    a, b = dr.squared_norm(across), dr.dot(f, across)
    rest = dr.select(is_on, 0, dr.squared_norm(f) - tube.radius**2)
    under = dr.square(b) - a * rest
    q = dr.select(is_on, dr.abs(b), dr.safe_sqrt(under)) + dr.abs(b)
    one, other = q / a, rest / q
    near, far = dr.select(b < 0, other, -one), dr.select(b < 0, one, -other)

    def is_there(t: Any) -> Any:
        at = dr.fma(t, rise, height)
        return (t > 0) & (at >= 0) & (at <= tube.length)

    takes_near = is_there(near)
    t = dr.select(takes_near, near, far)
    return t, (is_on | (under >= 0)) & (takes_near | is_there(far))


# ------------------------------ Tables ------------------------------


def _pointers(of_type: Any, objects: list[Any]) -> Any:
    bare: list[Any] = [dr.reinterpret_array(mi.UInt32, of_type(one)) for one in objects]
    ids = [0 if one is None else int(pointer[0]) for one, pointer in zip(objects, bare, strict=True)]
    return dr.reinterpret_array(of_type, table(ids, mi.UInt32))


def _light_keys(scene: Any, primitives: Primitives) -> tuple[set[int], Any]:
    """Keys of lights that are one surface, and the key for each emitter's registry id; NOWHERE for all others."""
    shapes = list(scene.shapes())
    keys: dict[int, set[int]] = {}
    for one in (*primitives.plates, *primitives.balls):  # an open tube may hide its own far wall
        keys.setdefault(one.shape, set()).add(one.key)
    ids = [registry_id(emitter) for emitter in scene.emitters()]
    by_id = np.full(max(ids, default=0) + 1, NOWHERE, np.uint32)
    for number, of in keys.items():
        emitter = shapes[number].emitter()
        if emitter is not None and len(of) == 1:
            by_id[registry_id(emitter)] = next(iter(of))
    return set(by_id[by_id != NOWHERE].tolist()), table(by_id, mi.UInt32)


def _normal_table(shapes: Any, primitives: Primitives) -> Any:
    """(n, 4): of a plate its normal, as Mitsuba turns it, and 0; of a ball its centre and radius, negative if its
    normals point inwards. shapes: pointers, by number of the primitive."""
    each = primitives.all
    n = len(each)
    pi = dr.zeros(mi.PreliminaryIntersection3f, n)
    pi.shape, pi.t, pi.valid = shapes, dr.full(mi.Float, 1, n), dr.full(mi.Bool, True, n)
    faces = [one.faces[0] if isinstance(one, Plate) else 0 for one in each]
    pi.prim_index, pi.prim_uv = table(faces, mi.UInt32), mi.Point2f(1 / 3, 1 / 3)
    # From the centre of a ball upwards, so that its normal tells which way it points.
    centres = np.array([one.centre if isinstance(one, Ball) else np.zeros(3) for one in each])
    radii = np.array([one.radius if isinstance(one, Ball) else 1.0 for one in each])
    ray = mi.Ray3f(mi.Point3f(*(table(x, mi.Float) for x in centres.T)), mi.Vector3f(0, 0, 1) * table(radii, mi.Float))
    si = pi.compute_surface_interaction(ray, mi.RayFlags.All, dr.full(mi.Bool, True, n))
    found = np.array(si.sh_frame.n, np.float64).reshape(3, n).T
    rows = np.zeros((n, 4))
    for row, one, normal in zip(rows, each, found, strict=True):
        if isinstance(one, Plate):
            row[:3] = one.normal * np.sign(normal @ one.normal)
        elif isinstance(one, Ball):
            row[:3], row[3] = one.centre, one.radius if normal[2] > 0 else -one.radius
    return rows


def _face_tables(primitives: Primitives) -> tuple[Any, Any]:
    """Two entries for each plate: the number of the face, and how its prim_uv follows from u and v."""
    faces = np.zeros((max(1, len(primitives.plates)), 2), np.uint32)
    factors = np.zeros((len(faces), 2, 2, 4))
    for i, plate in enumerate(primitives.plates):
        for half in range(2):
            face = min(half, len(plate.faces) - 1)
            faces[i, half], factors[i, half, :, :3] = plate.faces[face], plate.barycentric[face]
    return table(faces.ravel(), mi.UInt32), table(factors.ravel(), mi.Float)
