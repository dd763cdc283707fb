"""Irradiance meters against closed forms: every kind of light, by every technique, and the error that is said."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import z_limit
from scipy.stats import binom

import renderer
from renderer.backend import mitsuba
from renderer.errors import SceneError, UnsupportedScene
from renderer.estimate.readings import lines, readings

mi = mitsuba()
T = mi.ScalarTransform4f
ONE = {"type": "hdrfilm", "width": 1, "height": 1}
ROUNDING = 2e-6


def grey(value: float) -> dict[str, Any]:
    return {"type": "rgb", "value": value}


def metered(lights: dict[str, Any], depth: int = 1, **shape: Any) -> dict[str, Any]:
    """Lights above a tiny square in the plane z = 0 that has a meter."""
    square = {"type": "rectangle", "to_world": T().scale(1e-4), "bsdf": {"type": "diffuse", "reflectance": 0.5}}
    meter = {"type": "irradiancemeter", "film": ONE}
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": depth},
        "square": {**square, **shape, "meter": meter},
        **lights,
    }


def disk(radius: float, height: float) -> tuple[dict[str, Any], float]:
    to_world = T().translate([0, 0, height]).rotate([1, 0, 0], 180).scale(radius)
    emitter = {"type": "area", "radiance": grey(3.0)}
    return {"type": "disk", "to_world": to_world, "emitter": emitter}, math.pi * 3 * radius**2 / (radius**2 + height**2)


def rectangle(a: float, b: float, height: float) -> tuple[dict[str, Any], float]:
    """2a × 2b, parallel to the meter, above it: four times the configuration factor of a corner."""
    x, y = a / height, b / height
    one = x / math.sqrt(1 + x * x) * math.atan(y / math.sqrt(1 + x * x))
    two = y / math.sqrt(1 + y * y) * math.atan(x / math.sqrt(1 + y * y))
    to_world = T().translate([0, 0, height]).rotate([1, 0, 0], 180).scale([a, b, 1])
    emitter = {"type": "area", "radiance": grey(5.0)}
    return {"type": "rectangle", "to_world": to_world, "emitter": emitter}, 5.0 * 4 * (one + two) / 2


def ball(radius: float, at: tuple[float, float, float]) -> tuple[dict[str, Any], float]:
    distance = math.hypot(*at)
    emitter = {"type": "area", "radiance": grey(2.0 / radius**2)}
    sphere = {"type": "sphere", "center": list(at), "radius": radius, "emitter": emitter}
    return sphere, math.pi * 2.0 / distance**2 * at[2] / distance


LIGHTS: dict[str, tuple[dict[str, Any], float]] = {
    "disk": disk(0.5, 1.0),
    "wide disk": disk(30.0, 1.0),
    "rectangle": rectangle(0.4, 1.5, 0.7),
    "ball": ball(0.3, (0.5, 0.2, 1.5)),
    "ball of 1e-4 rad": ball(1e-4, (0.0, 0.0, 2.0)),
    "point": ({"type": "point", "position": [0, 1, 2.0], "intensity": grey(8.0)}, 8 / 5 * 2 / math.sqrt(5)),
    "spot": (
        {"type": "spot", "to_world": T().look_at([0, 0, 2], [0, 0, 0], [0, 1, 0]), "intensity": grey(8.0)},
        8 / 4,
    ),
    "direction": ({"type": "directional", "direction": [0, 1, -1], "irradiance": grey(2.0)}, math.sqrt(2)),
    "sky": ({"type": "constant", "radiance": grey(2.0)}, 2 * math.pi),
}
FROM_NOWHERE = ("point", "spot", "direction")  # which no ray meets


@pytest.mark.parametrize("colour", ["mono", "rgb", "spectral"])
@pytest.mark.parametrize("light", LIGHTS)
def test_irradiance_is_that_of_the_closed_form(light: str, colour: str, seed: int) -> None:
    contents, truth = LIGHTS[light]
    estimate = renderer.render(
        metered({"light": contents}), renderer.Target(spp=4096), renderer.Settings(seed=seed, colour=colour)
    )
    value, error = float(estimate.moments.luminance()[0]), float(estimate.stderr[0, 0, 3])
    assert abs(value - truth) < z_limit(3 * len(LIGHTS)) * error + ROUNDING * truth
    assert error < 2e-3 * truth


@pytest.mark.parametrize("technique", ["mis", "emitter", "bsdf", "cosine", "uniform"])
@pytest.mark.parametrize("light", ["disk", "sky", "rectangle"])
def test_all_techniques_meter_the_same(light: str, technique: str, seed: int) -> None:
    contents, truth = LIGHTS[light]
    settings = renderer.Settings(seed=seed, technique=technique)
    estimate = renderer.render(metered({"light": contents}), renderer.Target(spp=16384), settings)
    error = float(estimate.stderr[0, 0, 3])
    assert abs(float(estimate.moments.luminance()[0]) - truth) < z_limit(15) * error + ROUNDING * truth


def test_light_that_comes_by_bounces_counts_from_the_depth_on_that_it_has(seed: int) -> None:
    """A meter that faces a wide white floor with a lamp behind itself sees the lamp by the floor alone."""
    floor = {"type": "rectangle", "to_world": T().translate([0, 0, 1]).rotate([1, 0, 0], 180).scale(400)}
    floor["bsdf"] = {"type": "diffuse", "reflectance": 1.0}
    lamp = {"type": "point", "position": [0, 0, -1e-2], "intensity": grey(1.0)}
    below = metered({"floor": floor, "lamp": lamp}, depth=1)
    assert not renderer.render(below, renderer.Target(spp=64), renderer.Settings(seed=seed)).mean.any()
    # ∫ I cosθ/(π d²) cosθ'/d² over the floor, of a lamp and a meter at its distance: 1/(2 h²) of the intensity.
    above = metered({"floor": floor, "lamp": lamp}, depth=2)
    estimate = renderer.render(above, renderer.Target(spp=2**16), renderer.Settings(seed=seed))
    truth = 2 * quadrature(1.01, 1.0)
    assert abs(float(estimate.mean[0, 0, 0]) - truth) < z_limit(2) * float(estimate.stderr[0, 0, 0]) + 3e-5 * truth


def quadrature(lamp: float, meter: float) -> float:
    """∫ r cosθ/d² · cosθ'/d'² dr from 0 to ∞ by the midpoint rule; lamp, meter: distances from the plane."""
    n = 200_000
    u = (np.arange(n) + 0.5) / n
    r, jacobian = u / (1 - u), 1 / (1 - u) ** 2
    d, e = r * r + lamp**2, r * r + meter**2
    return float(np.mean(jacobian * r * (lamp / d**1.5) * (meter**2 / e**2)))


def test_what_a_lit_shape_sends_out_itself_is_not_metered(seed: int) -> None:
    contents = metered(
        {"sky": {"type": "constant", "radiance": grey(2.0)}}, emitter={"type": "area", "radiance": grey(9.0)}
    )
    estimate = renderer.render(contents, renderer.Target(spp=4096), renderer.Settings(seed=seed))
    assert abs(float(estimate.mean[0, 0, 0]) - 2 * math.pi) < z_limit(1) * float(estimate.stderr[0, 0, 0]) + 1e-5


def test_a_mesh_can_be_metered_and_pixels_divide_it(tmp_path: Path, seed: int) -> None:
    """The right half of a square lies under a lamp that is near; the left half does not."""
    (tmp_path / "square.obj").write_text("v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nf 1 2 3 4\n")
    lamp = {"type": "point", "position": [1, 0, 0.5], "intensity": grey(1.0)}
    mesh = {"type": "obj", "filename": str(tmp_path / "square.obj"), "to_world": T().scale(1.0)}
    contents = metered({"lamp": lamp}, **mesh)
    estimate = renderer.render(contents, renderer.Target(spp=4096), renderer.Settings(seed=seed))
    n = 2000
    x, y = np.meshgrid((np.arange(n) + 0.5) / n * 2 - 1, (np.arange(n) + 0.5) / n * 2 - 1)
    truth = float(np.mean(0.5 / ((x - 1) ** 2 + y**2 + 0.25) ** 1.5))
    assert abs(float(estimate.mean[0, 0, 0]) - truth) < z_limit(1) * float(estimate.stderr[0, 0, 0]) + 1e-4 * truth
    assert estimate.stderr[0, 0, 0] < 0.01 * truth


def test_many_lights_over_a_meter_are_chosen_where_it_is(seed: int) -> None:
    spots = {
        f"spot{i}": {
            "type": "spot",
            "to_world": T().look_at([4.0 * i, 0, 2], [4.0 * i, 0, 0], [0, 1, 0]),
            "intensity": grey(8.0),
        }
        for i in range(12)
    }
    floor = {"type": "rectangle", "to_world": T().translate([20, 0, -1e-3]).scale(30)}
    estimate = renderer.render(
        metered({**spots, "floor": floor}), renderer.Target(spp=4096), renderer.Settings(seed=seed)
    )
    assert abs(float(estimate.mean[0, 0, 0]) - 2) < z_limit(1) * float(estimate.stderr[0, 0, 0]) + 1e-5
    assert estimate.stderr[0, 0, 0] < 0.01  # a choice by power alone: 0.1


RUNS, TARGET = 60, 0.02


def test_a_value_within_an_error_is_within_it_as_often_as_is_said() -> None:
    """The target's bound holds with 95 % confidence, the interval with 95 %: a false alarm each in 10,000."""
    contents = metered(
        {
            "wide": LIGHTS["rectangle"][0],
            "side": {
                "type": "sphere",
                "center": [0, -2, 0.4],
                "radius": 0.3,
                "emitter": {"type": "area", "radiance": grey(4.0)},
            },
            "wall": {"type": "rectangle", "to_world": T().translate([0, 1, 0]).rotate([1, 0, 0], 90).scale(20)},
        },
        depth=-1,
    )
    scene = renderer.load_scene(contents)
    truth = float(renderer.render(scene, renderer.Target(spp=300_000)).mean[0, 0, 0])
    below = covered = 0
    for run in range(RUNS):
        estimate = renderer.render(
            scene, renderer.Target(error=TARGET, spp=100_000), renderer.Settings(seed=1000 + run)
        )
        assert estimate.spp < 50_000
        (reading,) = readings(estimate) or []
        off = abs(reading["value"]["R"] - truth)
        below += off <= TARGET * truth
        covered += off <= reading["half_width"]["R"]
    least = int(binom.ppf(1e-4, RUNS, 0.95))
    assert below >= least
    assert covered >= least


