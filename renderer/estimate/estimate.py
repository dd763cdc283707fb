"""An estimate: the moments of a whole image, with what they mean and where they came from."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderer.errors import MergeError, SettingsError
from renderer.estimate import interval
from renderer.estimate.health import Health, examine
from renderer.estimate.moments import Moments


@dataclass(frozen=True, slots=True)
class PixelReading:
    """One pixel. value: RGB radiance. standard_error: R, G, B, Y (None below two replicates). interval: 95 %, of Y."""

    x: int
    y: int
    value: tuple[float, float, float]
    luminance: float
    standard_error: tuple[float | None, float | None, float | None, float | None]
    interval: tuple[float, float] | None
    samples: int
    replicates: int
    trusted: bool


@dataclass(frozen=True, slots=True)
class Identity:
    """What an estimate is an estimate of. Two estimates merge when these agree.

    scene: content digest. settings: resolved settings without the seed. seed: of the random numbers.
    """

    scene: str
    scene_name: str
    settings: dict[str, Any]
    seed: int


@dataclass(frozen=True)
class Estimate:
    """Moments of a (height, width) image. Arrays are (H, W, …), row 0 at the top; radiance in linear sRGB primaries.

    ranges: (seed, replicates) pairs: for each seed, how many replicates at most a pixel holds, counted from 0.
    notes: warnings of the scene and what its technique cannot see, for `health`.
    planned: (n,) replicates of each pixel at the end of the round in progress; None where all pixels are served alike.
    channels: what was asked for beside radiance, by name: (H, W, 1) or (H, W, 3) float32.
    """

    width: int
    height: int
    replicate_size: int
    moments: Moments
    identity: Identity
    seconds: float = 0.0
    ranges: tuple[tuple[int, int], ...] = ((0, 0),)
    notes: dict[str, Any] = field(default_factory=dict)
    planned: NDArray[np.int64] | None = None
    channels: dict[str, NDArray[np.float32]] = field(default_factory=dict)

    def _shaped(self, array: NDArray) -> NDArray:
        return array.reshape(self.height, self.width, *array.shape[1:])

    @property
    def mean(self) -> NDArray[np.float64]:
        """(H, W, 3) radiance."""
        return self._shaped(self.moments.mean)

    @property
    def count(self) -> NDArray[np.int64]:
        """(H, W) replicates."""
        return self._shaped(self.moments.count)

    @property
    def stderr(self) -> NDArray[np.float64]:
        """(H, W, 4) standard error of the mean of R, G, B, Y; NaN where count < 2."""
        return self._shaped(np.sqrt(self.moments.variance_of_mean()))

    @cached_property
    def trust(self) -> NDArray[np.bool_]:
        """(H, W) whether the interval can be believed."""
        return self._shaped(interval.trust(self.moments, self.width))

    @property
    def invalid(self) -> NDArray[np.int64]:
        """(H, W) samples that were not finite."""
        return self._shaped(self.moments.invalid)

    @cached_property
    def health(self) -> Health:
        """What to know before believing the image."""
        return examine(self, self.notes.get("warnings", ()), self.notes.get("cannot_see", ()))

    @property
    def samples(self) -> int:
        """Camera paths traced."""
        return int(self.moments.tried.sum()) * self.replicate_size

    @property
    def spp(self) -> float:
        """Mean samples per pixel."""
        return self.samples / (self.width * self.height)

    def filled(self) -> NDArray[np.float32]:
        """(H, W, 3) radiance to look at: pixels without samples take the nearest coarser one that has some."""
        mean, has, stride = self.mean, self.count > 0, 1
        while not has[::stride, ::stride].all() and stride < max(self.width, self.height):
            stride *= 2
        image = mean[::stride, ::stride].astype(np.float32, order="C")
        while stride > 1:
            stride //= 2
            finer, known = mean[::stride, ::stride], has[::stride, ::stride]
            height, width = known.shape
            image = np.repeat(np.repeat(image, 2, axis=0), 2, axis=1)[:height, :width]
            for c in range(3):
                np.copyto(image[..., c], finer[..., c], where=known, casting="same_kind")
        return np.ascontiguousarray(image)

    def pixel(self, x: int, y: int) -> PixelReading:
        """Reads pixel column x, row y."""
        if not (0 <= x < self.width and 0 <= y < self.height):
            raise SettingsError(f"pixel ({x}, {y}) is outside the image of {self.width}×{self.height}")
        i = y * self.width + x
        one = self.moments.at(slice(i, i + 1))
        count, luminance = int(one.count[0]), float(one.luminance()[0])
        errors = np.sqrt(one.variance_of_mean()[0])
        width = float(interval.half_width(one)[0, 3])
        r, g, b = (float(v) for v in one.mean[0])
        er, eg, eb, ey = (float(e) if np.isfinite(e) else None for e in errors)
        return PixelReading(
            x=x,
            y=y,
            value=(r, g, b),
            luminance=luminance,
            standard_error=(er, eg, eb, ey),
            interval=(luminance - width, luminance + width) if count >= 2 else None,
            samples=count * self.replicate_size,
            replicates=count,
            trusted=bool(self.trust[y, x]),
        )

    def picture(self, exposure: float = 0.0) -> NDArray[np.uint8]:
        """(H, W, 3) sRGB bytes: clipped, never for measuring."""
        from renderer.image.picture import to_srgb8

        return to_srgb8(self.filled(), exposure)

    def write(self, path: str | Path, metadata: dict[str, Any] | None = None) -> None:
        """Writes the EXR, which is also the checkpoint: under a temporary name, then renamed."""
        from renderer.image.exr import write_estimate

        write_estimate(self, Path(path), metadata or {})

    @staticmethod
    def read(path: str | Path) -> Estimate:
        """Reads back what `write` wrote, bit for bit."""
        from renderer.image.exr import read_estimate

        return read_estimate(Path(path))


def merge(a: Estimate, b: Estimate) -> Estimate:
    """The estimate of both sets of replicates. Refuses other scenes, settings or overlapping replicates, by name."""
    if (a.width, a.height) != (b.width, b.height):
        raise MergeError(f"image sizes differ: {a.width}×{a.height} and {b.width}×{b.height}")
    if a.identity.scene != b.identity.scene:
        raise MergeError(f"scenes differ: {a.identity.scene_name} and {b.identity.scene_name} have other contents")
    if a.replicate_size != b.replicate_size:
        raise MergeError(f"replicate sizes differ: {a.replicate_size} and {b.replicate_size}")
    for key in sorted({*a.identity.settings, *b.identity.settings}):
        left, right = a.identity.settings.get(key), b.identity.settings.get(key)
        if left != right:
            raise MergeError(f"settings differ: {key} is {left} and {right}")
    for seed, last in a.ranges:
        for other_seed, other_last in b.ranges:
            if seed == other_seed and last and other_last:
                raise MergeError(f"replicates overlap: both hold seed {seed}; render one of them with another --seed")
    return Estimate(
        width=a.width,
        height=a.height,
        replicate_size=a.replicate_size,
        moments=a.moments.merge(b.moments),
        identity=a.identity,
        seconds=a.seconds + b.seconds,
        ranges=tuple(sorted({r for r in (*a.ranges, *b.ranges) if r[1]})) or a.ranges[:1],
        notes=a.notes,
        channels=b.channels | a.channels,
    )
