"""Per-pixel moments of replicates: a value that merges.

Enters: replicate means (float32 radiance, a short sum each). Leaves: count, mean and m2 per pixel in float64, plus what
trust needs (third moment of luminance, how many replicates were not black, how bright the brightest was). Pixels are in
row-major order. A pixel's replicates are added one by one in index order, so neither pass size nor timing changes a bit
of the result.
Where light is polarised, a replicate is a Stokes vector: radiance is S0, and S1 to S3 have mean and m2, too.
Sources: Welford 1962 (add), Chan, Golub & LeVeque 1979 (merge), Terriberry 2007 (third moment).
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # Rec. 709 / sRGB primaries
STOKES = 9  # S1, S2, S3, each of R, G, B
SPARSE = 0.1  # share of pixels that have replicates, below which the others are passed over
CHUNK = 16384  # pixels whose numbers stay in the cache while they are folded


@dataclass(slots=True)
class Moments:
    """Moments of n pixels.

    count: (n,) int64 replicates. mean: (n, 3) radiance, RGB. m2: (n, 4) sum of squared deviations of R, G, B and Y;
    luminance has its own because channels are correlated. m3: (n,) sum of cubed deviations of Y. nonzero: (n,) int64
    replicates that were not black. largest: (n,) luminance of the brightest replicate. invalid: (n,) int64 samples that
    were not finite. tried: (n,) int64 replicates that were rendered; more than count where all samples of one were not
    finite. segments: (n,) int64 path segments that were traced: what the pixel cost. stokes, stokes_m2: (n, 9) mean and
    sum of squared deviations of S1, S2 and S3, R, G and B of each; (n, 0) where light is not polarised. Columns of mean
    and m2 are contiguous: they are folded one channel at a time.
    """

    count: NDArray[np.int64]
    mean: Array
    m2: Array
    m3: Array
    nonzero: NDArray[np.int64]
    largest: Array
    invalid: NDArray[np.int64]
    tried: NDArray[np.int64]
    segments: NDArray[np.int64]
    stokes: Array
    stokes_m2: Array

    @classmethod
    def empty(cls, n: int, has_stokes: bool = False) -> Moments:
        """Moments of n pixels without any replicate. has_stokes: whether replicates have S1 to S3."""
        whole = lambda: np.zeros(n, np.int64)  # noqa: E731
        columns = lambda k: np.zeros((n, k), order="F")  # noqa: E731
        counts = whole(), np.zeros(n), whole(), whole(), whole()
        more = STOKES if has_stokes else 0
        return cls(whole(), columns(3), columns(4), np.zeros(n), *counts, columns(more), columns(more))

    @property
    def has_stokes(self) -> bool:
        """Whether replicates have S1 to S3."""
        return self.stokes.shape[1] > 0

    def at(self, pixels: NDArray[np.integer] | NDArray[np.bool_] | slice) -> Moments:
        """Moments of some pixels: a view for a slice, else a copy."""
        return Moments(*(getattr(self, f.name)[pixels] for f in fields(self)))

    def copy(self) -> Moments:
        """An independent copy."""
        touched = np.flatnonzero(self.tried)
        if len(touched) > SPARSE * len(self.tried):
            return Moments(*(getattr(self, f.name).copy("K") for f in fields(self)))
        # A first picture: memory that nobody has touched costs nothing while it stays so.
        result = Moments.empty(len(self.tried), self.has_stokes)
        for f in fields(self):
            source, target = getattr(self, f.name), getattr(result, f.name)
            for column in range(source.size // len(source)):
                own = source if source.ndim == 1 else source[:, column]
                (target if target.ndim == 1 else target[:, column])[touched] = own[touched]
        return result

    def add(
        self,
        pixels: NDArray[np.integer] | slice,
        radiance: NDArray,
        invalid: NDArray,
        replicate_size: int,
        segments: NDArray | int = 0,
    ) -> None:
        """Adds one replicate to each of `pixels` (distinct).

        radiance: (k, 3) replicate means, or (k, 12) with S1 to S3. invalid: (k,) samples of each that were not finite;
        a replicate of which no sample was finite counts as invalid samples only. segments: (k,) path segments of each.
        """
        self.segments[pixels] += segments
        if invalid.any():
            numbers = np.arange(len(self.count))[pixels] if isinstance(pixels, slice) else pixels
            self.invalid[numbers] += invalid
            kept = invalid < replicate_size
            self.tried[numbers[~kept]] += 1
            pixels, radiance = numbers[kept], radiance[kept]
        is_slice = isinstance(pixels, slice)
        for start in range(0, len(radiance), CHUNK):
            part = slice(start, start + CHUNK)
            self._fold(slice(start, min(start + CHUNK, len(radiance))) if is_slice else pixels[part], radiance[part])

    def add_runs(
        self,
        pixels: NDArray[np.integer],
        n: NDArray[np.integer] | int,
        radiance: NDArray,
        invalid: NDArray,
        replicate_size: int,
        segments: NDArray,
    ) -> None:
        """Adds n replicates, or n[i], to each of `pixels` (k,), distinct ones. A pixel's values (of Σn, …) follow each
        other. The same bits as by `add`, one after the other, but a pixel's moments are fetched once.
        """
        each = np.broadcast_to(n, len(pixels))
        starts = np.cumsum(each) - each
        for first in range(0, len(pixels), CHUNK):
            part = slice(first, first + CHUNK)
            some, many, start = pixels[part].astype(np.intp), each[part], starts[part]
            level = many[0] == many[-1] and bool((many == many[0]).all())
            if not level:  # those with more of them come first: each replicate is added to the first k
                order = np.argsort(-many, kind="stable")
                some, many, start = some[order], many[order], start[order]
            block = self._fetched(some)
            for r in range(int(many[0])):
                if level:
                    k, lanes = len(many), slice(int(start[0]) + r, int(start[-1]) + r + 1, int(many[0]))
                else:
                    k = int(np.searchsorted(-many, -r))
                    lanes = start[:k] + r
                block.add(slice(0, k), radiance[lanes], invalid[lanes], replicate_size, segments[lanes])
            self.put(some, block)

    def add_block(
        self,
        pixels: NDArray[np.integer],
        radiance: NDArray,
        invalid: NDArray,
        replicate_size: int,
        segments: NDArray,
    ) -> None:
        """Adds n replicates to each of `pixels` (k,), distinct ones: radiance (n, k, 3), invalid (n, k), segments (k,)
        of all n. The same bits as by `add`, one after the other.
        """
        for first in range(0, len(pixels), CHUNK):
            part = slice(first, first + CHUNK)
            some = pixels[part].astype(np.intp)
            block = self._fetched(some)
            for r in range(len(radiance)):
                traced = segments[part] if r == 0 else 0
                block.add(slice(0, len(some)), radiance[r, part], invalid[r, part], replicate_size, traced)
            self.put(some, block)

    def _columns(self) -> list[NDArray]:
        """Each number of all pixels, (n,) views."""
        return [column for f in fields(self) for column in np.atleast_2d(getattr(self, f.name).T)]

    def _fetched(self, pixels: NDArray[np.integer]) -> Moments:
        """A copy of some pixels' moments, by columns."""
        block = Moments.empty(len(pixels), self.has_stokes)
        for own, fetched in zip(self._columns(), block._columns(), strict=True):
            np.take(own, pixels, out=fetched, mode="clip")  # the fastest mode
        return block

    def put(self, pixels: NDArray[np.integer], block: Moments) -> None:
        """Replaces the moments of some pixels."""
        for own, changed in zip(self._columns(), block._columns(), strict=True):
            own[pixels] = changed

    def _fold(self, where: NDArray[np.integer] | slice, value: NDArray) -> None:
        """Welford's update, with Terriberry's third moment."""
        count = self.count[where] + 1
        inverse = 1.0 / count
        luminance = delta_y = np.zeros(len(value))
        for c, weight in enumerate(LUMINANCE):
            x = value[:, c].astype(np.float64)
            delta = self._welford(self.mean[:, c], self.m2[:, c], where, x, inverse)
            luminance = luminance + weight * x
            delta_y = delta_y + weight * delta
        for c in range(self.stokes.shape[1]):
            x = value[:, 3 + c].astype(np.float64)
            self._welford(self.stokes[:, c], self.stokes_m2[:, c], where, x, inverse)
        m2 = self.m2[:, 3]
        before = m2[where]
        gained = np.square(delta_y) * ((count - 1) * inverse)  # never negative, unlike delta · (x − after)
        self.m3[where] += delta_y * (gained * ((count - 2) * inverse) - 3 * inverse * before)
        m2[where] = before + gained
        self.count[where] = count
        self.tried[where] += 1
        self.nonzero[where] += luminance != 0
        self.largest[where] = np.maximum(self.largest[where], np.abs(luminance))

    @staticmethod
    def _welford(mean: Array, m2: Array, where: NDArray[np.integer] | slice, x: Array, inverse: Array) -> Array:
        """Adds a value to some means and sums of squared deviations. Returns how far it was from each mean before."""
        before = mean[where]
        delta = x - before
        after = before + delta * inverse
        m2[where] += delta * (x - after)
        mean[where] = after
        return delta

    def merge(self, other: Moments) -> Moments:
        """Moments of both sets of replicates, which must be disjoint (the caller knows the replicate ranges)."""
        count = self.count + other.count
        safe = np.maximum(count, 1)
        share = other.count / safe
        delta = other.mean - self.mean
        delta4 = np.concatenate([delta, (delta @ LUMINANCE)[:, None]], axis=1)
        delta_y = delta4[:, 3]
        cross = (self.count * share)[:, None]
        skew = delta_y * (
            delta_y**2 * cross[:, 0] * ((self.count - other.count) / safe)
            + 3 * ((self.count / safe) * other.m2[:, 3] - share * self.m2[:, 3])
        )
        return Moments(
            count=count,
            mean=np.asfortranarray(self.mean + delta * share[:, None]),
            m2=np.asfortranarray(self.m2 + other.m2 + delta4**2 * cross),
            m3=self.m3 + other.m3 + skew,
            nonzero=self.nonzero + other.nonzero,
            largest=np.maximum(self.largest, other.largest),
            invalid=self.invalid + other.invalid,
            tried=self.tried + other.tried,
            segments=self.segments + other.segments,
            stokes=np.asfortranarray(self.stokes + (apart := other.stokes - self.stokes) * share[:, None]),
            stokes_m2=np.asfortranarray(self.stokes_m2 + other.stokes_m2 + apart**2 * cross),
        )

    def skewness(self) -> Array:
        """(n,) sample skewness of one replicate's luminance; 0 where nothing varies."""
        spread = self.m2[:, 3]
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            skew = self.m3 / spread * np.sqrt(self.count / spread)
        return np.where((spread > 0) & np.isfinite(skew), skew, 0.0)

    def variance(self) -> Array:
        """(n, 4) sample variance of one replicate, R, G, B, Y; NaN where count < 2."""
        measured = self.count >= 2
        if measured.all():
            return self.m2 / (self.count - 1)[:, None]
        variance = np.full_like(self.m2, np.nan)
        return np.divide(self.m2, (self.count - 1)[:, None], out=variance, where=measured[:, None])

    def variance_of_mean(self) -> Array:
        """(n, 4) variance of the mean, R, G, B, Y; NaN where count < 2."""
        variance = self.variance()
        return np.divide(variance, np.maximum(self.count, 1)[:, None], out=variance)

    def stokes_variance_of_mean(self) -> Array:
        """(n, 9) variance of the means of S1 to S3; NaN where count < 2. (n, 0) where light is not polarised."""
        n = self.count[:, None]
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(n >= 2, self.stokes_m2 / (np.maximum(n - 1, 1) * n), np.nan)

    def luminance(self) -> Array:
        """(n,) mean luminance."""
        return self.mean @ LUMINANCE
