"""Facts about re-centring and rescaling: every plugin's lengths follow, and no picture changes.

The oracle is Mitsuba itself: it renders the scene as it was written and as it was rewritten, with the same seed.
"""

# ruff: noqa: E501 (the table of cases is read by its columns)
from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from renderer.backend import mitsuba
from renderer.progress import render
from renderer.scene.compile import load_scene
from renderer.scene.geometry import bounds, placed_shapes
from renderer.scene.rewrite import passes
from renderer.scene.rewrite.emission import Unscalable
from renderer.scene.rewrite.similarity import Similarity, apply, choose
from renderer.scene.source import parse
from renderer.settings import Settings, Target
from tests.files import write_png

SHARED = Path(__file__).resolve().parents[4] / "shared" / "scenes"
LARGER, SMALLER = Similarity(2.0**7, (1.0, -2.0, 0.5)), Similarity(2.0**-3)


def t() -> Any:
    return mitsuba().ScalarTransform4d()


def at(*xyz: float) -> Any:
    return mitsuba().ScalarPoint3d(*xyz)


def film(side: int = 16) -> dict[str, Any]:
    return {"type": "hdrfilm", "width": side, "height": side, "filter": {"type": "box"}}


def camera(kind: str = "perspective", **more: Any) -> dict[str, Any]:
    seen = {} if kind == "orthographic" else {"fov": 50.0}
    from_here = t().look_at([0, 2, 5], [0, 0, 0], [0, 1, 0])
    return {"type": kind, "to_world": from_here, "film": film(), **seen, **more}


def world(folder: Path, **more: Any) -> dict[str, Any]:
    made = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 4},
        "cam": camera(),
        "sky": {"type": "constant", "radiance": 0.2},
        "floor": {"type": "rectangle", "to_world": t().translate([0, -1, 0]).rotate([1, 0, 0], -90).scale([4, 4, 1])},
        "ball": {"type": "sphere", "center": at(0.5, 0, 0), "radius": 0.7},
        **more,
    }
    return {key: value for key, value in made.items() if value is not None}


def lamp(kind: str, **more: Any) -> dict[str, Any]:
    return {"lamp": {"type": kind, "to_world": t().look_at([1, 3, 1], [0, 0, 0], [0, 1, 0]), **more}}


def shape(kind: str, **more: Any) -> dict[str, Any]:
    return {"shape": {"type": kind, **more}}


def bumps(folder: Path) -> dict[str, Any]:
    heights = np.kron(np.random.default_rng(1).integers(0, 255, (8, 8)), np.ones((16, 16)))
    write_png(str(folder / "b.png"), np.repeat(heights[..., None], 3, axis=2).astype(np.uint8))
    texture = {"type": "bitmap", "raw": True, "filename": str(folder / "b.png")}
    bsdf = {"type": "bumpmap", "heights": texture, "scale": 0.2, "inner": {"type": "diffuse"}}
    return {"ball": {"type": "rectangle", "bsdf": bsdf}}


def group() -> dict[str, Any]:
    inner = {"a": {"type": "sphere", "radius": 0.3, "center": at(0.1, 0, 0)}}
    inner["b"] = {"type": "cube", "to_world": t().translate([0, 0.5, 0]).scale(0.2)}
    place = t().translate([-1, 0, 0.3]).scale(1.3)
    instance = {"type": "instance", "to_world": place, "what": {"type": "ref", "id": "group"}}
    return {"group": {"type": "shapegroup", **inner}, "instance": instance}


def mesh(folder: Path) -> dict[str, Any]:
    (folder / "m.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n")
    return shape("obj", filename=str(folder / "m.obj"), to_world=t().translate([-1, -0.5, 0.5]))


def fog(folder: Path) -> dict[str, Any]:
    inside = {"type": "homogeneous", "sigma_t": 1.5, "albedo": 0.8}
    ball = {"type": "sphere", "bsdf": {"type": "null"}, "interior": inside}
    return {"integrator": {"type": "volpath", "max_depth": 6}, "ball": ball}


