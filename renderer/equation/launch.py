"""A pass on its way: its kernel launched, and launched again for the lanes that are not done yet.

A launch of the path kernel is bounded in path segments, so that it ends within a moment however long paths are: in a
closed room of white walls with a depth of a million, one replicate has millions of them. Lanes that are not done are
continued where they were, with all of their loop state: they have the bits that they would have had in one go. The
sample at which the first launch left a lane is begun again, because ordinary passes shall not store that state; from
then on it is carried.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from renderer.backend import mitsuba, using
from renderer.equation import mueller
from renderer.equation.film import lanes_for
from renderer.equation.tables import table

if TYPE_CHECKING:
    from renderer.equation.path import PathKernel

mi: Any = mitsuba()

STEP_SECONDS = 0.1  # that a launch for suspended lanes shall take
FIRST_SEGMENTS, LEAST_SEGMENTS, MOST_SEGMENTS = 512, 64, 1 << 20  # of a suspended lane in one launch


class _Steps:
    """What is waited for step by step, until its results are there."""

    _results: tuple[NDArray, NDArray, NDArray] | None = None

    def step(self) -> bool:
        """Waits for what was launched; True once all lanes are done, else their next segments are launched."""
        raise NotImplementedError

    def finished(self) -> tuple[NDArray, NDArray, NDArray]:
        """Radiance (3, n), or (12, n) with S1 to S3, invalid samples and segments (n,), once all lanes are done."""
        while not self.step():
            pass
        return self.results()

    def results(self) -> tuple[NDArray, NDArray, NDArray]:
        """The same, after `step` has returned True."""
        assert self._results is not None
        return self._results


class Launch(_Steps):
    """The lanes of one pass."""

    def __init__(self, kernel: PathKernel, pixels: NDArray, replicates: NDArray, seed: int) -> None:
        self._kernel, self._seed = kernel, seed
        self._size = kernel.model.replicate_size
        with using(kernel.variant):
            self._pixels, self._replicates = table(pixels, mi.UInt32), table(replicates, mi.UInt32)
            # Samples one by one where they are shared: all of them are written.
            n = len(pixels)
            self._kept = None
            if kernel.film is not None:
                first = table(np.arange(n, dtype=np.uint32) * self._size, mi.UInt32)
                self._kept = dr.empty(mi.Float, kernel.film.floats * n * self._size), first
        self._lanes: Any = kernel.replay(self._pixels, self._replicates, seed, None, self._kept)
        self._long: _Suspended | None = None

    @property
    def is_long(self) -> bool:
        """Whether lanes had to be suspended."""
        return self._long is not None

    def step(self) -> bool:
        if self._results is None:
            light, *counts = self._lanes
            radiance, (invalid, segments, index) = mueller.columns(light), map(np.array, counts)
            self._results = radiance, invalid, segments
            left = np.flatnonzero(index < self._size)
            if len(left):
                which = self._pixels, self._replicates
                self._long = _Suspended(self._kernel, self._seed, left, *which, self._lanes, self._kept)
            self._lanes = ()
        elif self._long is not None:
            self._long.collect(*self._results)
        if self._long is None or self._long.is_empty:
            return True
        self._long.launch()
        return False

    @property
    def samples(self) -> Any:
        """Each sample of each lane, `SharedFilm.floats` each, where the kernel's film shares them."""
        return None if self._kept is None else self._kept[0]


class SharedLaunch(_Steps):
    """A pass where neighbours share samples: the lanes that its replicates need, then what each of them receives.
    Results are of the replicates that were asked for; invalid and segments are those of their own lanes.
    """

    def __init__(self, kernel: PathKernel, pixels: NDArray, replicates: NDArray, seed: int) -> None:
        self._kernel, self._replicates, self._seed = kernel, np.asarray(replicates, np.uint32), seed
        self._needed = lanes_for(np.asarray(pixels), self._replicates, kernel.width, kernel.reach)
        self._lanes = Launch(kernel, self._needed.places, self._needed.replicates, seed)

    @property
    def is_long(self) -> bool:
        """Whether lanes had to be suspended."""
        return self._lanes.is_long

    def step(self) -> bool:
        if self._results is not None:
            return True
        if not self._lanes.step():
            return False
        needed, (_, invalid, segments) = self._needed, self._lanes.results()
        radiance = self._kernel.added_up(self._lanes.samples, invalid, needed, self._replicates, self._seed)
        own = needed.starts[needed.targets] + self._replicates  # modulo 2^32
        self._results = radiance, invalid[own], segments[own]
        return True


