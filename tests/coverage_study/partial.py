"""What is said of pictures that a time budget ends, against the truth: several sizes, alone and beside other renders.

The truth is the picture's distance from a long render of the same size, whose own noise is taken out.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

import renderer
from renderer.estimate.error import pixel_rel_mse, rel_mse
from renderer.settings import Settings, Target
from tests.coverage_study.bank import source_of

LOW, HIGH = 0.8, 1.25  # of the truth, that what is said may be
BESIDE = 3  # other renders
REFERENCE_SEED = 77
REFERENCE_SPP = 1024
SIZES = ((256, 256), (512, 512), (1920, 1080))
BUDGETS = {256: (0.3, 1.0, 3.0, 10.0), 512: (0.3, 2.0, 10.0), 1920: (1.0, 10.0)}  # seconds, by width
OTHER = (
    "import renderer\n"
    "for seed in range(10**6):\n"
    "    renderer.render('cornell-box', renderer.Target(spp=64), renderer.Settings(seed=seed))\n"
)


@dataclass(frozen=True)
class Partial:
    """One picture. two: share of its pixels with two replicates. said: None where nothing is; unknown: why."""

    seconds: float
    spp: float
    size: int
    two: float
    said: float | None
    true: float
    unknown: str | None

    @property
    def ratio(self) -> float | None:
        """Said over true."""
        return None if self.said is None else self.said / self.true

    @property
    def is_off(self) -> bool:
        """Whether what is said is not the picture's."""
        return self.ratio is not None and not LOW <= self.ratio <= HIGH


@contextmanager
def beside(n: int) -> Iterator[None]:
    """Inside, n other processes render on the same machine."""
    others = [subprocess.Popen([sys.executable, "-c", OTHER]) for _ in range(n)]
    try:
        yield
    finally:
        for other in others:
            other.kill()
            other.wait()


@dataclass(frozen=True)
class Reference:
    """A converged image, or nearly so. noise: relative squared error that it has itself."""

    image: np.ndarray
    noise: float


def reference_of(scene: renderer.Scene, seconds: float) -> Reference:
    """The mean of a render of another seed, REFERENCE_SPP or `seconds` long, and two replicates at least."""
    settings = Settings(scene.width, scene.height, REFERENCE_SEED, replicate_size=8, adaptive=False)
    two = renderer.render(scene, Target(spp=16), settings)
    found = renderer.render(scene, Target(spp=REFERENCE_SPP, seconds=seconds), settings, start=two)
    return Reference(found.mean, float(np.nanmean(pixel_rel_mse(found.moments))))


def sized(name: str, width: int, height: int) -> renderer.Scene:
    """A scene of this size, its kernels compiled."""
    scene = renderer.load_scene(source_of(name), settings=Settings(width, height))
    renderer.render(scene, Target(spp=1), Settings(width, height))
    return scene


def measure(scene: renderer.Scene, reference: Reference, seconds: float, seed: int) -> Partial:
    """One render of so many seconds."""
    *_, last = renderer.progressive(scene, Target(seconds=seconds), Settings(scene.width, scene.height, seed))
    true = rel_mse(last.estimate.filled(), reference.image) - reference.noise
    return Partial(
        seconds=seconds,
        spp=last.spp,
        size=last.estimate.replicate_size,
        two=float((last.estimate.count >= 2).mean()),
        said=last.error,
        true=float(np.sqrt(max(true, 1e-12))),
        unknown=last.unknown,
    )
