"""Meters: how often a reading's interval holds the truth, and how often a target's bound keeps its word.

Every run is a render of its own, with a seed of its own; the truth is a closed form, or a run of many more samples.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import renderer
from renderer.estimate.readings import readings

ONE = {"type": "hdrfilm", "width": 1, "height": 1}
LONG, MOST = 2_000_000, 500_000  # samples of a truth, and of a run at most
GREY = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.5}}


@dataclass(frozen=True)
class Metered:
    """below: share of runs whose value is within the target of the truth; covered: whose 95 % interval has it.
    spp: mean samples. truth: of the luminance.
    """

    name: str
    target: float
    runs: int
    below: float
    covered: float
    spp: float
    truth: float


def scenes() -> dict[str, tuple[dict[str, Any], float | None]]:
    """A meter each, and its closed form where there is one."""
    from renderer.backend import mitsuba

    T = mitsuba().ScalarTransform4f
    square = {
        "type": "rectangle",
        "to_world": T().scale(1e-3),
        "bsdf": GREY,
        "meter": {"type": "irradiancemeter", "film": ONE},
    }
    lamp = {
        "type": "sphere",
        "center": [0, -2, 0.5],
        "radius": 0.3,
        "light": {"type": "area", "radiance": {"type": "rgb", "value": 4.0}},
    }
    disk = {"type": "disk", "to_world": T().translate([0, 0, 1]).rotate([1, 0, 0], 180).scale(0.5)}
    disk["light"] = {"type": "area", "radiance": {"type": "rgb", "value": 3.0}}
    wall = {"type": "rectangle", "to_world": T().translate([0, 1, 0]).rotate([1, 0, 0], 90).scale(20), "bsdf": GREY}
    fog = {"type": "homogeneous", "id": "fog", "sigma_t": 0.7, "albedo": 0.8}
    ball = {"type": "sphere", "radius": 4.0, "bsdf": {"type": "null"}, "interior": {"type": "ref", "id": "fog"}}
    beam = {"type": "radiancemeter", "origin": [0, 0, 3], "direction": [0, 0.2, -1], "film": ONE}
    floor = {"type": "rectangle", "to_world": T().scale(20), "bsdf": GREY}

    def scene(**parts: Any) -> dict[str, Any]:
        return {"type": "scene", "integrator": {"type": "volpath" if "fog" in parts else "path"}, **parts}

    foggy = {**square, "exterior": {"type": "ref", "id": "fog"}}
    return {
        "disk": (scene(square=square, disk=disk), math.pi * 3 * 0.25 / 1.25),
        "lamp beside, and a wall": (scene(square=square, lamp=lamp, wall=wall), None),
        "lamp in fog": (scene(fog=fog, square=foggy, ball=ball, lamp=lamp), None),
        "radiance of a floor": (scene(beam=beam, floor=floor, lamp=lamp, wall=wall), None),
    }


def measure(name: str, target: float, runs: int) -> Metered:
    """Independent runs of one meter to one target."""
    contents, truth = scenes()[name]
    scene = renderer.load_scene(contents)
    if truth is None:
        truth = float(renderer.render(scene, renderer.Target(spp=LONG)).moments.luminance()[0])
    below = covered = 0
    spent = 0.0
    for run in range(runs):
        settings = renderer.Settings(seed=10_000 + run)
        estimate = renderer.render(scene, renderer.Target(error=target, spp=MOST), settings)
        (reading,) = readings(estimate) or []
        off = abs(reading["value"]["Y"] - truth)
        below += off <= target * truth
        covered += off <= reading["half_width"]["Y"]
        spent += estimate.spp / runs
    return Metered(name, target, runs, below / runs, covered / runs, spent, truth)