class _Suspended:
    """Lanes that are not done, with their loop state."""

    def __init__(
        self,
        kernel: PathKernel,
        seed: int,
        lanes: NDArray[np.int64],
        pixels: Any,
        replicates: Any,
        results: Any,
        kept: Any,
    ) -> None:
        self._kernel, self._seed, self._lanes = kernel, seed, lanes
        self._segments_more = FIRST_SEGMENTS
        self._launched: Any = None
        self._began = 0.0
        self._is_warm = False  # its first launch may have compiled
        with using(kernel.variant):
            some = table(lanes, mi.UInt32)
            self._pixels, self._replicates, total, invalid, segments, index = _taken(
                (pixels, replicates, *results), some
            )
            self._state = self._first_state(total, invalid, segments, index)
            dr.make_opaque(self._state)
            self._kept = None if kept is None else (kept[0], *_taken(kept[1:], some))

    def _first_state(self, total: Any, invalid: Any, segments: Any, index: Any) -> tuple[Any, ...]:
        """Loop state at the beginning of sample `index`: as `PathKernel._run` declares and orders it."""
        n = len(self._lanes)

        # Each an array of its own: a recorded kernel takes one that comes twice for one input.
        def zeros(of_type: Any) -> Any:
            return dr.zeros(of_type, n)

        def ones(of_type: Any) -> Any:
            return dr.full(of_type, 1, n)

        ray, yes = zeros(mi.Ray3f), mi.Bool
        before = (index, zeros(mi.UInt32), ones(yes), ray.o, ray.d, zeros(mi.UInt32), zeros(mi.Float), ray.wavelengths)
        vertex = (zeros(mi.Point3f), zeros(mi.Float), ones(yes), zeros(mi.UInt32), ones(yes))
        light = mueller.zeros(mi.UnpolarizedSpectrum, mi.is_polarized, n)
        path = (ones(mi.Spectrum), ones(mi.Float), zeros(mi.Float), light)
        return (*self._kernel.extra_state(n), *before, *vertex, *path, total, invalid, segments, ones(yes))

    @property
    def is_empty(self) -> bool:
        """Whether all are done."""
        return len(self._lanes) == 0

    def launch(self) -> None:
        """Starts the next segments."""
        self._began = time.perf_counter()
        with using(self._kernel.variant):
            until = self._state[-2] + dr.opaque(mi.UInt32, self._segments_more)
            dr.eval(until)
        self._launched = self._kernel.replay(
            self._pixels, self._replicates, self._seed, (until, self._state), self._kept
        )

    def collect(self, radiance: NDArray, invalid: NDArray, segments: NDArray) -> None:
        """Waits for them, and writes the results of the lanes that are done to their places."""
        *results, self._state = self._launched
        self._launched = None
        is_left = np.array(self._state[-1])
        self._adapt(time.perf_counter() - self._began)
        done = ~is_left
        if not done.any():
            return
        found = [mueller.columns(results[0]), *(np.array(one) for one in results[1:3])]
        radiance[:, self._lanes[done]] = found[0][:, done]
        invalid[self._lanes[done]] = found[1][done]
        segments[self._lanes[done]] = found[2][done]
        self._lanes = self._lanes[is_left]
        if self.is_empty:
            return
        with using(self._kernel.variant):
            kept = table(np.flatnonzero(is_left), mi.UInt32)
            self._pixels, self._replicates, *state = _taken((self._pixels, self._replicates, *self._state), kept)
            self._state = tuple(state)
            if self._kept is not None:
                self._kept = (self._kept[0], *_taken(self._kept[1:], kept))
            dr.eval(self._state, self._kept)

    def _adapt(self, seconds: float) -> None:
        """No bit depends on how many segments a launch has."""
        if self._is_warm:
            factor = min(max(STEP_SECONDS / max(seconds, 1e-6), 0.25), 4.0)
            self._segments_more = int(min(max(self._segments_more * factor, LEAST_SEGMENTS), MOST_SEGMENTS))
        self._is_warm = True


def _taken(arrays: tuple[Any, ...], index: Any) -> tuple[Any, ...]:
    """Those entries of each array."""
    return tuple(dr.gather(type(one), one, index) if dr.width(one) else one for one in arrays)