def test_readings_are_values_with_intervals() -> None:
    estimate = renderer.render(metered({"light": LIGHTS["disk"][0]}), renderer.Target(spp=1024))
    (line,) = lines(estimate)
    value, half = (float(word) for word in line.split(" with ")[0].split(" ± "))
    (reading,) = readings(estimate) or []
    assert value == pytest.approx(reading["value"]["Y"], abs=half / 10)
    assert half == pytest.approx(reading["half_width"]["Y"], rel=0.06)
    assert reading["replicates"] == estimate.count[0, 0]
    large = renderer.render("cornell-box", renderer.Target(spp=1), renderer.Settings(17, 16))
    assert readings(large) is None
    assert lines(large) == []


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"meter": {"type": "irradiancemeter", "film": ONE}}, "belongs to no shape"),
        ({"square": {"type": "sphere", "eye": {"type": "perspective", "film": ONE}}}, "only an irradiancemeter"),
        ({"square": {"type": "linearcurve", "meter": {"type": "irradiancemeter"}}}, "cannot be drawn evenly"),
    ],
)
def test_meters_that_cannot_be_are_named(change: dict[str, Any], word: str, tmp_path: Path) -> None:
    (tmp_path / "curve.txt").write_text("0 0 0 0.1\n1 0 0 0.1\n2 0 0 0.1\n")
    if change.get("square", {}).get("type") == "linearcurve":
        change = {"square": {**change["square"], "filename": str(tmp_path / "curve.txt")}}
    with pytest.raises(UnsupportedScene, match=word):
        renderer.load_scene({**metered({"light": LIGHTS["disk"][0]}), **change})


