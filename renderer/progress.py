"""The main path: compile → plan → run → merge → snapshot, until a target is reached."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from renderer import allocation, plan
from renderer.errors import CheckpointError
from renderer.estimate.error import ImageError, image_error
from renderer.estimate.estimate import Estimate, Identity
from renderer.estimate.forecast import CurvePoint, Forecast, forecast
from renderer.estimate.health import Health
from renderer.estimate.moments import Moments
from renderer.settings import DEFAULT_CONFIDENCE, Settings, Target, replicate_size_for

if TYPE_CHECKING:
    from renderer.scene.compile import Scene

MIN_SNAPSHOT_SECONDS, MAX_SNAPSHOT_SECONDS = 0.25, 0.35  # of rendering between two snapshots
CURVE_GROWTH = 1.1
SAMPLES_PER_SECOND = {False: 2e6, True: 1e7}  # that two processors render at least, by Scene.is_listed
ROUND_SECONDS = 3e-5  # per pixel, that a round shall take; its planning and adding take some 7e-7
SNAPSHOT_SHARE = 0.1  # of the render time that making snapshots may take,
MAX_SNAPSHOT_SHARE = 0.3  # or this much where a viewer would otherwise wait for longer than a moment


@dataclass(frozen=True)
class Snapshot:
    """The state of a render at a sequence number. error: None while not known. seconds: render time alone.

    upper: what the error is below, with the confidence that the target asks for. curve: error over time so far.
    health: what to know before believing the image. stopped_by: error, seconds, spp or interrupted, on the last one.
    """

    sequence: int
    estimate: Estimate
    error: float | None
    share_within: float | None
    share_trusted: float
    spp: float
    samples: int
    seconds: float
    invalid: int
    forecast: Forecast | None
    curve: tuple[CurvePoint, ...]
    stopped_by: str | None
    upper: float | None = None
    health: Health = field(default_factory=Health)


def progressive(
    scene: Scene | str | Path | dict[str, Any],
    target: Target,
    settings: Settings | None = None,
    *,
    start: Estimate | None = None,
    should_stop: Callable[[], bool] | None = None,
) -> Iterator[Snapshot]:
    """Renders until the target is reached, yielding snapshots on the way.

    scene: a loaded scene or anything that `load_scene` takes. start: an estimate to go on from (same scene, settings
    and seed). should_stop: asked between passes; True ends with stopped_by = "interrupted".
    Being suspended between snapshots costs nothing: seconds count render time only. The first snapshot comes after the
    first coarse pass, later ones at most every quarter second of rendering. Equal settings and seed give equal
    moments, whatever the timing, and a render that was resumed equals one that was not.
    """
    from renderer.scene.compile import Scene, load_scene

    asked = settings or Settings()
    loaded = scene.sized(asked) if isinstance(scene, Scene) else load_scene(scene, settings=asked)
    # By what is known beforehand, not by the clock: equal questions have equal answers.
    pace = SAMPLES_PER_SECOND[loaded.is_listed] / (loaded.width * loaded.height)
    size = start.replicate_size if start and asked.replicate_size is None else replicate_size_for(asked, target, pace)
    resolved = loaded.resolved(asked, size)
    identity = identity_of(loaded, resolved)
    if start is not None:
        _check_resumable(start, identity)
    yield from _Render(loaded, target, resolved, identity, start).run(should_stop or (lambda: False))


def render(
    scene: Scene | str | Path | dict[str, Any],
    target: Target,
    settings: Settings | None = None,
    *,
    start: Estimate | None = None,
) -> Estimate:
    """Renders until the target is reached and returns the estimate."""
    last: Snapshot | None = None
    for snapshot in progressive(scene, target, settings, start=start):
        last = snapshot
    assert last is not None  # progressive always yields a last snapshot
    return last.estimate


def identity_of(scene: Scene, resolved: Settings) -> Identity:
    """What an estimate of this scene with these settings is an estimate of."""
    kept = {k: v for k, v in resolved.as_dict().items() if k not in ("seed", "channels")}
    needs = scene.requirements
    kept |= {"hide_emitters": needs.hide_emitters, "rr_depth": needs.rr_depth, "film": scene.film}
    return Identity(scene.digest, scene.name, kept, resolved.seed)


def _check_resumable(start: Estimate, identity: Identity) -> None:
    if start.identity.scene != identity.scene:
        raise CheckpointError(
            f"the checkpoint is of another scene ({start.identity.scene_name}, "
            f"digest {start.identity.scene[:12]}) than {identity.scene_name} ({identity.scene[:12]})"
        )
    if len(start.ranges) > 1:
        raise CheckpointError(
            "the checkpoint is a merge of several seeds; go on from one of its parts, then merge again"
        )
    if start.identity.seed != identity.seed:
        raise CheckpointError(f"the checkpoint has seed {start.identity.seed}, asked is {identity.seed}")
    for key, value in identity.settings.items():
        if (had := start.identity.settings.get(key)) != value:
            raise CheckpointError(f"the checkpoint was made with {key} = {had}, asked is {value}")


@dataclass(frozen=True, slots=True, eq=False)
class _Launch:
    """A pass on its way: what it renders, its results to be, when it began and after which snapshot."""

    work: plan.Pass
    lanes: Any
    began: float
    sequence: int


class _Render:
    """The mutable side of one render."""

    def __init__(
        self, scene: Scene, target: Target, settings: Settings, identity: Identity, start: Estimate | None
    ) -> None:
        self.scene, self.target, self.settings, self.identity = scene, target, settings, identity
        self.size = settings.replicate_size or 1
        self.n = scene.width * scene.height
        self.kernel = scene.kernel(settings)
        # Where no target is looked at, rounds need not be shorter than their planning is worth.
        pace = SAMPLES_PER_SECOND[scene.is_listed] / self.size
        self.least = ROUND_SECONDS * pace if target.error is None else 0.0
        self.moments = start.moments.copy() if start else Moments.empty(self.n)
        self.planned = start.planned if start else None
        self.unseen = scene.cannot_see(settings)
        self.scope = target.region.scope(scene.width, scene.height) if target.region is not None else None
        self.seconds = start.seconds if start else 0.0
        self.resumed_at = time.perf_counter()
        self.in_flight: _Launch | None = None
        self.channels = dict(start.channels) if start else {}
        self.sequence = 0
        self.curve: list[CurvePoint] = []
        self.is_shown = False  # a snapshot holds the moments: they are copied before they change
        self.snapshot_cost = 0.0
        self.since_snapshot = 0.0
        self.speed = 0.0  # samples per second, of the last passes
        self.pass_seconds = 0.0  # of the last pass

    @property
    def wanted(self) -> int | None:
        """Replicates per pixel that the target's spp asks for, in the mean."""
        return None if self.target.spp is None else -(-self.target.spp // self.size)

    def run(self, should_stop: Callable[[], bool]) -> Iterator[Snapshot]:
        stopped_by = self._stop_reason()
        while stopped_by is None:
            for _ in self._rendered(self._next_round()):
                if should_stop():
                    stopped_by = "interrupted"
                elif self._is_time_over():
                    stopped_by = "seconds"
                if stopped_by:
                    break
                if self._is_snapshot_due():
                    snapshot = self._snapshot(None)
                    self._count_time()
                    yield snapshot
                    self.resumed_at = time.perf_counter()
            if self.in_flight is not None:
                self._add(self.in_flight, self._fetch(self.in_flight))
            stopped_by = stopped_by or self._stop_reason()
        yield self._snapshot(stopped_by)

    def _rendered(self, works: Iterator[plan.Pass]) -> Iterator[None]:
        """Renders passes, one after the other. The next one runs while the last one's results are added, and while the
        caller looks at a snapshot: no processor waits for that.
        """
        work = next(works, None)
        while work is not None or self.in_flight is not None:
            launched = self.in_flight or self._launch(work)
            self.in_flight = None
            results = self._fetch(launched)
            work = next(works, None)
            # Not before the first picture, which nothing shall hold back.
            if work is not None and self.sequence > 0 and not self._is_time_nearly_over():
                self.in_flight = self._launch(work)
            self._add(launched, results)
            yield

    def _count_time(self) -> None:
        """Brings `seconds` up to now; suspended time does not count."""
        now = time.perf_counter()
        self.seconds += now - self.resumed_at
        self.since_snapshot += now - self.resumed_at
        self.resumed_at = now

    def _is_time_over(self) -> bool:
        self._count_time()
        return self.target.seconds is not None and self.seconds >= self.target.seconds

    def _is_time_nearly_over(self) -> bool:
        """Whether a further pass would begin before the one at hand has shown that the time is over."""
        self._count_time()
        return self.target.seconds is not None and self.seconds + plan.PASS_SECONDS >= self.target.seconds

    def _next_round(self) -> Iterator[plan.Pass]:
        tried, s = self.moments.tried, self.scene
        if not self.settings.adaptive or int(tried.min()) < plan.ADAPTIVE_FROM:
            return self._level_round(self.wanted)
        if self._is_round_over():
            self.planned = allocation.next_counts(self.moments, s.width, s.height, self.scope, self.least)
        assert self.planned is not None
        if (level := int(self.planned.min())) == int(self.planned.max()) and int(tried.max()) <= level:
            return self._level_round(level if self.wanted is None else min(level, self.wanted))
        left = None if self.wanted is None else self.wanted * self.n - int(tried.sum())
        return plan.planned_round(tried, self.planned, s.width, self.size, left, self._pass_samples)

    def _level_round(self, most: int | None) -> Iterator[plan.Pass]:
        s, is_checked = self.scene, self.target.error is not None
        shape = s.width, s.height, self.size
        return plan.next_round(self.moments.tried, *shape, most, self._pass_samples, is_checked, self._samples_left())

    def _is_round_over(self) -> bool:
        return self.planned is None or bool((self.moments.tried >= self.planned).all())

    def _launch(self, work: plan.Pass | None) -> _Launch:
        assert work is not None
        began = time.perf_counter()  # on a single thread the pass is over when the launch returns
        lanes = self.kernel.launch(*work.lanes(), self.settings.seed)
        return _Launch(work, lanes, began, self.sequence)

    def _fetch(self, launched: _Launch) -> tuple[NDArray, NDArray, NDArray]:
        """Waits for a pass and returns its lanes' radiance (n, 3), invalid samples (n,) and path segments (n,)."""
        radiance, invalid, segments = np.array(launched.lanes[0]).T, *map(np.array, launched.lanes[1:])
        if launched.sequence == self.sequence:  # else it may have waited for us
            self.pass_seconds = time.perf_counter() - launched.began
            speed = launched.work.n_lanes * self.size / max(self.pass_seconds, 1e-6)
            # The first pass may have compiled: a later, faster one replaces it at once.
            self.speed = speed if speed > 2 * self.speed else 0.7 * self.speed + 0.3 * speed
        return radiance, invalid, segments

    def _add(self, launched: _Launch, results: tuple[NDArray, NDArray, NDArray]) -> None:
        radiance, invalid, segments = results
        if self.is_shown:
            began = time.perf_counter()
            self.moments, self.is_shown = self.moments.copy(), False
            self.snapshot_cost += time.perf_counter() - began
        work = launched.work
        self.moments.add_runs(work.pixels, work.n_replicates, radiance, invalid, self.size, segments)
        if launched is self.in_flight:
            self.in_flight = None

    def _samples_left(self) -> float:
        """That the target's time leaves, about."""
        return math.inf if self.target.seconds is None else self.speed * max(0.0, self.target.seconds - self.seconds)

    def _pass_samples(self) -> int:
        return plan.pass_samples_for(self.speed)

    def _is_snapshot_due(self) -> bool:
        cost = self.snapshot_cost
        pace = min(max(cost / SNAPSHOT_SHARE, MIN_SNAPSHOT_SECONDS), MAX_SNAPSHOT_SECONDS)
        pace = max(pace, cost / MAX_SNAPSHOT_SHARE)
        # The end of the pass that is nearest to it.
        return self.sequence == 0 or self.since_snapshot + 0.5 * self.pass_seconds >= pace

    def _stop_reason(self) -> str | None:
        """Why to stop now, at the end of a round. Looking at targets here only does not fool them."""
        tried = self.moments.tried
        if self.wanted is not None and int(tried.sum()) >= self.wanted * self.n:
            return "spp"
        if self._is_time_over():
            return "seconds"
        low, is_level = int(tried.min()), int(tried.min()) == int(tried.max())
        is_planned = plan.is_checkpoint(low) if is_level else self.settings.adaptive and self._is_round_over()
        if self.target.error is None or not is_planned or low < plan.MIN_REPLICATES_TO_STOP:
            return None
        found = self._error(is_trust_wanted=False)
        self._count_time()
        self._extend_curve(found)
        return "error" if self._is_reached(found) else None

    def _error(self, is_trust_wanted: bool) -> ImageError:
        return image_error(
            self.moments,
            self.scene.width,
            self.target.error,
            confidence=self.target.confidence or DEFAULT_CONFIDENCE,
            scope=self.scope,
            is_trust_wanted=is_trust_wanted,
        )

    def _is_reached(self, found: ImageError) -> bool:
        if self.target.error is None:
            return False
        if self.target.share is not None:
            return found.share_lower is not None and found.share_lower >= self.target.share
        return found.upper is not None and found.upper <= self.target.error

    def _extend_curve(self, found: ImageError) -> None:
        """Adds a point, unless hardly any time has passed since the last one."""
        if found.error is None or (self.curve and self.seconds < self.curve[-1].seconds * CURVE_GROWTH):
            return
        spp = float(self.moments.count.mean()) * self.size
        self.curve.append(CurvePoint(self.seconds, spp, found.error, found.upper))

    def _snapshot(self, stopped_by: str | None) -> Snapshot:
        began = time.perf_counter()
        self.sequence += 1
        moments, self.is_shown = self.moments, True
        found = self._error(is_trust_wanted=False)
        self._extend_curve(found)
        missing = tuple(name for name in self.settings.channels if name not in self.channels)
        if missing and (stopped_by or self.sequence > 1):  # nothing holds the first picture back
            self.channels |= self.scene.channels(self.settings, missing)
        estimate = Estimate(
            width=self.scene.width,
            height=self.scene.height,
            replicate_size=self.size,
            moments=moments,
            identity=self.identity,
            seconds=self.seconds,
            ranges=((self.settings.seed, int(moments.tried.max())),),
            planned=None if self._is_round_over() else self.planned,
            channels=dict(self.channels),
            notes={"warnings": list(self.scene.warnings), "cannot_see": list(self.unseen)},
        )
        goal = self.target.error
        snapshot = Snapshot(
            sequence=self.sequence,
            estimate=estimate,
            error=found.error,
            share_within=found.share_within,
            share_trusted=float(estimate.trust.mean()),
            spp=estimate.spp,
            samples=estimate.samples,
            seconds=self.seconds,
            invalid=int(moments.invalid.sum()),
            forecast=forecast(self.curve, goal) if goal is not None and not stopped_by else None,
            curve=tuple(self.curve),
            stopped_by=stopped_by,
            upper=found.upper,
            health=estimate.health,
        )
        self.snapshot_cost = time.perf_counter() - began
        self.since_snapshot = 0.0
        return snapshot
