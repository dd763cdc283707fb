"""A bank of replicates: a population with a known mean, from which any number of independent runs draw.

A scene's replicates are rendered once, in large passes. A run's replicate (seed, pixel, index) is one of the pixel's,
chosen by hashing: replicates of a run are independent, runs are independent, and the truth is the mean of the bank,
exactly. `BankKernel` stands in for the path kernel, so that a studied run goes through the real plan, moments, trust
and stop rule. What a bank of n replicates cannot show is light that a pixel finds less than once in n replicates.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import renderer
from renderer.settings import Settings
from tests.coverage_study import rare_light
from tests.stand_ins import Begins

SHARED = Path(__file__).parents[3] / "shared" / "scenes"
LANES = 2**18  # of one launch
SIZE = 16
SEED = 1


@dataclass(frozen=True)
class Bank:
    """values: (replicates, pixels, 3) float32 replicate means of the scene's image. segments: (pixels,) mean number of
    path segments of a replicate, rounded.
    """

    name: str
    scene: renderer.Scene
    values: NDArray[np.float32]
    settings: Settings
    segments: NDArray[np.int64]
    mean: NDArray[np.float64] = field(init=False)
    variance: NDArray[np.float64] = field(init=False)

    def __post_init__(self) -> None:
        """mean, variance: (pixels, 3) of the population."""
        object.__setattr__(self, "mean", self.values.mean(axis=0, dtype=np.float64))
        object.__setattr__(self, "variance", self.values.var(axis=0, dtype=np.float64))


class BankKernel(Begins):
    """Deals replicates from a bank in place of rendering them."""

    def __init__(self, bank: Bank) -> None:
        self.values, self.segments = bank.values, bank.segments

    def launch(self, pixels: NDArray, replicates: NDArray, seed: int) -> tuple[NDArray, NDArray, NDArray]:
        """Radiance (3, n), invalid (n,) and segments (n,) of lanes."""
        pixels = np.asarray(pixels, np.uint64)
        index = _mixed(
            _mixed(np.uint64(seed) + pixels * np.uint64(0x9E3779B97F4A7C15)) + np.asarray(replicates, np.uint64)
        )
        chosen = (index % np.uint64(len(self.values))).astype(np.int64)
        where = pixels.astype(np.int64)
        return self.values[chosen, where].T, np.zeros(len(pixels), np.uint32), self.segments[where]


def _mixed(x: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Steele's 64-bit finaliser (SplitMix64)."""
    with np.errstate(over="ignore"):
        x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


def source_of(name: str) -> str | Path | dict[str, Any]:
    """A rare-light scene, one of the gallery, or, with "shared/" before it, a shared one."""
    if name.startswith("shared/"):
        return SHARED / name.removeprefix("shared/") / "scene.xml"
    return rare_light.scenes()[name] if name in rare_light.NAMES else name


def is_there(name: str) -> bool:
    """Whether the scene can be rendered here: the shared ones lie beside the checkout, or not."""
    source = source_of(name) if name not in rare_light.NAMES else None
    return not isinstance(source, Path) or source.is_file()


def fill(name: str, pixels: int, replicates: int, size: int = SIZE) -> Bank:
    """Renders a bank of about `pixels` pixels, in the scene's own aspect. size: samples in a replicate."""
    scene = renderer.load_scene(source_of(name))
    width = max(1, round((pixels * scene.width / scene.height) ** 0.5))
    height = max(1, round(width * scene.height / scene.width))
    settings = Settings(width, height, technique="bsdf" if name in rare_light.NAMES else "mis", replicate_size=size)
    scene = scene.sized(settings)
    kernel = scene.kernel(scene.resolved(settings, size))
    n = scene.width * scene.height
    values, segments = np.empty((replicates, n, 3), np.float32), np.zeros(n, np.int64)
    step = max(1, LANES // n)
    every = np.arange(n, dtype=np.uint32)
    for first in range(0, replicates, step):
        some = np.arange(first, min(first + step, replicates), dtype=np.uint32)
        lanes = kernel.launch(np.tile(every, len(some)), np.repeat(some, n), SEED)
        radiance = np.array(lanes[0])
        segments += np.array(lanes[2]).reshape(len(some), n).sum(axis=0, dtype=np.int64)
        values[some] = np.broadcast_to(radiance, (3, radiance.shape[-1])).T.reshape(len(some), n, 3)
    return Bank(name, scene, values, settings, segments // replicates)
