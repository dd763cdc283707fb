"""Facts about colour: mono, RGB and spectral kernels estimate the same image where nothing is coloured."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

import renderer
from renderer import Settings, Target
from renderer.backend import mitsuba
from tests.statistical.conftest import z_limit

SIZE, SPP = 48, 256


def grey_room() -> dict[str, Any]:
    """Grey surfaces, diffuse and rough, in a grey sky with a grey light."""
    transform = mitsuba().ScalarTransform4f
    grey = lambda value: {"type": "rgb", "value": [value] * 3}  # noqa: E731
    return {
        "type": "scene",
        "sensor": {
            "type": "perspective",
            "fov": 45,
            "to_world": transform().look_at(origin=[0, 1.5, 5], target=[0, 0.5, 0], up=[0, 1, 0]),
            "film": {"type": "hdrfilm", "width": SIZE, "height": SIZE, "filter": {"type": "box"}},
        },
        "integrator": {"type": "path", "max_depth": 5},
        "floor": {
            "type": "rectangle",
            "to_world": transform().rotate([1, 0, 0], -90).scale(4),
            "bsdf": {"type": "diffuse", "reflectance": grey(0.6)},
        },
        "ball": {
            "type": "sphere",
            "center": [0, 0.8, 0],
            "radius": 0.8,
            "bsdf": {"type": "roughplastic", "diffuse_reflectance": grey(0.3), "alpha": 0.2},
        },
        "sky": {"type": "constant", "radiance": grey(0.5)},
        "lamp": {
            "type": "sphere",
            "center": [1.5, 2.5, 1],
            "radius": 0.2,
            "emitter": {"type": "area", "radiance": grey(20)},
        },
    }


def image_mean(estimate: renderer.Estimate) -> tuple[np.ndarray, np.ndarray]:
    """Mean over the image and its standard error, R, G, B."""
    m = estimate.moments
    return m.mean.mean(axis=0), np.sqrt(m.variance_of_mean()[:, :3].sum(axis=0)) / len(m.count)


@pytest.mark.parametrize("colour", ["mono", "spectral"])
def test_a_grey_scene_looks_the_same_in_every_colour_model(colour: str, seed: int) -> None:
    rgb, rgb_error = image_mean(renderer.render(grey_room(), Target(spp=SPP), Settings(seed=seed, colour="rgb")))
    other = renderer.render(grey_room(), Target(spp=SPP), Settings(seed=seed + 1, colour=colour))
    mean, error = image_mean(other)
    assert other.identity.settings["colour"] == colour
    z = (mean - rgb) / np.hypot(error, rgb_error)
    assert np.all(np.abs(z) < z_limit(3)), f"z of R, G, B: {z}"


@contextmanager
def process_variant(variant: str) -> Iterator[Any]:
    """Mitsuba with another variant of its own, as its integrators need it."""
    import mitsuba as mi

    before = str(mi.variant())
    mi.set_variant(variant)
    try:
        yield mi
    finally:
        mi.set_variant(before)


def test_a_coloured_scene_in_spectral_agrees_with_spectral_path(seed: int) -> None:
    scene = renderer.load_scene("cornell-box", settings=Settings(width=SIZE, height=SIZE, colour="spectral"))
    mean, error = image_mean(renderer.render(scene, Target(spp=SPP), Settings(width=SIZE, height=SIZE, seed=seed)))
    with process_variant(scene.variant) as mi:
        path = mi.load_dict({"type": "path", "max_depth": scene.requirements.max_depth})
        runs = [
            np.array(mi.render(scene.mitsuba_scene, sensor=scene.sensor, integrator=path, spp=32, seed=seed + i))
            for i in range(16)
        ]
    means = np.array([run[..., :3].mean(axis=(0, 1)) for run in runs])
    z = (mean - means.mean(axis=0)) / np.hypot(error, means.std(axis=0, ddof=1) / math.sqrt(len(runs)))
    assert np.all(np.abs(z) < z_limit(3)), f"z of R, G, B: {z}"
