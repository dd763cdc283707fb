"""Lights hidden from the camera, behind whatever it looks through, and paths of depth 0 and 1: as Mitsuba's `path`."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from conftest import mean_and_error, z_limit

import renderer
from renderer.backend import mitsuba

TECHNIQUES = ("mis", "bsdf", "emitter", "cosine", "uniform")
FEW = TECHNIQUES[:3]
SKY = {"type": "constant", "radiance": 1.0}
NULL = {"type": "null"}
GREY = {"type": "twosided", "nested": {"type": "diffuse", "reflectance": 0.5}}
CHECKERED = {"type": "checkerboard", "color0": 0.0, "color1": 1.0}


def mask(opacity: Any) -> dict[str, Any]:
    return {"type": "mask", "opacity": opacity, "nested": GREY}


def plane(z: float, bsdf: dict[str, Any] | None = None, radiance: float = 0.0) -> dict[str, Any]:
    made: dict[str, Any] = {
        "type": "rectangle",
        "to_world": mitsuba().ScalarTransform4f().translate([0, 0, z]).scale(10),
    }
    if bsdf is not None:
        made["bsdf"] = bsdf
    return made | ({"emitter": {"type": "area", "radiance": radiance}} if radiance else {})


def before_the_camera(parts: dict[str, dict[str, Any]], depth: int = 6, hide: bool = True) -> dict[str, Any]:
    t = mitsuba().ScalarTransform4f()
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": depth, "hide_emitters": hide},
        "sensor": {
            "type": "perspective",
            "fov": 30.0,
            "to_world": t.look_at([0, 0, 5], [0, 0, 0], [0, 1, 0]),
            "film": {"type": "hdrfilm", "width": 8, "height": 8, "filter": {"type": "box"}},
        },
        **parts,
    }


# What a camera along −z meets in that order. Lights have the default BSDF, which is a surface, unless one is given.
HIDDEN: dict[str, dict[str, dict[str, Any]]] = {
    "a sky behind glass without thickness": {"a": plane(1, {"type": "thindielectric"}), "sky": SKY},
    "a sky behind clear glass": {"a": plane(1, {"type": "dielectric"}), "sky": SKY},
    "a sky behind leaves": {"a": plane(1, mask(CHECKERED)), "sky": SKY},
    "a floor behind leaves": {"a": plane(1, mask(CHECKERED)), "b": plane(0, GREY), "sky": SKY},
    "a light behind leaves": {"a": plane(1, mask(CHECKERED)), "b": plane(0, radiance=1)},
    "a light behind nothing": {"a": plane(1, NULL), "b": plane(0, radiance=1)},
    "a light behind a light and nothing": {"a": plane(1, radiance=2), "b": plane(0, NULL), "c": plane(-1, radiance=1)},
    "a floor behind two lights": {
        "a": plane(1, radiance=2),
        "b": plane(0, radiance=3),
        "c": plane(-1, GREY),
        "sky": SKY,
    },
}
DARK: dict[str, dict[str, dict[str, Any]]] = {
    "a sky behind nothing twice": {"a": plane(1, NULL), "b": plane(0, NULL), "sky": SKY},
    "a light that is no surface, behind nothing": {"a": plane(1, NULL), "b": plane(0, NULL, radiance=1)},
    "a sky behind a light and nothing": {"a": plane(1, radiance=2), "b": plane(0, NULL), "sky": SKY},
}


def means(source: dict[str, Any], technique: str, seed: int) -> tuple[float, float]:
    settings = renderer.Settings(seed=seed, technique=technique, adaptive=False)  # type: ignore[arg-type]
    return mean_and_error(renderer.render(source, renderer.Target(spp=256), settings))


def path_means(source: dict[str, Any], seed: int, runs: int = 8) -> tuple[float, float]:
    mi = mitsuba()
    scene: Any = mi.load_dict(source)
    found = [float(np.mean(np.array(mi.render(scene, spp=512, seed=seed % 2**20 + run)))) for run in range(runs)]
    return float(np.mean(found)), float(np.std(found, ddof=1)) / math.sqrt(runs)


@pytest.mark.parametrize("name", HIDDEN)
def test_hidden_lights_are_hidden_behind_what_the_camera_looks_through(name: str, seed: int) -> None:
    source = before_the_camera(HIDDEN[name])
    theirs, their_error = path_means(source, seed)
    for technique in FEW:
        ours, our_error = means(source, technique, seed)
        error = math.hypot(our_error, their_error) + 1e-4 * theirs
        assert abs(ours - theirs) < 1.5 * z_limit(len(FEW)) * error, (technique, ours, theirs)


@pytest.mark.parametrize("name", DARK)
def test_nothing_is_left_of_lights_that_only_the_camera_sees(name: str, seed: int) -> None:
    source = before_the_camera(DARK[name])
    assert path_means(source, seed, 2)[0] == 0
    assert [means(source, technique, seed)[0] for technique in FEW] == [0] * len(FEW)


@pytest.mark.parametrize("hide", [False, True])
@pytest.mark.parametrize("depth", [0, 1])
def test_paths_of_depth_0_and_1_are_those_of_mitsuba(depth: int, hide: bool, seed: int) -> None:
    lamp = plane(1, radiance=3.0) | {"type": "disk", "to_world": mitsuba().ScalarTransform4f().scale(0.5)}
    source = before_the_camera({"lamp": lamp, "sky": SKY, "floor": plane(-1, GREY)}, depth, hide)
    theirs, their_error = path_means(source, seed)
    assert (theirs > 0) == (depth > 0 and not hide)
    for technique in TECHNIQUES:
        ours, our_error = means(source, technique, seed)
        assert abs(ours - theirs) <= z_limit(len(TECHNIQUES)) * math.hypot(our_error, their_error), technique