# ------------------------------ Batches ------------------------------

METER = """<shape type="rectangle"><transform name="to_world"><scale value="0.0001"/><translate x="{}"/></transform>
  <sensor type="irradiancemeter" id="{}"><film type="hdrfilm"><integer name="width" value="1"/>
  <integer name="height" value="1"/></film></sensor></shape>"""
BATCH = f"""<scene version="3.0.0"><integrator type="path"/>{METER.format(0, "near")}{METER.format(3, "far")}
  <sensor type="batch" id="both"><ref id="near"/><ref id="far"/>EXTRA<film type="hdrfilm">
  <integer name="width" value="4"/><integer name="height" value="1"/></film></sensor>
  <emitter type="point"><point name="position" x="0" y="0" z="2"/><rgb name="intensity" value="8"/></emitter>
  MORE</scene>"""


def test_a_batch_of_meters_has_them_side_by_side(tmp_path: Path, seed: int) -> None:
    """Two columns each: of one that is below the lamp, and of one that is beside it."""
    (tmp_path / "two.xml").write_text(BATCH.replace("EXTRA", "").replace("MORE", ""))
    scene = renderer.load_scene(tmp_path / "two.xml")
    assert [one.plugin for one in scene.sensors] == ["batch", "irradiancemeter", "irradiancemeter"]
    estimate = renderer.render(scene, renderer.Target(spp=256), renderer.Settings(seed=seed))
    truth = np.repeat([8 / 4, 8 * 2 / 13**1.5], 2)
    np.testing.assert_allclose(estimate.mean[0, :, 0], truth, rtol=1e-4)
    alone = renderer.render(scene, renderer.Target(spp=256), renderer.Settings(seed=seed, sensor="far"))
    np.testing.assert_allclose(alone.mean[0, 0, 0], truth[-1], rtol=1e-4)
    assert [one["x"] for one in readings(estimate) or []] == [0, 1, 2, 3]


