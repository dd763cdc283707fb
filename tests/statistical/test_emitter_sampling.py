"""Emitter sampling draws what its density says, and says the same density for a light that was hit by chance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from conftest import p_limit
from directions import Array, Cone, p_value

from renderer.backend import mitsuba
from renderer.equation.emitters import EmitterSampler

mi = mitsuba()
T = mi.ScalarTransform4f
DRAWS = 2**18
UP = (0.0, 0.0, 1.0)


def area(radiance: float = 1.0) -> dict[str, Any]:
    return {"type": "area", "radiance": radiance}


def place(shape: str, matrix: Any = None, **more: Any) -> dict[str, Any]:
    return {"type": shape, "to_world": matrix if matrix is not None else T(), "emitter": area()} | more


def ball(radius: float, z: float = 1.0, **more: Any) -> dict[str, Any]:
    return {"type": "sphere", "center": [0, 0, z], "radius": radius, "emitter": area()} | more


def bumpy_sky() -> dict[str, Any]:
    """An environment with a dark half, a gradient and one texel two hundred times as bright as the rest."""
    rng = np.random.default_rng(4)
    image = rng.uniform(0.2, 1, (16, 32, 3)).astype(np.float32)
    image[8:] *= 0.05
    image[4, 9] = 200
    return {"type": "envmap", "bitmap": mi.Bitmap(image), "to_world": T().rotate([1, 0, 0], 90)}


def checkered() -> dict[str, Any]:
    pattern = np.kron([[0.1, 1.0], [1.0, 0.3]], np.ones((2, 2)))[..., None].astype(np.float32)
    texture = {"type": "bitmap", "bitmap": mi.Bitmap(pattern), "raw": True, "filter_type": "nearest"}
    return {"type": "area", "radiance": texture}


@dataclass(frozen=True)
class Case:
    """Lights, the point they are seen from, the directions in which to look, and whether direction sampling helps."""

    lights: dict[str, Any]
    cone: Cone
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    is_helped: bool = False


DOWN_AT_ONE = T().translate([0, 0, 1]).rotate([1, 0, 0], 180)
CASES = {
    "rectangle": lambda: Case({"a": place("rectangle", DOWN_AT_ONE)}, Cone.around(UP, 1.0)),
    "rectangle aslant": lambda: Case(
        {"a": place("rectangle", DOWN_AT_ONE @ T().rotate([0.8, 0.6, 0], 40))}, Cone.around(UP, 1.3)
    ),
    "textured rectangle": lambda: Case(
        {"a": place("rectangle", DOWN_AT_ONE, emitter=checkered())}, Cone.around(UP, 1.0)
    ),
    "disk": lambda: Case({"a": place("disk", DOWN_AT_ONE)}, Cone.around(UP, 0.9)),
    "cylinder": lambda: Case(
        {"a": place("cylinder", p0=[-0.7, 0.2, 1.5], p1=[0.9, 0.3, 1.1], radius=0.3)}, Cone.around(UP, 1.0)
    ),
    "cube mesh": lambda: Case(
        {"a": place("cube", T().translate([0, 0.1, 2]).rotate([0.6, 0.8, 0], 35).scale(0.5))}, Cone.around(UP, 0.7)
    ),
    "near sphere": lambda: Case({"a": ball(0.8)}, Cone.around(UP, 1.0)),
    "sphere nearly touched": lambda: Case({"a": ball(0.99)}, Cone.around(UP, 1.5)),
    "sphere of a degree": lambda: Case({"a": ball(0.0175)}, Cone.around(UP, 0.02)),
    "sphere of a tenth of a milliradian": lambda: Case({"a": ball(1e-4)}, Cone.around(UP, 1.1e-4)),
    "inside a sphere": lambda: Case({"a": ball(1.0, 0.4, flip_normals=True)}, Cone.around(UP, np.pi)),
    "constant": lambda: Case({"a": {"type": "constant", "radiance": 2.0}}, Cone.around(UP, np.pi)),
    "environment map": lambda: Case({"a": bumpy_sky()}, Cone.around(UP, np.pi)),
    "environment map above its mean": lambda: Case({"a": bumpy_sky()}, Cone.around(UP, np.pi), is_helped=True),
    "sun": lambda: Case({"a": {"type": "sunsky", "sun_direction": [0.3, 0.2, 1]}}, Cone.around((0.3, 0.2, 1), 0.006)),
    "sky": lambda: Case(
        {"a": {"type": "sunsky", "sun_direction": [0.3, 0.2, 1], "sun_scale": 0}}, Cone.around(UP, 1.5)
    ),
    "three lights of unequal power": lambda: Case(
        {
            "a": place("rectangle", T().translate([1, 0, 1]).rotate([1, 0, 0], 180).scale(0.4)),
            "b": ball(0.2, 1.5, emitter=area(30.0)),
            "c": place("disk", T().translate([-1, 0.3, 1.2]).rotate([1, 0, 0], 180).scale(0.3), emitter=area(4.0)),
        },
        Cone.around(UP, 1.1),
    ),
    "lights under a sky": lambda: Case(
        {"a": place("rectangle", DOWN_AT_ONE), "b": ball(0.3, -1.5, emitter=area(3.0)), "c": bumpy_sky()},
        Cone.around(UP, np.pi),
    ),
}


class Seen:
    """The sampler of one case, as an estimator uses it: from one point, occlusion included."""

    def __init__(self, case: Case) -> None:
        self.scene = mi.load_dict({"type": "scene", **case.lights})
        self.sampler = EmitterSampler(self.scene, is_helped=case.is_helped)
        self.point = case.point

    def reference(self, n: int) -> Any:
        import drjit as dr

        found = dr.zeros(mi.Interaction3f, n)
        found.p = mi.Point3f(*self.point)
        return found

    def draw(self, n: int, seed: int) -> tuple[Array, Array]:
        """Directions of the draws that found something visible, with the density that each of them was given."""
        ref = self.reference(n)
        u = mi.Point2f(np.random.default_rng(seed).random((2, n), np.float32))
        ds, weight = self.sampler.sample(ref, u, mi.Bool(True))
        ray = mi.Ray3f(mi.Point3f(*self.point), ds.d)
        ray.maxt = ds.dist * (1 - mi.math.ShadowEpsilon)
        hidden = self.scene.ray_test(ray)
        found = np.array((ds.pdf > 0) & ~hidden) & (np.array(weight).max(axis=0) > 0)
        return np.array(ds.d, np.float64).T[found], np.broadcast_to(np.array(ds.pdf, np.float64), n)[found]

    def density(self, d: Array) -> Array:
        """Density with which `draw` finds each direction, as told for a light that a ray hit."""
        ray = mi.Ray3f(mi.Point3f(*self.point), mi.Vector3f(np.ascontiguousarray(d.T, np.float32)))
        si = self.scene.ray_intersect(ray)
        ds = mi.DirectionSample3f(self.scene, si, self.reference(len(d)))
        lit = (si.emitter(self.scene) != None) & (np.array(si.emitter(self.scene).eval(si)).max(axis=0) > 0)  # noqa: E711
        return np.array(self.sampler.pdf(self.reference(len(d)), ds, mi.Bool(lit)), np.float64)


@pytest.mark.parametrize("name", CASES)
def test_draws_follow_the_density(name: str, seed: int) -> None:
    case = CASES[name]()
    seen = Seen(case)
    directions, _ = seen.draw(DRAWS, seed)
    assert len(directions) > DRAWS / 20
    assert p_value(directions, DRAWS, case.cone, seen.density) > p_limit()


@pytest.mark.parametrize("name", CASES)
def test_a_draw_is_told_the_same_density_as_a_hit(name: str, seed: int) -> None:
    """Else the weights of the two techniques would not sum to one."""
    seen = Seen(CASES[name]())
    directions, told = seen.draw(2**14, seed)
    found = seen.density(directions)
    agree = np.abs(found - told) <= 2e-3 * told
    # At a silhouette a direction in float32 hits elsewhere, or nothing: the few that do are no disagreement.
    assert agree.mean() > 0.98
