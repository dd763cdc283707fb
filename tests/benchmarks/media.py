"""Scenes with media: squared error at equal processor time, against the better of Mitsuba's `volpath` and `volpathmis`.

    python -m tests.benchmarks.media [NAME …] [--width N] [--spp N] [--runs N]

NAME: of the gallery, or of a shared scene with "shared/" before it. Each image is rendered some times with different
seeds, with the scene's own film filter and the same number of samples; the variance between them, relative to the mean,
times the processor seconds of one is what an error costs. Where a few fireflies decide it says little.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import renderer
from renderer.backend import using
from renderer.scene.source import load_part

SHARED = Path(__file__).parents[3] / "shared" / "scenes"
DEFAULT = ("shared/vol-cbox", "shared/hetvol", "fog", "smoke", "cloudy-glass")
FLOOR = 1e-2  # of the image's mean, below which a pixel's error is not relative


def images(render: Callable[[int], NDArray], runs: int) -> tuple[float, NDArray[np.float64]]:
    """Processor seconds of one image, and (runs, H, W, channels) of them; what is compiled first, and
    loading, is not counted."""
    render(0)
    began = time.process_time()
    found = np.array([render(1 + run) for run in range(runs)], np.float64)
    return (time.process_time() - began) / runs, found


def compared(name: str, width: int, spp: int, runs: int) -> None:
    """Prints a line for each of Mitsuba's integrators."""
    source = SHARED / name.removeprefix("shared/") / "scene.xml" if name.startswith("shared/") else name

    scene = renderer.load_scene(source, settings=renderer.Settings(width=width))

    def ours(seed: int) -> NDArray:
        asked = renderer.Settings(width=width, seed=seed, replicate_size=16, adaptive=False)
        return renderer.render(scene, renderer.Target(spp=spp), asked).mean

    seconds, found = images(ours, runs)
    floored = (found.mean(0).mean(-1) + FLOOR * found.mean()) ** 2

    def cost(seconds: float, found: NDArray) -> float:
        return seconds * float((found.var(0, ddof=1).mean(-1) / floored).mean())

    needs = scene.requirements
    asked = {"max_depth": needs.max_depth, "rr_depth": needs.rr_depth, "hide_emitters": needs.hide_emitters}
    with using(scene.variant):
        for kind in ("volpath", "volpathmis"):
            integrator: Any = load_part(scene._parsed, {"type": kind, **asked})

            def theirs(seed: int, integrator: Any = integrator) -> NDArray:
                return np.array(integrator.render(scene.mitsuba_scene, scene.sensor, seed, spp))[..., :3]

            their_seconds, their_found = images(theirs, runs)
            print(
                f"{name} {kind}: {cost(their_seconds, their_found) / cost(seconds, found):.2f} times the cost of an "
                f"error, {their_seconds / seconds:.2f} times the processor time",
                flush=True,
            )


def main() -> None:
    """Compares the scenes asked for."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.media", description=__doc__)
    parser.add_argument("names", nargs="*", default=DEFAULT)
    parser.add_argument("--width", type=int, default=64)
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--runs", type=int, default=6)
    asked = parser.parse_args()
    for name in asked.names:
        compared(name, asked.width, asked.spp, asked.runs)


if __name__ == "__main__":
    main()
