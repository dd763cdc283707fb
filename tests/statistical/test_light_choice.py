"""Choosing among many lights by the place: as often as the table says, never biased, the same again."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from conftest import p_limit, z_limit
from scipy.stats import chi2

import renderer
from renderer.backend import mitsuba, using
from renderer.equation.lights import sampler as emitter_sampling
from renderer.equation.lights.choice import MOST_ENTRIES
from renderer.equation.lights.sampler import EmitterSampler, useful_survey
from renderer.equation.lights.scene_lights import lights_of
from renderer.equation.path import PathKernel

mi = mitsuba()
T = mi.ScalarTransform4f
DRAWS = 2**18
POINTS = ((-3.5, 0.0, -3.5), (0.0, 0.0, 0.0), (3.5, 0.0, 1.0))


def hall(n_lights: int, colour: bool = True) -> dict[str, Any]:
    """A floor under lamps of very unequal power, a screen between them, a sky: every kind of light at once."""
    rng = np.random.default_rng(n_lights)
    contents: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 4},
        "sensor": {
            "type": "perspective",
            "fov": 60,
            "to_world": T().look_at([0, 5, 9], [0, 0, 0], [0, 1, 0]),
            "film": {"type": "hdrfilm", "width": 32, "height": 24, "rfilter": {"type": "box"}},
        },
        "floor": {"type": "rectangle", "to_world": T().rotate([1, 0, 0], -90).scale(5)},
        "screen": {"type": "cube", "to_world": T().translate([1, 1, 0]).scale([0.1, 1, 3])},
        "sky": {"type": "constant", "radiance": 0.02},
    }
    for i in range(n_lights):
        x, z = rng.uniform(-4, 4, 2)
        power = 10 ** rng.uniform(-2, 1)
        value = (power * rng.uniform(0.2, 1, 3)).tolist() if colour else power
        radiance = {"type": "rgb", "value": value} if colour else {"type": "uniform", "value": value}
        if i % 3 == 0:
            contents[f"lamp{i}"] = {"type": "point", "position": [x, rng.uniform(0.3, 3), z], "intensity": radiance}
        elif i % 3 == 1:
            ball = {"center": [x, rng.uniform(0.3, 3), z], "radius": 0.05}
            contents[f"lamp{i}"] = {"type": "sphere", **ball, "emitter": {"type": "area", "radiance": radiance}}
        else:
            panel = T().translate([x, rng.uniform(0.3, 3), z]).rotate([1, 0, 0], 90).scale(0.1)
            emitter = {"type": "area", "radiance": radiance}
            contents[f"lamp{i}"] = {"type": "rectangle", "to_world": panel, "emitter": emitter}
    return contents


def surveyed(contents: dict[str, Any]) -> EmitterSampler:
    scene = mi.load_dict(contents)
    return of_scene(scene)


def of_scene(scene: Any) -> EmitterSampler:
    lights = lights_of(scene)
    return EmitterSampler(lights, useful_survey(scene, scene.sensors()[0], lights))


def place_of(sampler: EmitterSampler, point: tuple[float, float, float], n: int = 1) -> Any:
    return sampler.place(mi.Point3f(*point) + mi.Float([0.0] * n), mi.Normal3f(0, 1, 0), mi.Bool(True))


@pytest.mark.parametrize("n_lights", [12, MOST_ENTRIES + 57])
def test_every_light_is_chosen_as_often_as_the_table_says(n_lights: int, seed: int) -> None:
    sampler = surveyed(hall(n_lights))
    choice: Any = sampler.choice
    assert sampler.knows_places
    assert choice.is_shared == (n_lights > MOST_ENTRIES)
    n = sampler.n_entries
    rows = []
    for i, point in enumerate(POINTS):
        place = place_of(sampler, point)
        grid = np.floor(np.random.default_rng(seed + i).random((2, DRAWS)) * 2**24) / 2**24
        index, fresh, told = choice.sample(place, mi.Point2f(grid.astype(np.float32)), mi.Bool(True))
        index, told, fresh = np.array(index), np.array(told, np.float64), np.array(fresh)
        pmf = np.array(choice.pmf(place, mi.UInt32(np.arange(n, dtype=np.uint32)), mi.Bool(True)), np.float64)
        assert pmf.min() > 0
        assert pmf.sum() == pytest.approx(1, abs=1e-5)
        np.testing.assert_allclose(told, pmf[index], rtol=1e-5)
        assert fresh.min() >= 0
        assert fresh.max() < 1
        rows.append(pmf)
        expected = DRAWS * pmf
        is_rare = expected < 8
        observed = np.bincount(index, minlength=n).astype(np.float64)
        observed = np.append(observed[~is_rare], observed[is_rare].sum())
        expected = np.append(expected[~is_rare], expected[is_rare].sum())
        kept = expected > 0
        statistic = (np.square(observed - expected)[kept] / expected[kept]).sum()
        assert chi2.sf(statistic, int(kept.sum()) - 1) > p_limit() / len(POINTS)
    assert np.abs(rows[0] - rows[2]).sum() > 0.2  # the place matters


def test_what_is_left_of_the_random_number_is_uniform(seed: int) -> None:
    choice: Any = surveyed(hall(12)).choice
    u = mi.Point2f(np.random.default_rng(seed).random((2, DRAWS), np.float32))
    _, fresh, _ = choice.sample(mi.UInt32(0), u, mi.Bool(True))
    for values in np.array(fresh):
        counts = np.histogram(values, 32, (0, 1))[0]
        assert chi2.sf((np.square(counts - DRAWS / 32) / (DRAWS / 32)).sum(), 31) > p_limit() / 2


@pytest.mark.parametrize("n_lights", [12, MOST_ENTRIES + 57])
def test_a_draw_is_told_the_same_density_as_a_hit_at_its_place(n_lights: int, seed: int) -> None:
    import drjit as dr

    contents = hall(n_lights)
    scene = mi.load_dict(contents)
    sampler = of_scene(scene)
    for point in POINTS:
        place = place_of(sampler, point)
        ref = dr.zeros(mi.Interaction3f, DRAWS)
        ref.p = mi.Point3f(*point)
        u = mi.Point2f(np.random.default_rng(seed).random((2, DRAWS), np.float32))
        ds, _ = sampler.sample(ref, u, mi.Bool(True), place)
        told = np.array(ds.pdf, np.float64)
        found = np.array(
            sampler.pdf(ref, ds, dr.zeros(mi.SurfaceInteraction3f, DRAWS), mi.Bool(True), place), np.float64
        )
        is_area = (told > 0) & ~np.array(ds.delta)
        assert is_area.sum() > DRAWS / 20
        assert (np.abs(found - told) <= 2e-3 * told)[is_area].mean() > 0.98


@pytest.mark.parametrize("colour", ["mono", "rgb", "spectral"])
def test_surveyed_and_blind_choice_agree(colour: str, seed: int) -> None:
    assert_agree(kernels(hall(24, colour != "mono"), colour), seed)


def test_a_light_that_the_survey_never_saw_keeps_its_energy(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """As one behind the crack of a door: the survey is made blind to half of the lights, the strongest among them."""
    original = emitter_sampling.survey

    def half_blind(*arguments: Any) -> Any:
        seen = original(*arguments)
        assert seen is not None
        given = seen.given.copy()
        given[:, np.argsort(-given.sum(axis=0))[::2]] = 0
        return dataclasses.replace(seen, given=given)

    monkeypatch.setattr(emitter_sampling, "survey", half_blind)
    assert_agree(kernels(hall(24), "rgb"), seed)


def test_a_survey_is_the_same_again_and_at_every_size() -> None:
    tables = []
    for width, height in ((32, 24), (32, 24), (96, 72)):
        scene = renderer.load_scene(hall(24), settings=renderer.Settings(width, height))
        with using(scene.variant):
            choice: Any = scene.kernel(scene.resolved(renderer.Settings(), 4)).emitters.choice
            tables.append((np.array(choice._sums), np.array(choice._nodes)))
    for other in tables[1:]:
        for a, b in zip(tables[0], other, strict=True):
            np.testing.assert_array_equal(a, b)


def lit_by(*lights: dict[str, Any]) -> dict[str, Any]:
    """The hall's floor, screen and camera under a few lights."""
    contents = {name: part for name, part in hall(0).items() if name not in ("sky", "screen")}
    return contents | {f"light{i}": light for i, light in enumerate(lights)}


