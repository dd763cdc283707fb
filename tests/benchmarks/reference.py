"""Converged references with their own variance, kept between runs.

No reference is perfect: its own error adds to every error measured against it. Its variance is known, so what it adds
is known too, and is taken off.
"""

from __future__ import annotations

import math
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
    """mean: (H, W, 3) radiance. variance: (H, W, 3) of the mean. border: pixels on each side that do not count: there
    Mitsuba gives the samples within the image more weight, where a wide filter would have some from outside.
    """

    mean: NDArray[np.float64]
    variance: NDArray[np.float64]
    seconds: float
    border: int = 0

    def _inner(self, image: NDArray) -> NDArray:
        b = self.border
        return image[b : image.shape[0] - b, b : image.shape[1] - b]

    @property
    def own_rel_mse(self) -> float:
        """What the reference's own error adds to a relMSE against it."""
        mean = self._inner(self.mean)
        return float(np.mean(self._inner(self.variance) / (mean**2 + floor_of(mean))))

    def rel_mse(self, image: NDArray) -> float:
        """Relative squared error of an image, the reference's own part taken off."""
        return rel_mse(self._inner(image), self._inner(self.mean)) - self.own_rel_mse

    def typical_rel_mse(self, image: NDArray) -> float:
        """The same without the worst hundredth of the pixels: fireflies come in a few runs of many, and one of them
        decides the mean over all."""
        mean = self._inner(self.mean)
        scale = mean**2 + floor_of(mean)
        squared = np.mean((self._inner(image) - mean) ** 2 / scale, axis=-1).ravel()
        own = np.mean(self._inner(self.variance) / scale, axis=-1).ravel()
        kept = np.argsort(squared)[: max(1, round((1 - WORST) * len(squared)))]
        return float(np.mean(squared[kept] - own[kept]))


def converged(scene: renderer.Scene, seconds: float, keep: bool = True) -> Reference:
    """A reference of at least `seconds` of render time, read from the cache as far as it is there."""
    rfilter = scene.sensor.film().rfilter()
    kind = "box" if rfilter.is_box_filter() else "own"
    path = FOLDER / f"{scene.name}-{scene.digest[:12]}-{kind}-{scene.width}x{scene.height}.exr"
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
    border = 0 if kind == "box" else math.ceil(float(rfilter.radius()) - 0.5)
    variance = estimate.moments.variance_of_mean()[:, :3].reshape(estimate.mean.shape)
    return Reference(estimate.mean, variance, estimate.seconds, border)


def _read(path: Path) -> renderer.Estimate | None:
    try:
        return renderer.Estimate.read(path) if path.is_file() else None
    except CheckpointError:
        return None
