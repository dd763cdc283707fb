"""Our images against Mitsuba's `path`: the means agree within the errors of both."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from conftest import mean_and_error, shared_scene, z_limit

import renderer
from renderer.backend import mitsuba
from tests.benchmarks.scenes import SHARED_SURFACES

GALLERY = ("cornell-box", "plates", "materials", "ring-sky", "glass-sky", "caustic", "many-lights", "gap", "furnace")
SIZE = renderer.Settings(width=96, height=72, colour="rgb")
PATH_RUNS = 16


def path_mean(scene: renderer.Scene, spp: int, seed: int) -> tuple[float, float]:
    """Mean luminance by Mitsuba's path at equal depth, and its standard error from independent runs."""
    mi = mitsuba()
    needs = scene.requirements
    integrator: Any = mi.load_dict(
        {
            "type": "path",
            "max_depth": needs.max_depth,
            "rr_depth": needs.rr_depth,
            "hide_emitters": needs.hide_emitters,
        }
    )
    runs = []
    for run in range(PATH_RUNS):
        image = mi.render(
            scene.mitsuba_scene, sensor=scene.sensor, integrator=integrator, spp=spp, seed=seed % 2**20 + run
        )
        runs.append(float(np.mean(np.array(image)[..., :3] @ np.array([0.2126, 0.7152, 0.0722]))))
    return float(np.mean(runs)), float(np.std(runs, ddof=1)) / math.sqrt(PATH_RUNS)


def assert_agrees(source: Any, seed: int) -> None:
    scene = renderer.load_scene(source, settings=SIZE)
    estimate = renderer.render(scene, renderer.Target(spp=64), renderer.Settings(seed=seed, colour="rgb"))
    ours, our_error = mean_and_error(estimate)
    theirs, their_error = path_mean(scene, 8, seed)
    z = (ours - theirs) / math.hypot(our_error, their_error)
    assert abs(z) < z_limit(), f"ours {ours:.6g} ± {our_error:.2g}, path {theirs:.6g} ± {their_error:.2g}, z = {z:+.2f}"
    assert estimate.invalid.sum() == 0


@pytest.mark.parametrize("name", SHARED_SURFACES)
def test_shared_scene_agrees_with_path(name: str, seed: int) -> None:
    assert_agrees(shared_scene(name), seed)


@pytest.mark.parametrize("name", GALLERY)
def test_gallery_scene_agrees_with_path(name: str, seed: int) -> None:
    assert_agrees(name, seed)