def smoke(folder: Path) -> dict[str, Any]:
    mi = mitsuba()
    grid = np.random.default_rng(2).random((4, 4, 4, 1), dtype=np.float32)
    mi.VolumeGrid(grid).write(str(folder / "s.vol"))
    volume = {"type": "gridvolume", "filename": str(folder / "s.vol"), "to_world": t().translate([-0.6] * 3).scale(1.2)}
    inside = {"type": "heterogeneous", "scale": 3.0, "albedo": 0.8, "sigma_t": volume}
    ball = {"type": "cube", "to_world": t().scale(0.6), "bsdf": {"type": "null"}, "interior": inside}
    return {"integrator": {"type": "volpath", "max_depth": 6}, "ball": ball}


def field(folder: Path) -> dict[str, Any]:
    mi = mitsuba()
    z, y, x = np.meshgrid(*[np.linspace(0, 1, 12)] * 3, indexing="ij")
    away = np.sqrt((x - 0.5) ** 2 + (y - 0.5) ** 2 + (z - 0.5) ** 2) - 0.35
    mi.VolumeGrid(away[..., None].astype(np.float32)).write(str(folder / "f.vol"))
    return shape("sdfgrid", filename=str(folder / "f.vol"), to_world=t().translate([-1.5, -0.5, 0]).scale(1.5))


DOT = {"film": film(1)}
CASES: dict[str, Any] = {
    "plain": lambda _: {},
    "point light": lambda _: {"lamp": {"type": "point", "position": at(1, 2, 1), "intensity": {"type": "rgb", "value": at(3, 2, 1)}}},
    "point light without intensity": lambda _: {"lamp": {"type": "point", "position": at(1, 2, 1)}},
    "point light of daylight": lambda _: lamp("point", intensity={"type": "d65", "scale": 3.0}),
    "point light of a spectrum": lambda _: lamp("point", intensity={"type": "spectrum", "value": [(400, 1), (700, 4)]}),
    "spot": lambda _: lamp("spot", intensity=20.0),
    "projector": lambda _: lamp("projector", fov=40.0, irradiance={"type": "checkerboard"}),
    "projector with a scale": lambda _: lamp("projector", fov=40.0, scale=3.0),
    "directional": lambda _: {"lamp": {"type": "directional", "direction": at(-0.3, -1, 0.1), "irradiance": 2.0}},
    "area light": lambda _: shape("disk", to_world=t().translate([0, 2, 0]).rotate([1, 0, 0], 90).scale(0.5), light={"type": "area", "radiance": 5.0}),
    "sky with a sun": lambda _: {"sky": {"type": "sunsky", "to_world": t().rotate([1, 0, 0], -90)}},
    "cylinder": lambda _: shape("cylinder", p0=at(-1, 0, 0), p1=at(-1, 1, 0.5), radius=0.3),
    "placed cylinder": lambda _: shape("cylinder", radius=0.3, to_world=t().translate([-1, 0, 0]).rotate([1, 0, 0], -90)),
    "cube": lambda _: shape("cube", to_world=t().translate([-1, 0, 0]).scale([0.3, 0.6, 0.2])),
    "placed sphere": lambda _: shape("sphere", to_world=t().translate([-1, 0, 0]).scale(0.4)),
    "instance of a group": lambda _: group(),
    "mesh": mesh,
    "signed distances": field,
    "bump map": bumps,
    "thin lens": lambda _: {"cam": camera("thinlens", aperture_radius=0.2, focus_distance=4.0)},
    "thin lens without a focus": lambda _: {"cam": camera("thinlens", aperture_radius=0.02)},
    "orthographic": lambda _: {"cam": camera("orthographic", to_world=t().look_at([0, 2, 5], [0, 0, 0], [0, 1, 0]).scale([2, 2, 1]))},
    "orthographic with clips": lambda _: {"cam": camera("orthographic", near_clip=4.5, far_clip=5.5, to_world=t().look_at([0, 2, 5], [0, 0, 0], [0, 1, 0]).scale([2, 2, 1.5]))},
    "clips": lambda _: {"cam": camera(near_clip=5.0, far_clip=5.6)},
    "distant sensor on a point": lambda _: {"cam": {"type": "distant", "direction": at(0, -1, -0.2), "target": at(0.5, 0, 0), **DOT}},
    "distant sensor": lambda _: {"cam": {"type": "distant", "direction": at(0, -1, -0.2), **DOT}},
    "distant sensor on a shape": lambda _: {"cam": {"type": "distant", "direction": at(0, -1, -0.2), "target": {"type": "disk", "to_world": t().rotate([1, 0, 0], -90).scale(0.8)}, **DOT}},
    "radiance meter": lambda _: {"cam": {"type": "radiancemeter", "origin": at(0.3, 2, 3), "direction": at(0, -0.6, -1), **DOT}},
    "fog": fog,
    "smoke": smoke,
}  # fmt: skip


