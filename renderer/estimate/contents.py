"""What an estimate holds: the moments of a whole image, with what they mean and where they came from."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderer.audit.missing import missing_of
from renderer.audit.value import Audit, sentences
from renderer.errors import SettingsError
from renderer.estimate import interval
from renderer.estimate.blocks import Held
from renderer.estimate.correlation import Correlation
from renderer.estimate.error import ImageError, Missing, image_error
from renderer.estimate.forecast import Curve
from renderer.estimate.health import Health, Known, examine
from renderer.estimate.moments import Moments
from renderer.image.picture import to_srgb8, with_alpha


@dataclass(frozen=True, slots=True)
class PixelReading:
    """One pixel. value: RGB radiance. standard_error: R, G, B, Y, None where not known. interval: 95 %, of Y."""

    x: int
    y: int
    value: tuple[float, float, float]
    luminance: float
    standard_error: tuple[float | None, float | None, float | None, float | None]
    interval: tuple[float, float] | None
    samples: int
    replicates: int
    trusted: bool


# As it was before others could be chosen.
_UNNAMED = {"sensor": 0, "independent_pixels": True, "guide": "off"}


@dataclass(frozen=True, slots=True)
class Identity:
    """What an estimate is an estimate of. Two estimates merge when these agree.

    scene: content digest. settings: resolved settings without the seed. seed: of the random numbers. made_with:
    versions and kinds of device that rendered it. Several still make one estimate, but no straight run need give its
    bits: its health says so.
    """

    scene: str
    scene_name: str
    settings: dict[str, Any]
    seed: int
    made_with: tuple[str, ...] = ()

    def also_with(self, other: Identity) -> Identity:
        """The same question, answered by what made either."""
        return replace(self, made_with=tuple(sorted({*self.made_with, *other.made_with})))

    def setting(self, key: str) -> Any:
        """One of the settings, as older files that do not name it mean it."""
        return self.settings.get(key, _UNNAMED.get(key))

    @property
    def correlation(self) -> Correlation:
        """Of neighbouring pixels."""
        return Correlation(*self.settings.get("correlation", ()))


@dataclass(frozen=True)
class Contents:
    """What an estimate holds: moments of a (height, width) image, with what they mean and where they came from. Arrays
    are (H, W, …), row 0 at the top; radiance in linear sRGB primaries.

    ranges: (seed, replicates) pairs: for each seed, how many replicates at most a pixel holds, counted from 0.
    notes: warnings of the scene and what its technique cannot see, for `health`.
    planned: (n,) replicates of each pixel at the end of the round in progress; None where all pixels are served alike.
    curve: error over the time so far.
    channels: what was asked for beside radiance, by name: (H, W, 1) or (H, W, 3) float32.
    look: (n, 3) what stands for pixels without samples in a first picture, NaN where nothing does; not saved.
    audit: what paths from the lights say about light that samples hardly meet; None where there can be none, or where
    nobody looked: no error was asked for, and it was rendered within seconds.
    held: of a part of a render (`renderer.passes`) that waits for earlier replicates, what `moments` were made of.
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
    curve: Curve = field(default_factory=Curve)
    channels: dict[str, NDArray[np.float32]] = field(default_factory=dict)
    look: NDArray[np.float32] | None = None
    audit: Audit | None = None
    held: Held | None = None

    def _shaped(self, array: NDArray) -> NDArray:
        return array.reshape(self.height, self.width, *array.shape[1:])

    @property
    def mean(self) -> NDArray[np.float64]:
        """(H, W, 3) radiance; 0 in pixels without a finite sample, where the picture (`filled`) shows a neighbour's.

        Whenever the image error is said, every pixel has a sample, and both are the same but for lost pixels.
        """
        return self._shaped(self.moments.mean)

    @property
    def count(self) -> NDArray[np.int64]:
        """(H, W) replicates."""
        return self._shaped(self.moments.count)

    @property
    def stderr(self) -> NDArray[np.float64]:
        """(H, W, 4) standard error of the mean of R, G, B, Y; NaN where it is not known: below two replicates, and
        where nothing was found by samples that cannot be trusted (`interval.standard_error`). Sums over pixels, for the
        error of a mean over many, are of `moments.variance_of_mean()`, where what found nothing counts as it should.
        """
        return self._shaped(interval.standard_error(self.moments, self.trust.ravel()))

    @property
    def stokes(self) -> NDArray[np.float64] | None:
        """(H, W, 4, 3) S0 to S3 in R, G, B, in the frame of the sensor (S1 is positive where light swings along the
        horizontal of the picture); 0 in pixels without a finite sample. None where light is not polarised.
        """
        if not self.moments.has_stokes:
            return None
        values = np.concatenate([self.moments.mean, self.moments.stokes], axis=1)
        return self._shaped(values.reshape(-1, 4, 3))

    @property
    def stokes_stderr(self) -> NDArray[np.float64] | None:
        """(H, W, 4, 3) their standard errors; NaN where they are not known."""
        if not self.moments.has_stokes:
            return None
        m, trusted = self.moments, self.trust.ravel()
        errors = interval.standard_error(m, trusted)[:, :3], interval.stokes_standard_error(m, trusted)
        return self._shaped(np.concatenate(errors, axis=1).reshape(-1, 4, 3))

    @cached_property
    def trust(self) -> NDArray[np.bool_]:
        """(H, W) whether the interval can be believed."""
        trusted = interval.trust(self.moments, self.width, self.identity.correlation)
        doubted = self.missing.doubted
        return self._shaped(trusted if doubted is None else trusted & ~doubted)

    @cached_property
    def image_error(self) -> ImageError:
        """The error of the whole picture, with the bound that holds with 95 %, or why it is not known."""
        return image_error(self.moments, self.width, missing=self.missing, correlation=self.identity.correlation)

    @cached_property
    def missing(self) -> Missing:
        """Light that no sample has met, as the audit says."""
        return missing_of(self.audit, self.moments, self.replicate_size)

    @property
    def invalid(self) -> NDArray[np.int64]:
        """(H, W) samples that were not finite."""
        return self._shaped(self.moments.invalid)

    @cached_property
    def health(self) -> Health:
        """What to know before believing the image."""
        known = Known(
            warnings=tuple(self.notes.get("warnings", ())),
            cannot_see=tuple(self.notes.get("cannot_see", ())),
            hidden=self._hidden(),
            made_with=self.identity.made_with,
        )
        return examine(self.moments, self.trust, self.replicate_size, known)

    def _hidden(self) -> tuple[str, ...]:
        if self.audit is None:
            return ()
        return sentences(self.audit, float(self.moments.luminance().mean()), self.spp)

    @property
    def samples(self) -> int:
        """Camera paths traced."""
        return int(self.moments.tried.sum()) * self.replicate_size

    @property
    def spp(self) -> float:
        """Mean samples per pixel."""
        return self.samples / (self.width * self.height)

    def filled(self) -> NDArray[np.float32]:
        """(H, W, 3) radiance of the picture, as files, frames and the page show it: pixels without samples take the
        nearest coarser one that has some.
        """
        mean, has = self.mean, self.count > 0
        if self.look is not None:
            look = self._shaped(self.look)
            mean = np.where(has[..., None], mean, look)
            has = has | np.isfinite(look[..., 0])
        return self._filled(mean, has)

    def filled_stokes(self) -> NDArray[np.float32]:
        """(H, W, 12) R, G, B of S0 to S3 as files show them; S0 is `filled`. (H, W, 0) where light is not polarised."""
        if not self.moments.has_stokes:
            return np.zeros((self.height, self.width, 0), np.float32)
        more = self._filled(self._shaped(self.moments.stokes), self.count > 0)
        return np.concatenate([self.filled(), more], axis=-1)

    def _filled(self, mean: NDArray[np.float64], has: NDArray[np.bool_]) -> NDArray[np.float32]:
        stride = 1
        while not has[::stride, ::stride].all() and stride < max(self.width, self.height):
            stride *= 2
        image = mean[::stride, ::stride].astype(np.float32, order="C")
        while stride > 1:
            stride //= 2
            finer, known = mean[::stride, ::stride], has[::stride, ::stride]
            height, width = known.shape
            image = np.repeat(np.repeat(image, 2, axis=0), 2, axis=1)[:height, :width]
            for c in range(image.shape[-1]):
                np.copyto(image[..., c], finer[..., c], where=known, casting="same_kind")
        return np.ascontiguousarray(image)

    def pixel(self, x: int, y: int) -> PixelReading:
        """Reads pixel column x, row y."""
        if not (0 <= x < self.width and 0 <= y < self.height):
            raise SettingsError(f"pixel ({x}, {y}) is outside the image of {self.width}×{self.height}")
        i = y * self.width + x
        one = self.moments.at(slice(i, i + 1))
        count, luminance = int(one.count[0]), float(one.luminance()[0])
        errors = interval.standard_error(one, self.trust[y, x : x + 1])[0]
        width = float(errors[3] * interval.t_quantile(0.975, max(count - 1, 1)))
        r, g, b = (float(v) for v in one.mean[0])
        er, eg, eb, ey = (float(e) if np.isfinite(e) else None for e in errors)
        return PixelReading(
            x=x,
            y=y,
            value=(r, g, b),
            luminance=luminance,
            standard_error=(er, eg, eb, ey),
            interval=(luminance - width, luminance + width) if np.isfinite(width) else None,
            samples=count * self.replicate_size,
            replicates=count,
            trusted=bool(self.trust[y, x]),
        )

    def picture(self, exposure: float = 0.0) -> NDArray[np.uint8]:
        """(H, W, 3) sRGB bytes, (H, W, 4) with alpha where there is that channel: clipped, never for measuring."""
        if "alpha" in self.channels:
            return with_alpha(self.filled(), self.channels["alpha"], exposure)
        return to_srgb8(self.filled(), exposure)
