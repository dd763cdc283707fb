"""What choosing lights by the place is worth over choosing them by their power, and over Mitsuba's `path`.

    python -m tests.benchmarks.light_choice [SCENE …]

Variances of a replicate at equal samples; squared errors at 64 samples times processor seconds, which other work on the
machine disturbs less than it does a clock.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import renderer
from renderer.backend import using
from renderer.equation.path import PathKernel
from renderer.estimate.error import floor_of
from tests.benchmarks import scenes
from tests.benchmarks.peer import Peer
from tests.benchmarks.reference import converged

WIDTH, SIZE, REPLICATES, TURNS = 128, 16, 4, 4
SAMPLERS = ("independent", "multijitter")


def compare(name: str) -> None:
    """Prints the figures of one scene."""
    scene = scenes.load(name, WIDTH)
    reference = converged(scene, 20.0)
    settings = scene.resolved(renderer.Settings(scene.width, scene.height), SIZE)
    camera, size = scene._camera(), (scene.width, scene.height)
    kernels = {}
    with using(scene.variant):
        for who, surveys in (("power", False), ("place", True)):
            model = replace(scene.model(settings), surveys_lights=surveys)
            kernels[who] = PathKernel(scene.mitsuba_scene, camera, size, model)
    peers = {sampler: Peer(scenes.load(name, WIDTH, "rgb"), sampler) for sampler in SAMPLERS}
    cost: dict[str, list[float]] = {who: [] for who in (*kernels, *peers)}
    variance: dict[str, list[float]] = {who: [] for who in kernels}
    for turn in range(TURNS + 1):
        for who, kernel in kernels.items():
            began = time.process_time()
            runs = _replicates(kernel, scene, turn)
            took = time.process_time() - began
            image = runs.mean(axis=0).reshape(scene.height, scene.width, 3)
            if turn:  # the first one compiles
                cost[who].append(reference.rel_mse(image) * took)
                scale = np.square(reference.mean.reshape(-1, 3)) + floor_of(reference.mean)
                variance[who].append(float((runs.var(axis=0, ddof=1) / scale).mean()))
        for who, peer in peers.items():
            began = time.process_time()
            image, _, _ = peer.render(SIZE * REPLICATES, turn)
            if turn:
                cost[who].append(reference.rel_mse(image) * (time.process_time() - began))
    mean = {who: float(np.mean(values)) for who, values in cost.items()}
    print(f"{name}: variance by power {np.mean(variance['power']):.4f}, by place {np.mean(variance['place']):.4f}")
    for who in ("power", *SAMPLERS):
        print(f"  squared error at equal processor time, {who} over place: {mean[who] / mean['place']:.1f}")


def _replicates(kernel: Any, scene: renderer.Scene, seed: int) -> NDArray[np.float64]:
    """(REPLICATES, pixels, 3) radiance."""
    n = scene.width * scene.height
    pixels = np.tile(np.arange(n, dtype=np.uint32), REPLICATES)
    lanes = np.repeat(np.arange(REPLICATES, dtype=np.uint32), n)
    return np.array(kernel.launch(pixels, lanes, seed)[0], np.float64).T.reshape(REPLICATES, n, 3)


if __name__ == "__main__":
    scenes.use_box_filters()
    for asked in sys.argv[1:] or ("room-manylights", "gallery/many-lights"):
        compare(asked)