def rendered(source: dict[str, Any], similarity: Similarity) -> np.ndarray:
    """Mitsuba's own picture of a rewritten scene."""
    mi = mitsuba()
    config = mi.parser.ParserConfig(mi.variant())
    state = mi.parser.parse_dict(config, source)
    mi.parser.transform_upgrade(config, state)
    mi.parser.transform_resolve(config, state)
    state = apply(state, similarity)
    mi.parser.transform_all(config, state)
    return np.array(mi.render(mi.parser.instantiate(config, state), spp=16, seed=1), dtype=np.float64)


@pytest.mark.parametrize("name", CASES)
def test_a_rewritten_scene_looks_as_it_did(name: str, tmp_path: Path) -> None:
    source = world(tmp_path, **CASES[name](tmp_path))
    before = rendered(source, Similarity())
    assert before.mean() > 0
    for similarity in (LARGER, SMALLER) if "clips" in name else (LARGER,):
        after = rendered(source, similarity)
        # The same samples: what differs is rounding, and now and then a path that it sends elsewhere.
        assert after.mean() == pytest.approx(before.mean(), rel=1e-3 if name in ("fog", "smoke") else 1e-4)
        assert np.sqrt(((after - before) ** 2).mean()) < 2e-3 * before.mean()


def test_positions_and_distances_come_back() -> None:
    p = np.random.default_rng(3).normal(size=(7, 3)) * 10
    assert np.allclose(LARGER.original_position(LARGER.moved(p)), p, rtol=1e-14)
    assert np.allclose(LARGER.original_distance(128.0 * p), p, rtol=1e-14)


def test_the_identity_changes_nothing() -> None:
    assert Similarity().is_identity
    assert np.array_equal(Similarity().moved([1.5, -2, 3]), [1.5, -2, 3])


def box(low: float, high: float, offset: float = 0.0) -> Any:
    return np.full(3, low + offset), np.full(3, high + offset)


@pytest.mark.parametrize("k", range(-30, 12))
def test_a_scene_becomes_the_same_at_every_power_of_two(k: int) -> None:
    low, high = box(-1.0, 1.0)
    chosen = choose((low * 2.0**k, high * 2.0**k))
    assert chosen.scale * 2.0**k == choose((low, high)).scale
    assert chosen.centre == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("radius", [1e-6, 0.3, 1.0, 77.0, 4000.0])
def test_small_scenes_are_rescaled_to_one_size_by_a_power_of_two(radius: float) -> None:
    scale = choose(box(-radius, radius)).scale
    assert 4096 <= scale * radius * np.sqrt(3) < 8192
    assert np.log2(scale) == round(np.log2(scale))


def test_large_scenes_are_left_as_they_are_and_vast_ones_shrunk() -> None:
    assert choose(box(-1e5, 1e5)).is_identity
    assert choose(box(-1e12, 1e12)).scale < 1
    for odd in (None, box(0, 0), box(-np.inf, 1)):
        assert choose(odd).is_identity