@pytest.mark.parametrize(
    ("extra", "more", "word"),
    [
        ('<sensor type="perspective"/>', "", "meters and other sensors"),
        ("", '<shape type="sphere"><medium type="homogeneous" name="interior"/></shape>', "no participating media"),
    ],
)
def test_batches_that_cannot_be_are_named(tmp_path: Path, extra: str, more: str, word: str) -> None:
    (tmp_path / "two.xml").write_text(BATCH.replace("EXTRA", extra).replace("MORE", more))
    with pytest.raises(UnsupportedScene, match=word):
        renderer.load_scene(tmp_path / "two.xml")


@pytest.mark.parametrize("shape", ["point", "line", "mesh"])
def test_a_meter_without_area_is_named(shape: str, tmp_path: Path) -> None:
    (tmp_path / "flat.obj").write_text("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n")
    made: dict[str, Any] = {
        "point": {"to_world": T().scale(0.0)},
        "line": {"to_world": T().scale([1.0, 0.0, 1.0])},
        "mesh": {"type": "obj", "filename": str(tmp_path / "flat.obj")},
    }
    with pytest.raises(SceneError, match="a shape that has no area; give it some size"):
        renderer.load_scene(metered({"light": LIGHTS["sky"][0]}, **made[shape]))


# ------------------------------ Media ------------------------------


def fog(albedo: float, sigma_t: float = 0.7, **more: Any) -> dict[str, Any]:
    return {"type": "homogeneous", "sigma_t": sigma_t, "albedo": albedo, **more}


