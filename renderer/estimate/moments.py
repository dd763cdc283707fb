"""Per-pixel moments of replicates: a value that merges.

Enters: replicate means (float32 radiance, a short sum each). Leaves: count, mean and m2 per pixel in float64, plus what
trust needs (how many replicates were not black, how bright the brightest was). Pixels are in row-major order.
A pixel's replicates are added one by one in index order, so neither pass size nor timing changes a bit of the result.
Sources: Welford 1962 (add), Chan, Golub & LeVeque 1979 (merge).
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # Rec. 709 / sRGB primaries


@dataclass(slots=True)
class Moments:
    """Moments of n pixels.

    count: (n,) int64 replicates. mean: (n, 3) radiance, RGB. m2: (n, 4) sum of squared deviations of R, G, B and Y;
    luminance has its own because channels are correlated. nonzero: (n,) int64 replicates that were not black.
    largest: (n,) luminance of the brightest replicate. invalid: (n,) int64 samples that were not finite.
    tried: (n,) int64 replicates that were rendered; more than count where all samples of one were not finite.
    """

    count: NDArray[np.int64]
    mean: Array
    m2: Array
    nonzero: NDArray[np.int64]
    largest: Array
    invalid: NDArray[np.int64]
    tried: NDArray[np.int64]

    @classmethod
    def empty(cls, n: int) -> Moments:
        """Moments of n pixels without any replicate."""
        whole = lambda: np.zeros(n, np.int64)  # noqa: E731
        return cls(whole(), np.zeros((n, 3)), np.zeros((n, 4)), whole(), np.zeros(n), whole(), whole())

    def copy(self) -> Moments:
        """An independent copy."""
        return Moments(*(getattr(self, f.name).copy() for f in fields(self)))

    def add(
        self, pixels: NDArray[np.integer] | slice, radiance: NDArray, invalid: NDArray, replicate_size: int
    ) -> None:
        """Adds one replicate to each of `pixels` (distinct).

        radiance: (k, 3) replicate means. invalid: (k,) samples of each that were not finite; a replicate of which no
        sample was finite counts as invalid samples only.
        """
        self.tried[pixels] += 1
        bad = invalid > 0
        if bad.any():
            self.invalid[pixels] += invalid
            lost = invalid >= replicate_size
            if lost.any():
                kept = np.flatnonzero(~lost)
                pixels = np.arange(len(self.count))[pixels][kept] if isinstance(pixels, slice) else pixels[kept]
                radiance = radiance[kept]
        value = radiance.astype(np.float64)
        luminance = value @ LUMINANCE
        count = self.count[pixels] + 1
        mean = self.mean[pixels]
        delta = value - mean
        delta_y = delta @ LUMINANCE
        mean += delta / count[:, None]
        after = value - mean
        self.m2[pixels, :3] += delta * after
        self.m2[pixels, 3] += np.square(delta_y) * ((count - 1) / count)  # never negative, unlike delta · after
        self.mean[pixels] = mean
        self.count[pixels] = count
        self.nonzero[pixels] += luminance != 0
        self.largest[pixels] = np.maximum(self.largest[pixels], np.abs(luminance))

    def merge(self, other: Moments) -> Moments:
        """Moments of both sets of replicates, which must be disjoint (the caller knows the replicate ranges)."""
        count = self.count + other.count
        safe = np.maximum(count, 1)[:, None]
        share = other.count[:, None] / safe
        delta = other.mean - self.mean
        delta4 = np.concatenate([delta, (delta @ LUMINANCE)[:, None]], axis=1)
        return Moments(
            count=count,
            mean=self.mean + delta * share,
            m2=self.m2 + other.m2 + delta4**2 * (self.count[:, None] * share),
            nonzero=self.nonzero + other.nonzero,
            largest=np.maximum(self.largest, other.largest),
            invalid=self.invalid + other.invalid,
            tried=self.tried + other.tried,
        )

    def variance(self) -> Array:
        """(n, 4) sample variance of one replicate, R, G, B, Y; NaN where count < 2."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(self.count[:, None] >= 2, self.m2 / (self.count - 1)[:, None], np.nan)

    def variance_of_mean(self) -> Array:
        """(n, 4) variance of the mean, R, G, B, Y; NaN where count < 2."""
        return self.variance() / np.maximum(self.count, 1)[:, None]

    def luminance(self) -> Array:
        """(n,) mean luminance."""
        return self.mean @ LUMINANCE
