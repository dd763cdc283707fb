"""Facts about a guide: its densities are those it draws with, it is a value, and odd radiance teaches it nothing."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import drjit as dr
import numpy as np
import pytest
from scipy.stats import chi2

import renderer
from renderer import Estimate, Settings, Target
from renderer.backend import mitsuba, using
from renderer.equation import guide_fit, guide_training
from renderer.equation.guide import CELLS, NORMAL_SCALE, Guide, GuideTables
from renderer.equation.guide_fit import Records, cells_of, fit, leaves, plant
from renderer.equation.lights.place_tree import cumulative
from renderer.equation.tables import table
from renderer.equation.techniques import Directions, GuidedDirections
from renderer.errors import CheckpointError, MergeError, SettingsError
from renderer.replay import differences, replay, settings_of

mi: Any = mitsuba()
DEPTH = 3
FALSE_ALARM = 1e-6  # of each chi-square test; seeds are fixed


@pytest.fixture(autouse=True)
def few_paths(monkeypatch: pytest.MonkeyPatch) -> None:
    """A guide that is learned in no time."""
    monkeypatch.setattr(guide_training, "PATHS", 2**8)


def a_guide(share: float = 0.5, seed: int = 1) -> Guide:
    rng = np.random.default_rng(seed)
    p, n = rng.normal(size=(4000, 3)), unit(rng.normal(size=(4000, 3)))
    nodes = plant(guide_fit.features_of(p, n, np.zeros(3), 2.0), DEPTH)
    rows = rng.random((2**DEPTH, CELLS)) ** 4 + 0.01
    sums = cumulative(rows / rows.sum(axis=1, keepdims=True))
    return Guide((0.0, 0.0, 0.0), 2.0, DEPTH, nodes, sums, np.full(2**DEPTH, share, np.float32))


def unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def vectors(v: np.ndarray, of_type: Any = None) -> Any:
    return (of_type or mi.Vector3f)(*(table(x, mi.Float) for x in v.T))


def records(m: int, **changes: Any) -> Records:
    """Of a floor under one bright cell of the sky, on average."""
    rng = np.random.default_rng(3)
    d = unit(rng.normal(size=(m, 3)))
    d[:, 2] = np.abs(d[:, 2])
    pdf = np.full(m, 1 / (2 * np.pi))
    up = np.broadcast_to([0.0, 0.0, 1.0], (m, 3))
    bright = np.where(cells_of(d) == 100, 1.0, 0.01)
    no = np.zeros(m, bool)
    flat = np.concatenate([rng.random((m, 2)), np.zeros((m, 1))], axis=1)
    made = Records(flat, up, d, pdf, d[:, 2] / np.pi, 2 * d[:, 2], np.zeros(m), bright, bright, no, ~no)
    return replace(made, **changes)


def test_kernel_and_numpy_find_the_same_place() -> None:
    guide, rng = a_guide(), np.random.default_rng(2)
    p, n = rng.normal(size=(5000, 3)).astype(np.float32), unit(rng.normal(size=(5000, 3))).astype(np.float32)
    with using("llvm_ad_rgb"):
        found = np.array(GuideTables(guide).place(vectors(p, mi.Point3f), vectors(n, mi.Normal3f), mi.Bool(True)))
    features = np.concatenate([p / np.float32(2), n * np.float32(NORMAL_SCALE)], axis=1)
    np.testing.assert_array_equal(found, leaves(guide.nodes, features))
    assert len(np.unique(found)) == 2**DEPTH


def test_places_hold_equally_many_points() -> None:
    rng = np.random.default_rng(4)
    features = rng.normal(size=(2**13, 6)).astype(np.float32)
    counts = np.bincount(leaves(plant(features, 8), features), minlength=256)
    assert counts.min() >= 31
    assert counts.max() <= 33


def test_directions_are_drawn_with_the_density_that_is_said() -> None:
    guide, n = a_guide(), 2**18
    rng = np.random.default_rng(5)
    with using("llvm_ad_rgb"):
        tables = GuideTables(guide)
        u = mi.Point2f(*(table(x, mi.Float) for x in rng.random((2, n))))
        place = mi.UInt32(5)
        d = tables.sample(place, table(rng.random(n), mi.Float), u, mi.Bool(True))
        density = np.array(tables.pdf(place, d, mi.Bool(True)))
        even = vectors(unit(rng.normal(size=(n, 3))))
        integral = np.array(tables.pdf(place, even, mi.Bool(True)), np.float64).mean() * 4 * np.pi
    directions = np.array(d).reshape(3, n).T
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, atol=1e-6)
    expected = np.diff(guide.sums[5].astype(np.float64)) * n
    counts = np.bincount(cells_of(directions.astype(np.float64)), minlength=CELLS)
    assert np.sum((counts - expected) ** 2 / expected) < chi2.isf(FALSE_ALARM, CELLS - 1)
    cell = cells_of(directions.astype(np.float64))
    agrees = np.isclose(density, np.diff(guide.sums[5])[cell] * CELLS / (4 * np.pi), rtol=1e-4)
    assert agrees.mean() > 0.9999  # else a rounding at the border of two cells
    assert integral == pytest.approx(1, abs=0.02)


@pytest.mark.parametrize("share", [0.3, 1.0])
@pytest.mark.parametrize("kind", ["diffuse", "roughplastic"])
def test_the_mixture_is_drawn_with_the_density_that_is_said(kind: str, share: float) -> None:
    """Counts in cells of the sphere against the integral of the density, and weights against f·cosθ."""
    n, rng = 2**19, np.random.default_rng(6)
    with using("llvm_ad_rgb"):
        bsdf = mi.load_dict({"type": kind} | ({"alpha": 0.4} if kind == "roughplastic" else {}))
        directions = GuidedDirections(Directions("mis"), GuideTables(a_guide(share)))
        si = dr.zeros(mi.SurfaceInteraction3f)
        si.p, si.n, si.sh_frame = mi.Point3f(0.3, 0.2, 0.1), mi.Normal3f(0, 0, 1), mi.Frame3f(mi.Normal3f(0, 0, 1))
        si.wi = mi.Vector3f(0.6, 0, 0.8)
        pointer = mi.BSDFPtr(bsdf)
        u = mi.Point2f(*(table(x, mi.Float) for x in rng.random((2, n))))
        ctx, yes = mi.BSDFContext(), mi.Bool(True)
        bs, weight = directions.sample(pointer, ctx, si, table(rng.random(n), mi.Float), u, yes)
        value, pdf = directions.eval_pdf(pointer, ctx, si, bs.wo, yes)
        even = unit(rng.normal(size=(2**20, 3)))
        density = np.array(directions.eval_pdf(pointer, ctx, si, vectors(even), yes)[1], np.float64)
        drawn = np.array(bs.wo, np.float64).reshape(3, -1).T
        said, again = np.array(bs.pdf, np.float64), np.array(pdf, np.float64)
        f, w = np.array(value, np.float64)[0], np.array(weight, np.float64)[0]
    # A direction that the BSDF draws below the surface has no weight, and one at a cell's border two densities.
    lit = w > 0
    assert np.isclose(said[lit], again[lit], rtol=2e-3).mean() > 0.999
    assert np.isclose(w[lit] * said[lit], f[lit], rtol=5e-3, atol=1e-6).mean() > 0.999
    counts = np.bincount(cells_of(drawn)[lit & (drawn[:, 2] > 0)], minlength=CELLS)
    above = even[:, 2] > 0
    cells = cells_of(even[above])
    expected = np.bincount(cells, density[above], CELLS) * 4 * np.pi / len(even) * n
    enough = expected > 200
    # The integral is by samples, too: its error is counted in.
    squares = np.bincount(cells, density[above] ** 2, CELLS) * (4 * np.pi / len(even) * n) ** 2
    z2 = (counts - expected)[enough] ** 2 / (expected + squares)[enough]
    assert z2.sum() < chi2.isf(FALSE_ALARM, int(enough.sum()))


def test_a_guide_learns_where_light_comes_from() -> None:
    guide = fit(records(2**14), np.array([0.5, 0.5, 0.0]), 1.0, 2**13)
    rows = np.diff(guide.sums)
    assert rows[:, 100].mean() > 0.4  # of a cell that receives 60 % of the light
    assert rows[:, 100].min() > 2 / CELLS
    assert guide.shares.mean() < 0.6  # of directions that stay with the BSDF: the guide draws them better


def test_a_guide_is_left_alone_where_the_bsdf_does_well() -> None:
    even = records(2**14)
    ideal = replace(even, brought=np.ones(2**14), pdf=even.blind, weight=np.ones(2**14))
    assert (fit(ideal, np.array([0.5, 0.5, 0.0]), 1.0, 2**13).shares > 0.7).all()


def test_no_light_teaches_nothing() -> None:
    for m in (1, 40, 2**12):
        guide = fit(records(m, brought=np.zeros(m), sent=np.zeros(m)), np.zeros(3), 1.0, m // 2)
        assert np.isfinite(guide.sums).all()
        np.testing.assert_allclose(np.diff(guide.sums), 1 / CELLS, atol=1e-6)


def test_a_guide_is_a_value() -> None:
    a, b = a_guide(), a_guide()
    assert a.digest == b.digest
    assert a.digest != a_guide(seed=2).digest
    assert a.digest != replace(a, shares=a.shares * np.float32(1.1)).digest


SETTINGS = Settings(24, 16, seed=7, replicate_size=4, guide="on", adaptive=False)


def of(estimate: Estimate) -> Any:
    return estimate.identity.settings.get("guide_digest")


def test_resume_replay_and_merge_have_the_bits_of_a_straight_render(tmp_path: Any) -> None:
    """The guide is learned anew by each scene that is loaded, and is the same, whatever the seed."""
    first, second = (renderer.load_scene("cornell-box", settings=SETTINGS) for _ in range(2))
    straight = renderer.render(first, Target(spp=16), SETTINGS)
    renderer.render(second, Target(spp=8), SETTINGS).write(tmp_path / "half.exr")
    half = Estimate.read(tmp_path / "half.exr")
    assert of(half) == of(straight) is not None
    resumed = renderer.render(second, Target(spp=16), SETTINGS, start=half)
    assert resumed.moments.mean.tobytes() == straight.moments.mean.tobytes()
    assert resumed.moments.m2.tobytes() == straight.moments.m2.tobytes()

    again = settings_of(straight)
    assert again.guide == "on"
    assert differences(straight, (9, 11), replay(second, again, (9, 11), range(4))) == []

    other = renderer.render(second, Target(spp=8), replace(SETTINGS, seed=8))
    assert of(other) == of(straight)
    assert renderer.merge(straight, other).spp == 24
    without = renderer.render(second, Target(spp=8), replace(SETTINGS, seed=9, guide="off"))
    assert "guide" not in without.identity.settings  # as before there were guides
    with pytest.raises(MergeError, match="guide is on and off"):
        renderer.merge(straight, without)
    with pytest.raises(CheckpointError, match="guide"):
        renderer.render(second, Target(spp=16), replace(SETTINGS, guide="off"), start=half)


@pytest.mark.parametrize(
    ("scene", "changes"),
    [("cornell-box", {"technique": "bsdf"}), ("cornell-box", {"max_depth": 1}), ("smoke", {})],
)
def test_where_a_guide_cannot_serve_there_is_none(scene: str, changes: dict[str, Any]) -> None:
    loaded = renderer.load_scene(scene, settings=SETTINGS)
    settings = loaded.resolved(replace(SETTINGS, **changes), 4)
    assert settings.guide == "off"
    assert not loaded.model(settings).is_guided


def test_a_scene_without_light_has_an_even_guide() -> None:
    dark = {
        "type": "scene",
        "sensor": {"type": "perspective", "film": {"type": "hdrfilm", "width": 8, "height": 8}},
        "shape": {"type": "sphere", "center": [0, 0, 5]},
        "lamp": {"type": "point", "position": [0, 0, 0], "intensity": 0.0},
    }
    estimate = renderer.render(dark, Target(spp=4), Settings(guide="on", replicate_size=2))
    assert (estimate.mean == 0).all()


def test_an_unknown_guide_is_refused() -> None:
    with pytest.raises(SettingsError, match="guide is 'maybe'; choose one of off, on"):
        Settings(guide="maybe")