def test_a_scene_far_away_is_moved_to_the_origin_by_a_short_number() -> None:
    chosen = choose(box(-1.0, 1.0, offset=1e5 + 1 / 3))
    assert np.allclose(chosen.centre, 1e5 + 1 / 3, atol=0.1)
    assert all(float(np.float32(c)) == c for c in chosen.centre)
    assert choose(box(-1.0, 1.0, offset=0.5)).centre == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("far", [1e3, 1e5])
def test_what_lies_near_the_origin_keeps_its_digits_beside_something_far(far: float) -> None:
    low, high = box(-1.0, 1.0)
    assert choose((low, np.maximum(high, far))).centre == (0.0, 0.0, 0.0)


def test_bounds_are_those_of_mitsuba(tmp_path: Path) -> None:
    for more in (group(), mesh(tmp_path), shape("cylinder", p0=at(-1, 0, 0), p1=at(-1, 2, 0), radius=0.3)):
        parsed = parse(world(tmp_path, **more))
        found = bounds(placed_shapes(parsed.state, parsed.assets))
        theirs = load_scene(world(tmp_path, **more), rewrites=()).mitsuba_scene.bbox()
        assert found is not None
        assert (found[0] <= np.array(theirs.min).ravel() + 1e-5).all()
        assert (found[1] >= np.array(theirs.max).ravel() - 1e-5).all()
        assert np.linalg.norm(found[1] - found[0]) < 1.5 * np.linalg.norm(np.array(theirs.max - theirs.min))


def test_what_cannot_be_rescaled_is_left_and_told(tmp_path: Path) -> None:
    (tmp_path / "c.txt").write_text("\n".join(f"{i} {i % 2} 0 0.1" for i in range(5)))
    source = world(tmp_path, **shape("bsplinecurve", filename=str(tmp_path / "c.txt")))
    with pytest.raises(Unscalable, match="radii"):
        apply(parse(source).state, LARGER)
    loaded = load_scene(source)
    assert loaded.similarity.is_identity
    assert loaded.requirements.notes == ("not rescaled: bsplinecurve has radii that do not grow with its transform",)


@pytest.mark.parametrize("size", [1e-3, 1e-4, 1e-5])
def test_a_small_scene_with_a_point_light_keeps_its_light(size: float) -> None:
    def mean(k: float) -> float:
        there = mitsuba().ScalarTransform4f
        film = {"type": "hdrfilm", "width": 16, "height": 16, "rfilter": {"type": "box"}}
        look = there().look_at([0, 0, 3 * k], [0, 0, 0], [0, 1, 0])
        scene = {
            "type": "scene",
            "sensor": {"type": "perspective", "near_clip": 0.01 * k, "fov": 40, "to_world": look, "film": film},
            "floor": {"type": "rectangle", "to_world": there().scale(2 * k)},
            "ball": {"type": "sphere", "radius": 0.3 * k, "center": [0, 0, 0.5 * k]},
            "lamp": {"type": "point", "position": [0, k, 2 * k], "intensity": {"type": "rgb", "value": k * k}},
        }
        loaded = load_scene(scene)
        notes = " ".join(loaded.requirements.notes)
        assert ("a point light" in notes) == (loaded.similarity.scale == 2.0**20)
        return float(render(loaded, Target(spp=64), Settings(max_depth=3)).mean.mean())

    assert mean(size) == pytest.approx(mean(1.0), rel=0.01)


def test_the_rewrite_can_be_switched_off_and_is_then_another_scene(tmp_path: Path) -> None:
    on = load_scene(world(tmp_path))
    off = load_scene(world(tmp_path), rewrites=[name for name in passes.ALL if name != passes.SIMILARITY])
    assert not on.similarity.is_identity
    assert off.similarity.is_identity
    assert on.digest == parse(world(tmp_path)).digest != off.digest
