"""Adaptive sampling must not move the mean: neither of skewed noise nor of light that is hardly ever found.

Many independent runs through the real plan, with replicates by NumPy instead of by rendering, so that the truth is
known. Where counts follow from a pixel's own values the mean is too low: the last test shows that this is caught.
"""

from __future__ import annotations

import math
from unittest.mock import patch

import numpy as np
import pytest
from numpy.typing import NDArray

import renderer
from renderer import allocation
from renderer.estimate.moments import Moments
from renderer.scene.compile import Scene
from tests.stand_ins import Begins
from tests.statistical.conftest import z_limit

WIDTH, HEIGHT, SIZE = 24, 20, 16
N = WIDTH * HEIGHT


class FlashKernel(Begins):
    """Radiance 1 with some noise; in the right half also a light of mean 1 that a sample finds with probability p."""

    def __init__(self, probability: float) -> None:
        self.probability = probability

    def launch(self, pixels: NDArray, replicates: NDArray, seed: int) -> tuple[NDArray, ...]:
        rng = np.random.default_rng([seed, int(replicates[0]), len(pixels), int(pixels[0]), int(pixels[-1])])
        hits = rng.binomial(SIZE, self.probability, len(pixels)) / (SIZE * self.probability)
        value = rng.gamma(4.0, 0.25, len(pixels)) + hits * (pixels % WIDTH >= WIDTH // 2)
        segments = SIZE + rng.binomial(8 * SIZE, 0.5, len(pixels)) + (hits * SIZE * self.probability).astype(np.int64)
        return np.repeat(value.astype(np.float32)[None], 3, axis=0), np.zeros(len(pixels), np.uint32), segments


@pytest.fixture(scope="module")
def scene() -> Scene:
    """Any scene of the right size: the kernel that would render it is replaced."""
    film = {"type": "hdrfilm", "width": WIDTH, "height": HEIGHT, "rfilter": {"type": "box"}}
    integrator = {"type": "path", "max_depth": 4}
    sensor = {"type": "perspective", "film": film}
    return renderer.load_scene(
        {"type": "scene", "integrator": integrator, "sensor": sensor, "sky": {"type": "constant"}}
    )


def means(scene: Scene, probability: float, replicates: int, runs: int, seed: int) -> NDArray[np.float64]:
    """(runs, 2) mean radiance of the left and of the right half of each run's image."""
    found = np.empty((runs, 2))
    with patch.object(Scene, "kernel", lambda self, settings: FlashKernel(probability)):
        for run in range(runs):
            settings = renderer.Settings(replicate_size=SIZE, seed=seed + run)
            image = renderer.render(scene, renderer.Target(spp=replicates * SIZE), settings).mean[..., 0]
            found[run] = image[:, : WIDTH // 2].mean(), image[:, WIDTH // 2 :].mean()
    return found


def z_of(found: NDArray[np.float64], truth: float) -> float:
    return float((found.mean() - truth) / (found.std(ddof=1) / math.sqrt(len(found))))


@pytest.mark.parametrize(("probability", "replicates"), [(0.05, 12), (1e-3, 20), (1e-4, 20)])
def test_adaptive_sampling_keeps_the_energy(scene: Scene, probability: float, replicates: int, seed: int) -> None:
    found = means(scene, probability, replicates, 60, seed)
    for half, truth in enumerate((1.0, 2.0)):
        assert abs(z_of(found[:, half], truth)) < z_limit(6), (half, found[:, half].mean())


@pytest.mark.slow
@pytest.mark.parametrize(("probability", "replicates"), [(0.05, 12), (0.01, 24), (1e-3, 40), (1e-4, 40)])
def test_adaptive_sampling_keeps_the_energy_in_many_runs(
    scene: Scene, probability: float, replicates: int, seed: int
) -> None:
    found = means(scene, probability, replicates, 1500, seed)
    for half, truth in enumerate((1.0, 2.0)):
        assert abs(z_of(found[:, half], truth)) < z_limit(8), (half, found[:, half].mean())


def test_counts_that_follow_a_pixels_own_values_are_caught(
    scene: Scene, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def greedy(moments: Moments, width: int, height: int, *rest: object) -> NDArray[np.int64]:
        own = moments.variance()[:, 3]
        return moments.tried + np.where(own >= np.quantile(own, 0.8), 4, 0)

    monkeypatch.setattr(allocation, "next_counts", greedy)
    found = means(scene, 0.01, 12, 100, seed)
    assert z_of(found[:, 1], 2.0) < -z_limit()
