"""Facts about rays that try all primitives: they meet what Mitsuba's tree meets."""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np
import pytest

from renderer.backend import mitsuba
from renderer.equation.primitives import listed
from renderer.equation.rays import EDGE, NOWHERE, ListRays, TreeRays

mi = mitsuba()
T = mi.ScalarTransform4f
RAYS = 2**15
TURN = T().rotate([0.3, 0.5, 0.8], 40)


def triangle(tmp_path: Any) -> dict[str, Any]:
    file = tmp_path / "bent.obj"
    file.write_text("v 0 0 0\nv 2 0 0\nv 0 2 1\nvt 0 0\nvt 1 0\nvt 0 1\nvn 0 0 1\nvn 0.6 0 0.8\nf 1/1/1 2/2/2 3/3/1\n")
    return {"type": "obj", "filename": str(file)}


SCENES: dict[str, Any] = {
    "a cube along the axes": {"a": {"type": "cube"}},
    "a cube aslant": {"a": {"type": "cube", "to_world": TURN}},
    "a cube whose normals point inwards": {"a": {"type": "cube", "to_world": TURN, "flip_normals": True}},
    "spheres": {"a": {"type": "sphere"}, "b": {"type": "sphere", "center": [0.5, 0, 1], "flip_normals": True}},
    "a tube": {"a": {"type": "cylinder", "p0": [-1, 0, 0.2], "p1": [1, 0.3, 0], "radius": 0.7}},
    "all kinds": {
        "a": {"type": "cube", "to_world": T().translate([0, 0, -1]) @ TURN},
        "b": {"type": "sphere", "center": [0.5, 0, 1], "radius": 0.4},
        "c": {"type": "cylinder", "p0": [-1, 1, 0.2], "p1": [1, 0.3, 0], "radius": 0.2},
        "d": {"type": "rectangle", "to_world": T().translate([0, 0, -2]).scale(3)},
    },
}


def rays(seed: int) -> Any:
    rng = np.random.default_rng(seed)
    o = rng.normal(size=(3, RAYS)) * 2
    towards = rng.uniform(-1.2, 1.2, (3, RAYS)) - o
    d = towards / np.linalg.norm(towards, axis=0)
    return mi.Ray3f(mi.Point3f(o.astype(np.float32)), mi.Vector3f(d.astype(np.float32)))


@pytest.mark.parametrize("needs_uv", [False, True])
@pytest.mark.parametrize("name", [*SCENES, "a triangle with normals of its own"])
def test_they_meet_what_the_tree_meets(name: str, needs_uv: bool, tmp_path: Any) -> None:
    contents = SCENES.get(name) or {"a": triangle(tmp_path)}
    scene = mi.load_dict({"type": "scene", **contents})
    mine, tree = ListRays(scene, listed(scene), needs_uv), TreeRays(scene)
    ray = rays(1)
    start = dr.full(mi.UInt32, NOWHERE, RAYS)
    everywhere = dr.full(mi.Bool, True, RAYS)
    ours, theirs = mine.meet(ray, start, everywhere), tree.meet(ray, start, everywhere)
    hit, expected = (np.array(met.si.is_valid()) for met in (ours, theirs))
    assert expected.mean() > 0.1
    with np.errstate(invalid="ignore"):
        same = hit & expected & (np.abs(np.array(ours.si.t) - np.array(theirs.si.t)) < 1e-4)
    assert same.sum() >= expected.sum() - 3, "but for rays along an edge"
    assert (hit != expected).sum() <= 3
    fields = ["p", "n", "wi"] if not needs_uv else ["p", "n", "wi", "uv", "dp_du"]
    for field in fields:
        a, b = (np.array(getattr(met.si, field))[:, same] for met in (ours, theirs))
        if field == "wi" and not needs_uv:  # tangents may be turned, the height may not
            a, b = a[2], b[2]
        assert np.abs(a - b).max() < 2e-3, field
    if needs_uv:
        assert (np.array(ours.si.prim_index) == np.array(theirs.si.prim_index))[same].mean() > 0.999


@pytest.mark.parametrize("height", [1e-3, 1e-5, 1e-7])
def test_a_ray_does_not_meet_the_plane_that_it_starts_on_however_low_it_leaves(height: float) -> None:
    scene = mi.load_dict({"type": "scene", "a": {"type": "cube", "to_world": TURN}})
    mine = ListRays(scene, listed(scene), False)
    ray = rays(2)
    first = mine.meet(ray, dr.full(mi.UInt32, NOWHERE, RAYS), mi.Bool(True))
    from_outside = first.si.is_valid() & (dr.dot(ray.d, first.si.n) < 0)
    low = first.si.to_world(dr.normalize(mi.Vector3f(1, 0, height)))
    again = mine.meet(mi.Ray3f(first.si.p, low), first.surface, from_outside)
    assert np.array(from_outside).mean() > 0.1
    assert not np.array(again.si.is_valid() & from_outside & (again.surface == first.surface)).any()
    if height > 100 * EDGE:  # below that it may meet the rim of another face, which is a hair larger than it is
        assert np.array(again.si.is_valid() & from_outside).mean() < 1e-3


@pytest.mark.parametrize("gap", [4e-5, 4e-6])
def test_shells_as_thin_as_float32_can_tell_are_both_met(gap: float) -> None:
    shells = {"in": {"type": "sphere", "radius": 1.0}, "out": {"type": "sphere", "radius": 1 + gap}}
    scene = mi.load_dict({"type": "scene", **shells})
    mine = ListRays(scene, listed(scene), False)
    ray = rays(3)
    start, everywhere = dr.full(mi.UInt32, NOWHERE, RAYS), dr.full(mi.Bool, True, RAYS)
    outer = mine.meet(ray, start, everywhere & (dr.norm(ray.o) > 1.1))
    met = outer.si.is_valid() & (dr.dot(ray.d, outer.si.n) < -0.05)
    inner = mine.meet(mi.Ray3f(outer.si.p, ray.d), outer.surface, met)
    found = np.array(met)
    assert found.sum() > RAYS / 20
    distance = np.array(inner.si.t)[found] * np.array(-dr.dot(ray.d, outer.si.n))[found]
    assert np.abs(distance / gap - 1).max() < max(0.1, 4e-7 / gap)


def test_a_light_is_seen_unless_something_stands_between() -> None:
    lamp = {
        "type": "rectangle",
        "to_world": T().translate([0, 0, 1]).rotate([1, 0, 0], 180),
        "emitter": {"type": "area"},
    }
    floor = {"type": "rectangle", "to_world": T().scale(3)}
    plate = {"type": "rectangle", "to_world": T().translate([1.5, 0, 0.5])}
    scene = mi.load_dict({"type": "scene", "lamp": lamp, "floor": floor, "plate": plate})
    mine = ListRays(scene, listed(scene), False)
    si = mine.meet(mi.Ray3f(mi.Point3f([0, 1.5], 0, 0.1), mi.Vector3f(0, 0, -1)), mi.UInt32(NOWHERE), mi.Bool(True))
    ds = dr.zeros(mi.DirectionSample3f, 2)
    ds.d, ds.dist, ds.emitter = mi.Vector3f(0, 0, 1), mi.Float(1), mi.EmitterPtr(scene.emitters()[0])
    blocked = mine.is_blocked(si.si, si.si.p, ds, None, si.surface, mi.Bool([True, True]))
    assert np.array(blocked).tolist() == [False, True]
