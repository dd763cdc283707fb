"""What our choice of lights is worth: the default, beside lights chosen by power alone, an environment map sampled by
its plugin, and Mitsuba's `path`.

    python -m tests.benchmarks.light_choice [SCENE …]

Variances of a replicate at equal samples, of the image and of the pixel at the median; squared errors at 64 samples
times processor seconds, which other work on the machine disturbs less than it does a clock.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from typing import Any
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

import renderer
from renderer.backend import using
from renderer.equation.lights.environment_map import EnvironmentMap
from renderer.equation.path import PathKernel
from renderer.estimate.error import floor_of
from tests.benchmarks import scenes
from tests.benchmarks.peer import Peer
from tests.benchmarks.reference import converged

WIDTH, SIZE, REPLICATES, TURNS = 128, 16, 4, 4
SCENES = (
    *("room-manylights", "gallery/many-lights", "sdf-instance", "thinlens", "matpreview", "living-room"),
    *("pool", "gallery/ring-sky", "gallery/glass-sky"),
)
SAMPLERS = ("independent", "multijitter")


def compare(name: str) -> None:
    """Prints the figures of one scene."""
    scene = scenes.load(name, WIDTH)
    reference = converged(scene, 20.0)
    settings = scene.resolved(renderer.Settings(scene.width, scene.height), SIZE)
    camera, size = scene._camera(), (scene.width, scene.height)
    kernels = {}
    model = scene.model(settings)
    with using(scene.variant):
        kernels["default"] = PathKernel(scene.mitsuba_scene, camera, size, model)
        if kernels["default"].emitters.knows_places:
            kernels["by power"] = PathKernel(scene.mitsuba_scene, camera, size, replace(model, surveys_lights=False))
        if kernels["default"].emitters.sky is not None:
            with patch.object(EnvironmentMap, "of", lambda *_: None):
                kernels["by plugin"] = PathKernel(scene.mitsuba_scene, camera, size, model)
    peers = {sampler: Peer(scenes.load(name, WIDTH, "rgb"), sampler) for sampler in SAMPLERS}
    cost: dict[str, list[float]] = {who: [] for who in (*kernels, *peers)}
    variance: dict[str, list[NDArray[np.float64]]] = {who: [] for who in kernels}
    for turn in range(TURNS + 1):
        for who, kernel in kernels.items():
            began = time.process_time()
            runs = _replicates(kernel, scene, turn)
            took = time.process_time() - began
            image = runs.mean(axis=0).reshape(scene.height, scene.width, 3)
            if turn:  # the first one compiles
                cost[who].append(reference.rel_mse(image) * took)
                scale = np.square(reference.mean.reshape(-1, 3)) + floor_of(reference.mean)
                variance[who].append((runs.var(axis=0, ddof=1) / scale).mean(axis=-1))
        for who, peer in peers.items():
            began = time.process_time()
            image, _, _ = peer.render(SIZE * REPLICATES, turn)
            if turn:
                cost[who].append(reference.rel_mse(image) * (time.process_time() - began))
    mean = {who: float(np.mean(values)) for who, values in cost.items()}
    print(f"{name}, variance of a replicate, image and median pixel:")
    for who, some in variance.items():
        pixels = np.mean(some, axis=0)
        print(f"  {who:10} {pixels.mean():.4f} {np.median(pixels):.4f}")
    for who in cost:
        if who != "default":
            print(f"  squared error at equal processor time, {who} over default: {mean[who] / mean['default']:.1f}")


def _replicates(kernel: Any, scene: renderer.Scene, seed: int) -> NDArray[np.float64]:
    """(REPLICATES, pixels, 3) radiance."""
    n = scene.width * scene.height
    pixels = np.tile(np.arange(n, dtype=np.uint32), REPLICATES)
    lanes = np.repeat(np.arange(REPLICATES, dtype=np.uint32), n)
    return np.array(kernel.launch(pixels, lanes, seed)[0], np.float64).T.reshape(REPLICATES, n, 3)


if __name__ == "__main__":
    with scenes.box_filters():
        for asked in sys.argv[1:] or SCENES:
            compare(asked)
