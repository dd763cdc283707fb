"""Environment maps that a density by rows and sines cannot tell: black, lit from a pole alone, narrow, not finite."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from conftest import SHARED, mean_and_error, z_limit

import renderer
from renderer.backend import mitsuba

mi = mitsuba()
T = mi.ScalarTransform4f
TECHNIQUES = ("mis", "emitter", "bsdf")


def under(texels: np.ndarray, **more: Any) -> dict[str, Any]:
    """A ball on a floor under a map whose first row is straight above."""
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 3},
        "sensor": {
            "type": "perspective",
            "to_world": T().look_at([0, -4, 1.5], [0, 0, 0.4], [0, 0, 1]),
            "film": {"type": "hdrfilm", "width": 16, "height": 16, "filter": {"type": "box"}},
        },
        "sky": {
            "type": "envmap",
            "bitmap": mi.Bitmap(texels.astype(np.float32)),
            "to_world": T().rotate([1, 0, 0], 90),
        },
        "floor": {"type": "rectangle", "to_world": T().scale(3)},
        "ball": {"type": "sphere", "center": [0, 0, 0.5], "radius": 0.5},
        **more,
    }


def texels(height: int = 8, width: int = 16, **rows: list[float]) -> np.ndarray:
    """A black map but for some rows, by "row" and their number."""
    made = np.zeros((height, width, 3))
    for name, value in rows.items():
        made[int(name.removeprefix("row"))] = value
    return made


def spotted() -> np.ndarray:
    made = texels()
    made[0, 3], made[4, 2] = [30, 2, 1], 1
    return made


def tinted() -> np.ndarray:
    made = np.ones((8, 16, 3))
    made[2:4, 4:9, 2] = -0.5
    return made


ODD = {
    "pole alone": lambda: texels(row0=[3, 2, 1]),
    "pole and a texel": spotted,
    "negative blue": tinted,
    "one wide": lambda: np.ones((8, 1, 3)) * np.arange(1, 9)[:, None, None],
    "two high": lambda: texels(2, 8, row0=[1, 2, 3]),
    "one texel": lambda: np.ones((1, 1, 3)),
}


def seen(source: dict[str, Any], technique: str, seed: int) -> tuple[float, float, int]:
    settings = renderer.Settings(seed=seed, technique=technique, adaptive=False)  # type: ignore[arg-type]
    estimate = renderer.render(source, renderer.Target(spp=256), settings)
    return *mean_and_error(estimate), int(estimate.invalid.sum())


@pytest.mark.parametrize("name", ODD)
def test_all_techniques_see_the_same_of_an_odd_map(name: str, seed: int) -> None:
    found = {technique: seen(under(ODD[name]()), technique, seed) for technique in TECHNIQUES}
    mean, error, invalid = found["bsdf"]
    assert mean > 1e-3
    assert invalid == 0
    for technique in TECHNIQUES[:2]:
        other, other_error, invalid = found[technique]
        assert invalid == 0
        assert abs(other - mean) < z_limit(2) * math.hypot(other_error, error), found


@pytest.mark.parametrize("colour", ["auto", "spectral"])
def test_a_black_map_is_no_light(colour: Any, seed: int) -> None:
    """14 % more light before, and every second sample not finite."""
    lamp = {
        "type": "rectangle",
        "to_world": T().translate([0, 0, 2.5]).rotate([1, 0, 0], 180).scale(0.5),
        "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [9, 7, 5]}},
    }
    settings = renderer.Settings(seed=seed, colour=colour, adaptive=False)
    lit = renderer.render(under(texels(), lamp=lamp), renderer.Target(spp=64), settings)
    plain = {key: part for key, part in under(texels(), lamp=lamp).items() if key != "sky"}
    alone = renderer.render(plain, renderer.Target(spp=64), settings)
    assert lit.invalid.sum() == 0
    assert np.allclose(lit.mean, alone.mean, rtol=1e-5)


def test_the_black_map_of_a_public_report(seed: int) -> None:
    path = SHARED / "reports/black-map/black-lamp.xml"
    if not path.is_file():
        pytest.skip("needs the public reports beside the checkout")
    estimate = renderer.render(path, renderer.Target(spp=64), renderer.Settings(seed=seed))
    assert estimate.invalid.sum() == 0
    assert estimate.mean.mean(axis=(0, 1)) == pytest.approx([0.0640, 0.0498, 0.0356], rel=0.01)


def test_texels_that_are_not_finite_count_as_black_with_a_warning(seed: int) -> None:
    broken, mended = np.ones((8, 16, 3)), np.ones((8, 16, 3))
    broken[3, 4], broken[2, 2, 1] = np.nan, np.inf
    mended[3, 4], mended[2, 2] = 0, 0
    scene = renderer.load_scene(under(broken))
    assert any(w.startswith("environment map: 2 of its 128 texels are not finite") for w in scene.warnings)
    settings = renderer.Settings(seed=seed, adaptive=False, colour="rgb")
    ours, theirs = (renderer.render(s, renderer.Target(spp=16), settings) for s in (under(broken), under(mended)))
    assert ours.invalid.sum() == 0
    assert np.allclose(ours.mean, theirs.mean, rtol=1e-5)
