"""What recording variances costs, as a share of the time of a pass that records the mean alone.

    python -m tests.benchmarks.recording [SCENE …]

Both fold the same rendered replicates, by turns; the median of several rounds is shown.
"""

from __future__ import annotations

import statistics
import sys
import time

import numpy as np
from numpy.typing import NDArray

import renderer
from renderer.estimate.moments import Moments

WIDTH, ROUNDS, REPLICATE_SIZE = 256, 9, 16
TOGETHER = 4  # replicates of a pixel in a pass, as an image of this size has them


def plain(total: NDArray[np.float64], count: NDArray[np.int64], radiance: NDArray[np.float32]) -> None:
    """Sums and counts, channel by channel."""
    for c in range(3):
        total[:, c] += radiance[:, c].reshape(-1, TOGETHER).sum(axis=1, dtype=np.float64)
    count += TOGETHER


def measure(name: str) -> tuple[float, float]:
    """(share of the time that recording adds, nanoseconds a lane)."""
    scene = renderer.load_scene(name, settings=renderer.Settings(width=WIDTH))
    n = scene.width * scene.height
    kernel = scene.kernel(scene.resolved(renderer.Settings(width=scene.width, height=scene.height), REPLICATE_SIZE))
    pixels, moments = np.arange(n, dtype=np.uint32), Moments.empty(n)
    total, count = np.zeros((n, 3), order="F"), np.zeros(n, np.int64)
    seconds: tuple[list[float], ...] = ([], [], [])
    for index in range(ROUNDS + 1):
        replicates = np.tile(np.arange(TOGETHER, dtype=np.uint32), n) + np.uint32(TOGETHER * index)
        began = time.perf_counter()
        lanes = kernel.launch(np.repeat(pixels, TOGETHER), replicates, 0)
        radiance, invalid, segments = np.array(lanes[0]).T, *map(np.array, lanes[1:])
        rendered = time.perf_counter()
        plain(total, count, radiance)
        summed = time.perf_counter()
        moments.add_runs(pixels, TOGETHER, radiance, invalid, REPLICATE_SIZE, segments)
        recorded = time.perf_counter()
        for kept, took in zip(seconds, (rendered - began, summed - rendered, recorded - summed), strict=True):
            kept.append(took)
    launch, sums, records = (statistics.median(s[1:]) for s in seconds)  # the first round compiled
    return (records - sums) / (launch + sums), records / (n * TOGETHER) * 1e9


if __name__ == "__main__":
    for asked in sys.argv[1:] or ("cornell-box", "glass-sky", "furnace"):
        share, lane = measure(asked)
        print(f"{asked:16s} recording variances adds {100 * share:.2f} % ({lane:.0f} ns a lane of {REPLICATE_SIZE})")
