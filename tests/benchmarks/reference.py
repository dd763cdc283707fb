"""Converged references with their own variance, kept between runs.

No reference is perfect: its own error adds to every error measured against it. Its variance is known, so what it adds
is known too, and is taken off.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import renderer
from renderer.errors import CheckpointError
from renderer.estimate.error import floor_of, rel_mse

FOLDER = Path(__file__).parents[1] / "output" / "references"
SEED = 2**40 + 17  # no benchmark renders with this one
SECONDS_AT_ONCE = 20.0
WORST = 0.01  # share of the pixels


@dataclass(frozen=True)
class Reference:
    """mean: (H, W, 3) radiance. variance: (H, W, 3) of the mean."""

    mean: NDArray[np.float64]
    variance: NDArray[np.float64]
    seconds: float

    @property
    def own_rel_mse(self) -> float:
        """What the reference's own error adds to a relMSE against it."""
        return float(np.mean(self.variance / (self.mean**2 + floor_of(self.mean))))

    def rel_mse(self, image: NDArray) -> float:
        """Relative squared error of an image, the reference's own part taken off."""
        return rel_mse(image, self.mean) - self.own_rel_mse

    def typical_rel_mse(self, image: NDArray) -> float:
        """The same without the worst hundredth of the pixels: fireflies come in a few runs of many, and one of them
        decides the mean over all."""
        scale = self.mean**2 + floor_of(self.mean)
        squared = np.mean((image - self.mean) ** 2 / scale, axis=-1).ravel()
        own = np.mean(self.variance / scale, axis=-1).ravel()
        kept = np.argsort(squared)[: max(1, round((1 - WORST) * len(squared)))]
        return float(np.mean(squared[kept] - own[kept]))


def converged(scene: renderer.Scene, seconds: float, keep: bool = True) -> Reference:
    """A reference of at least `seconds` of render time, read from the cache as far as it is there."""
    path = FOLDER / f"{scene.name}-{scene.digest[:12]}-{scene.width}x{scene.height}.exr"
    estimate = _read(path) if keep else None
    settings = renderer.Settings(scene.width, scene.height, SEED)
    while estimate is None or estimate.seconds < seconds:
        spent = 0.0 if estimate is None else estimate.seconds
        target = renderer.Target(seconds=min(seconds, spent + SECONDS_AT_ONCE))
        try:
            estimate = renderer.render(scene, target, settings, start=estimate)
        except CheckpointError:  # made by other settings than today's
            estimate = None
            continue
        if keep:
            FOLDER.mkdir(parents=True, exist_ok=True)
            estimate.write(path)
    return Reference(estimate.mean, estimate.stderr[..., :3] ** 2, estimate.seconds)


def _read(path: Path) -> renderer.Estimate | None:
    try:
        return renderer.Estimate.read(path) if path.is_file() else None
    except CheckpointError:
        return None
