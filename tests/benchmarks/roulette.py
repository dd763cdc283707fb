"""What ending paths by windows of weights is worth, over ending them in proportion to their throughput.

    python -m tests.benchmarks.roulette [SCENE …]

Variance × time of a replicate without the worst hundredth of the pixels, where fireflies decide; the two kernels take
turns, and the fastest pass of each counts.
"""

from __future__ import annotations

import sys
import time
from typing import Any
from unittest.mock import patch

import numpy as np

import renderer
from renderer import plan
from renderer.backend import using
from renderer.equation import roulette
from renderer.equation.path import PathKernel
from renderer.estimate.error import floor_of
from tests.benchmarks import scenes

WIDTH, SIZE, TOGETHER, TURNS = 96, 16, 4, 6
SCENES = (
    *("cornell-box", "veach-ajar", "matpreview", "thinlens", "living-room", "sdf-instance", "room-manylights"),
    *("room-indirect", "caustic-ring", "gallery/materials", "gallery/plates", "gallery/many-lights", "gallery/gap"),
)


def by_throughput(carried: Any, typical: Any, depth: Any, rr_depth: Any, is_limited: Any) -> Any:
    """The customary rule: from `rr_depth` on, the throughput is the chance to go on."""
    import drjit as dr  # not before `renderer`, which knows where LLVM is

    most = dr.select(is_limited, 1, roulette.CEILING)
    return dr.select(depth >= rr_depth, dr.clip(carried, roulette.FLOOR, most), 1)


def compare(name: str) -> float:
    """Prints the figures of one scene; returns how many times better ours is."""
    scene = scenes.load(name, WIDTH)
    settings = scene.resolved(renderer.Settings(scene.width, scene.height), SIZE)
    model, camera, size = scene.model(settings), scene._camera(), (scene.width, scene.height)
    n = scene.width * scene.height
    pixels = np.repeat(plan._visits(*size), TOGETHER)
    lanes = np.tile(np.arange(TOGETHER, dtype=np.uint32), n)
    rules = {"windows": roulette.survival_probability, "throughput": by_throughput}
    with using(scene.variant):
        kernels = {who: PathKernel(scene.mitsuba_scene, camera, size, model) for who in rules}
    values: dict[str, list[Any]] = {who: [] for who in rules}
    seconds: dict[str, list[float]] = {who: [] for who in rules}
    for turn in range(TURNS + 1):
        for who, kernel in kernels.items():
            # All the time: a kernel may be traced again by a later pass.
            with patch.object(roulette, "survival_probability", rules[who]):
                began = time.perf_counter()
                radiance = np.array(kernel.launch(pixels, lanes + TOGETHER * turn, 1)[0], np.float64)
                if turn:  # the first one compiles
                    seconds[who].append(time.perf_counter() - began)
                    values[who].append(radiance.T.reshape(n, TOGETHER, 3))
    variance = {who: _variance(np.concatenate(some, axis=1)) for who, some in values.items()}
    times = {who: min(some) for who, some in seconds.items()}
    better = variance["throughput"] * times["throughput"] / (variance["windows"] * times["windows"])
    less, longer = variance["windows"] / variance["throughput"], times["windows"] / times["throughput"]
    print(f"{name:20} variance × {less:.2f}, time × {longer:.2f}: {better:.2f} times better", flush=True)
    return better


def _variance(values: Any) -> float:
    """Mean relative variance of (pixels, replicates, 3) values, without the worst hundredth of the pixels."""
    mean = values.mean(axis=1)
    each = np.sort(np.mean(values.var(axis=1, ddof=1) / (mean**2 + floor_of(mean)), axis=1))
    return float(each[: int(0.99 * len(each))].mean())


if __name__ == "__main__":
    with scenes.box_filters():
        found = [compare(asked) for asked in sys.argv[1:] or SCENES]
    print(f"geometric mean {np.exp(np.mean(np.log(found))):.2f}")
