"""A range of replicates of a scene, as a part that merges: for farms that render one image on many machines.

Enters: a scene, settings, a range of replicates and a region. Leaves: an estimate of these replicates alone. Parts that
cover an image merge, in any order, to the bits of `render` with the same settings, all pixels served alike: a replicate
is addressed by (scene, settings, seed, pixel, index), and is added when all before it are there (`estimate/blocks.py`).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from renderer import plan
from renderer.backend import one_at_a_time
from renderer.errors import SettingsError
from renderer.estimate.blocks import Block, Held
from renderer.estimate.estimate import Estimate
from renderer.estimate.moments import STOKES, Moments
from renderer.pace import SAMPLES_PER_SECOND, Pace
from renderer.progress import BRIEF_SECONDS
from renderer.region import Region
from renderer.resolve import identity_of
from renderer.scene.parameters import Source
from renderer.settings import DEFAULT_REPLICATE_SIZE, Settings

if TYPE_CHECKING:
    from renderer.equation.launch import Launch, SharedLaunch
    from renderer.scene.compile import Scene

MOST_REPLICATES = 2**31 - 1  # of a pixel
KEPT_BYTES = 4, 1  # of a replicate of a pixel in memory: each of its values, and all else
MOST_KEPT_BYTES = 2**33


@dataclass(frozen=True, slots=True)
class PartProgress:
    """How far a part is. done: replicates that all of its pixels have. share: of its samples. seconds: so far.
    estimate: on the last one, all that is whole; None where nothing is.
    """

    done: range
    share: float
    seconds: float
    is_last: bool = False
    estimate: Estimate | None = None


def passes(
    scene: Scene | Source,
    replicates: range,
    settings: Settings | None = None,
    *,
    region: Any = None,
) -> Estimate:
    """Renders these replicates, range(64, 128) for instance, of all pixels or of those of a region.

    region: a Region or what it is made of. settings: without a replicate size it is 16, for all parts must agree in it;
    pixels are always served alike. `merge` of parts that cover the image gives the bits of a straight render:
    `render(scene, Target(spp=…), settings)` with the same replicate size and adaptive=False.
    """
    for step in part_steps(scene, replicates, settings, region=region):
        if step.estimate is not None:
            return step.estimate
    raise AssertionError("the last step has the estimate")


def part_steps(
    scene: Scene | Source,
    replicates: range,
    settings: Settings | None = None,
    *,
    region: Any = None,
    should_stop: Callable[[], bool] | None = None,
) -> Iterator[PartProgress]:
    """As `passes`, telling how far it is after every kernel launch. should_stop: asked between launches; True ends with
    those of the replicates that all pixels have by then.
    """
    _check_range(replicates)
    inner = _rendered(scene, replicates, settings or Settings(), region, should_stop or (lambda: False))
    while True:
        with one_at_a_time:
            try:
                step = next(inner)
            except StopIteration:
                return
        yield step


def _check_range(replicates: Any) -> None:
    if not isinstance(replicates, range) or replicates.step != 1:
        raise SettingsError(f"replicates are {replicates!r}; give a range of them, for example range(64, 128)")
    if not 0 <= replicates.start < replicates.stop <= MOST_REPLICATES:
        raise SettingsError(
            f"replicates are {replicates.start}:{replicates.stop}; the first must be 0 or more, and the end, which is "
            f"not rendered, larger and at most {MOST_REPLICATES}"
        )


def _rendered(
    scene: Scene | Source,
    replicates: range,
    asked: Settings,
    region: Any,
    should_stop: Callable[[], bool],
) -> Iterator[PartProgress]:
    from renderer.scene.compile import Scene, load_scene

    loaded = scene.sized(asked) if isinstance(scene, Scene) else load_scene(scene, settings=asked)
    size = asked.replicate_size or DEFAULT_REPLICATE_SIZE
    part = _Part(loaded, loaded.resolved(replace(asked, adaptive=False), size), replicates, region)
    yield part.progress()
    while part.end < replicates.stop:
        for _ in part.level():
            if should_stop():
                yield part.progress(is_last=True)
                return
            yield part.progress()
    yield part.progress(is_last=True)


class _Part:
    """The mutable side of one part. end: the replicate up to which all pixels have theirs.

    Replicates are rendered in levels: a few of every pixel, then the next few. Those from 0 on are folded into moments
    at once; later ones are kept.
    """

    def __init__(self, scene: Scene, settings: Settings, replicates: range, region: Any) -> None:
        self.scene, self.settings, self.replicates = scene, settings, replicates
        self.size = settings.replicate_size or 1
        n = scene.width * scene.height
        scope = None if region is None else Region.of(region).scope(scene.width, scene.height)
        self.is_wanted = np.ones(n, bool) if scope is None else scope
        self.pixels = np.flatnonzero(self.is_wanted)
        self.kernel = scene.kernel(settings)
        self.n_values = 3 + STOKES * self.kernel.has_stokes
        self.end = replicates.start
        self.head = Moments.empty(n, self.kernel.has_stokes)
        self.kept = None if replicates.start == 0 else self._room_for(len(replicates))
        self.lanes_done = 0  # of the level in progress, too
        self.seconds = 0.0
        self.pace = Pace(self.size, SAMPLES_PER_SECOND[scene.is_listed])

    def _room_for(self, n: int) -> _Kept:
        of_value, others = KEPT_BYTES
        if (n_bytes := n * len(self.pixels) * (of_value * self.n_values + others)) > MOST_KEPT_BYTES:
            raise SettingsError(
                f"replicates {self.end}:{self.end + n} of {len(self.pixels)} pixels, of which none can be added before "
                f"those that come first are there, take {n_bytes / 2**30:.1f} GiB, and {MOST_KEPT_BYTES >> 30} GiB is "
                "the most; render fewer in one part, or a region, or larger replicates (replicate_size)"
            )
        return _Kept(self.pixels, self.end, n, self.n_values)

    def level(self) -> Iterator[None]:
        """Renders the next few replicates of all pixels, as many as a pass has room for; they count once all are there.
        Suspended after every launch.
        """
        room = max(1, self.pace.pass_samples() // (self.size * len(self.pixels)))
        n = min(room, self.replicates.stop - self.end)
        level = _Kept(self.pixels, self.end, n, self.n_values) if self.kept is None else self.kept.part(self.end, n)
        is_shared = not self.settings.independent_pixels
        shape = self.scene.width, self.end, n, self.size
        works = plan.level(self.is_wanted, *shape, self.pace.pass_samples, is_shared)
        lanes_before = self.lanes_done
        # The next pass runs while the last one's results are copied.
        began, flying = time.perf_counter(), self._launched(next(works))
        while flying is not None:
            work, launch = flying
            while not launch.step():
                began = self._count(began)
                yield
                began = time.perf_counter()
            following = next(works, None)
            flying = None if following is None else self._launched(following)
            level.add(work, *launch.results())
            passed = time.perf_counter() - began
            began = self._count(began)
            self.pace.note(work, launch.results()[2], None if launch.is_long else passed)
            self.lanes_done += work.n_lanes
            if flying is not None:
                yield
                began = time.perf_counter()
        self.lanes_done = lanes_before + n * len(self.pixels)
        self._take(level, self.end + n)
        self._count(began)
        yield

    def _launched(self, work: plan.Pass) -> tuple[plan.Pass, Launch | SharedLaunch]:
        return work, self.kernel.begin(*work.lanes(), self.settings.seed)

    def _count(self, began: float) -> float:
        now = time.perf_counter()
        self.seconds += now - began
        return now

    def _take(self, level: _Kept, end: int) -> None:
        """A level that is full."""
        if self.kept is None:
            level.block(end).added_to(self.head, self.size)
        else:
            self.kept.segments += level.segments
        self.end = end

    def progress(self, is_last: bool = False) -> PartProgress:
        """How far it is."""
        done = range(self.replicates.start, self.end)
        share = self.lanes_done / (len(self.replicates) * len(self.pixels))
        return PartProgress(done, share, self.seconds, is_last, self._estimate() if is_last and done else None)

    def _estimate(self) -> Estimate:
        scene, settings = self.scene, self.settings
        held = Held(self.head, () if self.kept is None else (self.kept.block(self.end),))
        wanted = dict.fromkeys((*settings.channels, *scene.requirements.channels))
        return Estimate(
            width=scene.width,
            height=scene.height,
            replicate_size=self.size,
            moments=held.moments(self.size),
            identity=identity_of(scene, settings),
            seconds=self.seconds,
            ranges=((settings.seed, self.end),),
            notes={"warnings": list(scene.warnings), "cannot_see": list(scene.cannot_see(settings))},
            channels=scene.channels(settings, tuple(wanted)) if wanted else {},
            audit=scene.audit(settings) if self.seconds >= BRIEF_SECONDS else None,
            held=held if held.waiting else None,
        )


class _Kept:
    """Room for n replicates of all pixels of a part, one by one, from `first` on."""

    def __init__(self, pixels: NDArray[np.int64], first: int, n: int, n_values: int) -> None:
        self.pixels, self.first, self.n = pixels, first, n
        self.radiance = np.zeros((n, len(pixels), n_values), np.float32)
        self.invalid = np.zeros((n, len(pixels)), np.uint8)
        self.segments = np.zeros(len(pixels), np.int64)

    def part(self, first: int, n: int) -> _Kept:
        """Room for n of them, in the same memory, but with segments of their own."""
        part, chosen = copy(self), slice(first - self.first, first - self.first + n)
        part.first, part.n, part.radiance, part.invalid = first, n, self.radiance[chosen], self.invalid[chosen]
        part.segments = np.zeros_like(self.segments)
        return part

    def add(self, work: plan.Pass, radiance: NDArray, invalid: NDArray, segments: NDArray) -> None:
        """The results of a pass: of its lanes, in which a pixel's replicates follow each other."""
        places = np.searchsorted(self.pixels, work.pixels)
        self.radiance[:, places] = radiance.T.reshape(-1, self.n, len(radiance)).swapaxes(0, 1)
        self.invalid[:, places] = invalid.reshape(-1, self.n).T
        self.segments[places] = segments.reshape(-1, self.n).sum(axis=1, dtype=np.int64)

    def block(self, end: int) -> Block:
        """Those before `end`, once they are all there."""
        n = end - self.first
        return Block(self.first, self.pixels, self.radiance[:n], self.invalid[:n], self.segments)