def in_fog(mist: dict[str, Any], lights: dict[str, Any], depth: int = -1, **meter: Any) -> dict[str, Any]:
    """A meter in the middle of a ball of fog that is bounded by nothing; the meter's shape names it, or the meter."""
    contents = metered(lights, depth)
    contents["fog"] = mist
    contents["square"] |= {"exterior": {"type": "ref", "id": "fog"}}
    if meter:
        del contents["square"]["exterior"]
        contents["square"]["meter"] = {**contents["square"]["meter"], **meter}
    contents["ball"] = {"type": "sphere", "radius": 3.0, "bsdf": {"type": "null"}}
    contents["ball"] |= {"interior": {"type": "ref", "id": "fog"}}
    return contents


@pytest.mark.parametrize("named_by", ["shape", "meter"])
@pytest.mark.parametrize("light", ["point", "sky", "disk", "ball of 1e-4 rad"])
def test_what_absorbs_takes_its_share_on_the_way_to_a_meter(light: str, named_by: str, seed: int) -> None:
    """Bouguer's law by each kind of light; the disk by quadrature over its rings."""
    contents, clear = LIGHTS[light]
    sigma = 0.7
    if light == "disk":
        r = (np.arange(100_000) + 0.5) / 100_000 * 0.5
        truth = float(np.sum(3 * 2 * np.pi * r * np.exp(-sigma * np.sqrt(r**2 + 1)) / (r**2 + 1) ** 2) * 0.5 / 100_000)
    else:
        distance = {"point": math.sqrt(5), "sky": 3.0, "ball of 1e-4 rad": 2.0}[light]
        truth = clear * math.exp(-sigma * distance)
    named: dict[str, Any] = {"medium": {"type": "ref", "id": "fog"}} if named_by == "meter" else {}
    scene = in_fog(fog(0.0, sigma), {"light": contents}, **named)
    estimate = renderer.render(scene, renderer.Target(spp=4096), renderer.Settings(seed=seed))
    value, error = float(estimate.moments.luminance()[0]), float(estimate.stderr[0, 0, 3])
    assert abs(value - truth) < z_limit(8) * error + 2e-4 * truth
    assert error < 0.01 * truth


@pytest.mark.parametrize("technique", ["mis", "bsdf", "emitter"])
def test_fog_that_takes_nothing_leaves_a_furnace_as_it_was(technique: str, seed: int) -> None:
    scene = in_fog(fog(1.0), {"light": {"type": "constant", "radiance": grey(2.0)}})
    settings = renderer.Settings(seed=seed, technique=technique)
    estimate = renderer.render(scene, renderer.Target(spp=16384), settings)
    error = float(estimate.stderr[0, 0, 3])
    truth = 2 * math.pi
    assert abs(float(estimate.moments.luminance()[0]) - truth) < z_limit(3) * error + 2e-4 * truth
    assert error < 0.01 * truth


def test_fog_that_scatters_lights_a_meter_as_a_white_square_there(seed: int) -> None:
    """π times the radiance of a white diffuse square in the meter's place, which a camera sees from close by."""
    lamp = {"type": "point", "position": [0, 1, 2.0], "intensity": grey(8.0)}
    scene = in_fog(fog(0.8), {"light": lamp})
    metered_value = renderer.render(scene, renderer.Target(spp=2**15), renderer.Settings(seed=seed))
    scene["square"] = {k: v for k, v in scene["square"].items() if k != "meter"}
    scene["square"]["bsdf"] = {"type": "diffuse", "reflectance": 1.0}
    look = T().look_at([0, 0, 1e-3], [0, 0, 0], [0, 1, 0])
    scene["eye"] = {"type": "perspective", "fov": 5, "to_world": look, "near_clip": 1e-5, "film": ONE}
    scene["eye"] |= {"medium": {"type": "ref", "id": "fog"}}
    seen = renderer.render(scene, renderer.Target(spp=2**15), renderer.Settings(seed=seed + 1))
    ours, theirs = float(metered_value.mean[0, 0, 0]), math.pi * float(seen.mean[0, 0, 0])
    error = math.hypot(float(metered_value.stderr[0, 0, 0]), math.pi * float(seen.stderr[0, 0, 0]))
    assert abs(ours - theirs) < z_limit(1) * error + 2e-3 * theirs
    assert error < 0.06 * theirs
