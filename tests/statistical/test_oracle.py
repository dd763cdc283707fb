"""The kernel against the plainest estimator of the same equation."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import z_limit

import renderer

WIDTH, HEIGHT = 16, 12


@pytest.mark.parametrize(("name", "depth"), [("cornell-box", 3), ("materials", 6), ("furnace", 4)])
def test_kernel_agrees_with_the_plain_estimator(name: str, depth: int, seed: int) -> None:
    from renderer.equation import oracle

    scene = renderer.load_scene(name, settings=renderer.Settings(WIDTH, HEIGHT, colour="rgb"))
    plain, plain_variance = oracle.render(scene.mitsuba_scene, scene.sensor, 1024, depth, seed % 2**20)
    settings = renderer.Settings(seed=seed, max_depth=depth, colour="rgb")
    estimate = renderer.render(scene, renderer.Target(spp=256), settings)
    variance = estimate.moments.variance_of_mean()[:, :3].sum(axis=0) + plain_variance.sum(axis=(0, 1))
    difference = estimate.mean.sum(axis=(0, 1)) - plain.sum(axis=(0, 1))
    rounding = 2e-6 * depth * np.abs(plain.sum(axis=(0, 1)))
    z = difference / np.sqrt(variance + rounding**2)
    assert np.all(np.abs(z) < z_limit(9)), f"z of R, G, B: {z}"
