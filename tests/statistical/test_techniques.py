"""All techniques estimate the same integral: they agree, block by block, within their error bars."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
import pytest
from conftest import z_limit

import renderer
from renderer.backend import mitsuba
from renderer.settings import TECHNIQUES

# Techniques that find the scene's light often enough for a finite run to say something: uniform directions miss the
# lobe of a smooth metal, and no direction drawn blindly finds the lamp behind the gap.
CASES = {
    "cornell-box": TECHNIQUES,
    "plates": ("mis", "bsdf", "emitter"),
    "materials": ("mis", "bsdf", "emitter"),
    "ring-sky": ("mis", "bsdf", "emitter"),
    "glass-sky": ("mis", "bsdf", "emitter"),
    "caustic": ("mis", "bsdf", "emitter"),
    "many-lights": ("mis", "bsdf", "emitter"),
    "gap": ("mis", "emitter"),
    "furnace": TECHNIQUES,
}
WIDTH, HEIGHT, BLOCK, SPP = 16, 12, 4, 512
# One direction in ten thousand finds the sun of this sky, or the smallest lamp by way of the plates: a block needs
# dozens of such finds to know its variance.
MORE_SPP = {"ring-sky": 16384, "glass-sky": 16384, "plates": 16384}


def blocks(values: np.ndarray) -> np.ndarray:
    """Sums over blocks of pixels: sums of many skewed values are closer to normal than the values."""
    return values.reshape(HEIGHT // BLOCK, BLOCK, WIDTH // BLOCK, BLOCK).sum(axis=(1, 3)).ravel()


@pytest.mark.parametrize("name", CASES)
def test_techniques_agree(name: str, seed: int) -> None:
    """Every block of 16 pixels and the whole image, each pair of techniques."""
    sums = {}
    for i, technique in enumerate(CASES[name]):
        settings = renderer.Settings(WIDTH, HEIGHT, seed + i, technique=technique, max_depth=4)
        moments = renderer.render(name, renderer.Target(spp=MORE_SPP.get(name, SPP)), settings).moments
        sums[technique] = blocks(moments.luminance()), blocks(moments.variance_of_mean()[:, 3])
    pairs = list(combinations(CASES[name], 2))
    for first, second in pairs:
        (a, va), (b, vb) = sums[first], sums[second]
        rounding = 1e-6 * np.abs(a)
        z = (a - b) / np.sqrt(va + vb + rounding**2)
        limit = z_limit(len(pairs) * (len(z) + 1))
        assert np.abs(z).max() < limit, f"{name}: {first} and {second} differ, z up to {np.abs(z).max():.2f}"
        whole = (a - b).sum() / np.sqrt((va + vb + rounding**2).sum())
        assert abs(whole) < limit, f"{name}: image means by {first} and {second}: z = {whole:+.2f}"


@pytest.mark.parametrize("light", [{"type": "constant"}, {"type": "directional", "direction": [0.3, 0.2, -1.0]}])
def test_a_closed_room_of_equal_walls_lets_no_light_in_from_infinity(light: dict[str, Any], seed: int) -> None:
    """Mitsuba 3.9.1 merges the walls to a mesh without bounds, and looks for the sun no further than the ball."""
    transform = mitsuba().ScalarTransform4f
    grey = {"type": "twosided", "bsdf": {"type": "diffuse"}}
    turns = (([1, 0, 0], 0), ([1, 0, 0], 90), ([1, 0, 0], 180), ([1, 0, 0], 270), ([0, 1, 0], 90), ([0, 1, 0], 270))
    walls = {
        f"wall-{i}": {
            "type": "rectangle",
            "to_world": transform().rotate(axis, angle).translate([0, 0, -10]).scale(10.001),
            "bsdf": grey,
        }
        for i, (axis, angle) in enumerate(turns)
    }
    contents = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 4},
        "sensor": {"type": "perspective", "to_world": transform().look_at([0, -5, 1], [0, 0, 0], [0, 0, 1])},
        "ball": {"type": "sphere", "radius": 0.5, "bsdf": grey},
        "light": light,
        **walls,
    }
    estimate = renderer.render(contents, renderer.Target(spp=64), renderer.Settings(16, 12, seed))
    assert not estimate.mean.any()


def test_an_open_tube_that_shines_inwards_hides_its_far_wall(seed: int) -> None:
    """From outside its light is seen through its ends alone, whichever way it is looked for."""
    transform = mitsuba().ScalarTransform4f
    contents = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 2},
        "sensor": {"type": "perspective", "to_world": transform().look_at([0, 0, 6], [0, 0, 0], [0, 1, 0])},
        "floor": {"type": "rectangle", "to_world": transform().scale(3)},
        "tube": {
            "type": "cylinder",
            "p0": [0, 0, 0.5],
            "p1": [0, 0, 1.5],
            "radius": 0.7,
            "flip_normals": True,
            "emitter": {"type": "area"},
        },
    }
    found = []
    for i, technique in enumerate(("bsdf", "emitter")):
        settings = renderer.Settings(24, 24, seed + i, technique=technique)
        moments = renderer.render(contents, renderer.Target(spp=1024), settings).moments
        variance = moments.variance_of_mean()[:, 3]
        found.append((float(moments.luminance().mean()), float(variance.sum()) / len(variance) ** 2))
    (a, va), (b, vb) = found
    assert abs(a - b) < z_limit() * (va + vb) ** 0.5