def spots() -> dict[str, Any]:
    """Three parts of the floor, each lit by a light of its own."""
    below = [T().look_at([x, 3, 0], [x, 0, 0.01], [0, 1, 0]) for x in (-3, 0, 3)]
    return lit_by(*({"type": "spot", "cutoff_angle": 15.0, "to_world": to_world} for to_world in below))


def test_few_lights_that_give_alike_everywhere_are_chosen_by_their_power() -> None:
    assert not surveyed(lit_by(*({"type": "point", "position": [x, 30.0, 0]} for x in (-1, 1)))).knows_places


def test_spots_of_a_few_are_chosen_where_they_shine(seed: int) -> None:
    assert surveyed(spots()).knows_places
    assert_agree(kernels(spots(), "rgb"), seed)


def test_a_camera_that_sees_nothing_surveys_nothing() -> None:
    contents = hall(12)
    contents["sensor"]["to_world"] = T().look_at([0, 5, 9], [0, 10, 18], [0, 1, 0])
    assert not surveyed(contents).knows_places


def kernels(contents: dict[str, Any], colour: str) -> tuple[renderer.Scene, PathKernel, PathKernel]:
    """The scene, its kernel, and the same with lights chosen by their power alone."""
    scene = renderer.load_scene(contents, settings=renderer.Settings(32, 24, colour=colour))
    settings = scene.resolved(renderer.Settings(colour=colour), 16)
    model = dataclasses.replace(scene.model(settings), surveys_lights=False)
    with using(scene.variant):
        blind = PathKernel(scene.mitsuba_scene, scene.sensor, (scene.width, scene.height), model)
        ours = scene.kernel(settings)
    assert ours.emitters.knows_places
    assert not blind.emitters.knows_places
    return scene, ours, blind


def assert_agree(found: tuple[renderer.Scene, PathKernel, PathKernel], seed: int, replicates: int = 64) -> None:
    """Their images agree on the average, and so do their halves left and right."""
    scene, ours, blind = found
    n = scene.width * scene.height
    pixels = np.tile(np.arange(n, dtype=np.uint32), replicates)
    lanes = np.repeat(np.arange(replicates, dtype=np.uint32), n)
    means, errors = [], []
    for kernel, run in ((ours, seed), (blind, seed + 1)):
        radiance = np.array(kernel.launch(pixels, lanes, run)[0], np.float64)[1].reshape(replicates, scene.height, -1)
        halves = np.stack([radiance.mean(axis=(1, 2)), radiance[:, :, :16].mean(axis=(1, 2))])
        means.append(halves.mean(axis=1))
        errors.append(halves.std(axis=1, ddof=1) / math.sqrt(replicates))
    z = (means[0] - means[1]) / np.hypot(*errors)
    assert (np.abs(z) < z_limit(2)).all(), f"{means[0]} and {means[1]}, z = {z}"
