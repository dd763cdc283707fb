"""The main path: compile → plan → run → merge → snapshot, until a target is reached."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from renderer import plan
from renderer.audit.missing import missing_of
from renderer.backend import one_at_a_time
from renderer.errors import SettingsError
from renderer.estimate.error import Missing
from renderer.estimate.estimate import Estimate
from renderer.estimate.forecast import CurvePoint, Forecast, forecast
from renderer.estimate.health import Health
from renderer.estimate.moments import Moments
from renderer.launcher import KernelLauncher, Launched, Launcher
from renderer.pace import SAMPLES_PER_SECOND, UNSEEN_PASS_SECONDS, Clock, Pace, SnapshotPace
from renderer.resolve import Resolved, resolve
from renderer.scene.parameters import Source
from renderer.schedule import Allowed, next_round
from renderer.settings import Settings, Target
from renderer.state import RenderState
from renderer.stopping import Reason, StopRule

if TYPE_CHECKING:
    from renderer.scene.compile import Scene

ROUND_SECONDS = 3e-5  # per pixel, that an adaptive round shall take at least: its planning and adding take some 7e-7
BRIEF_SECONDS = 10.0  # shorter renders that ask for no error have no audit, which would take a notable part
AUDIT_SECONDS = 1.0  # that an audit takes, about: it is not begun where the target's time leaves less,
AUDIT_RESERVE = 5.0  # or less than this where no error is asked for: the first one of a scene compiles
LIGHT_CHECK_SECONDS = 0.2  # that a first check of the lights may take; where it has compiled, some milliseconds
NOT_AUDITED = (
    "light by way of mirrors and clear glass was not looked for, this render was too brief for that: where samples "
    "hardly ever meet such light, error and trust do not know of it; ask for an error, or render for longer than "
    f"{BRIEF_SECONDS + AUDIT_RESERVE:.0f} s"
)


@dataclass(frozen=True)
class Snapshot:
    """The state of a render at a sequence number. seconds: render time alone.

    error: of this picture, None where it cannot be said, and then unknown says why. upper: what the error is below,
    with the confidence that the target asks for; the bound decides about an error target. curve: both over time so far.
    short: that the target's time is too short for the image, from the first snapshot on while pixels have no sample.
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
    stopped_by: Reason | None
    upper: float | None = None
    unknown: str | None = None
    short: str | None = None
    health: Health = field(default_factory=Health)


def progressive(
    scene: Scene | Source,
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
    first coarse pass, later ones at most every quarter second of rendering.

    Equal settings and seed give equal moments, whatever the timing, and a render that was resumed equals one that was
    not. Where the target is a time and no replicate size is asked for, the size follows from the pace of the machine,
    measured before the clock starts: it is then among the resolved settings, and replay and resume are as exact.
    """
    for snapshot in steps(scene, target, settings, start=start, should_stop=should_stop):
        if snapshot is not None:
            yield snapshot


def steps(
    scene: Scene | Source,
    target: Target,
    settings: Settings | None = None,
    *,
    start: Estimate | None = None,
    should_stop: Callable[[], bool] | None = None,
    is_watched: bool = True,
    launcher: Callable[[Scene, Settings], Launcher] | None = None,
) -> Iterator[Snapshot | None]:
    """As `progressive`, with None wherever else it may be suspended: within a pass whose paths are long.

    In a closed room of white walls a single replicate may take minutes; whoever renders other scenes as well need not
    wait for it. is_watched: whether somebody looks at snapshots before the last one; if not, there are few.
    launcher: makes what has passes run, of the scene and the resolved settings; by default they run here.
    """
    inner = _progressive(scene, target, settings, start, should_stop, is_watched, launcher)
    while True:
        # One thread at a time: several renders in several threads take turns, step by step.
        with one_at_a_time:
            try:
                step = next(inner)
            except StopIteration:
                return
        yield step


def _progressive(
    scene: Scene | Source,
    target: Target,
    settings: Settings | None,
    start: Estimate | None,
    should_stop: Callable[[], bool] | None,
    is_watched: bool,
    launcher: Callable[[Scene, Settings], Launcher] | None,
) -> Iterator[Snapshot | None]:
    from renderer.scene.compile import Scene, load_scene

    _check_kinds(target, settings, start)
    asked = settings or Settings()
    loaded = scene.sized(asked) if isinstance(scene, Scene) else load_scene(scene, settings=asked)
    question = resolve(loaded, target, asked, start)
    yield from _Render(loaded, target, question, start, is_watched, launcher).run(should_stop or (lambda: False))


def _check_kinds(target: Any, settings: Any, start: Any) -> None:
    """Says what was meant where a caller hands something else."""
    if not isinstance(target, Target):
        raise SettingsError(f"target is {target!r}; give a Target, for example Target(error=0.05) or Target(spp=64)")
    if settings is not None and not isinstance(settings, Settings):
        raise SettingsError(f"settings are {settings!r}; give Settings, for example Settings(width=640)")
    if start is not None and not isinstance(start, Estimate):
        raise SettingsError(f"start is {start!r}; give an Estimate, for example Estimate.read(path)")


def render(
    scene: Scene | Source,
    target: Target,
    settings: Settings | None = None,
    *,
    start: Estimate | None = None,
) -> Estimate:
    """Renders until the target is reached and returns the estimate, which has the same bits as by `progressive`: less
    time goes into what is seen on the way.
    """
    last: Snapshot | None = None
    for snapshot in steps(scene, target, settings, start=start, is_watched=False):
        last = snapshot or last
    assert last is not None  # there is always a last snapshot
    return last.estimate


@dataclass(frozen=True, slots=True, eq=False)
class _Launch:
    """A pass on its way: what it renders, its results to be, when it began and after which snapshot."""

    work: plan.Pass
    lanes: Launched
    began: float
    sequence: int


class _Render:
    """The mutable side of one render: its state, which is carried on and saved, and its pace, which is not."""

    def __init__(
        self,
        scene: Scene,
        target: Target,
        question: Resolved,
        start: Estimate | None,
        is_watched: bool,
        launcher: Callable[[Scene, Settings], Launcher] | None = None,
    ) -> None:
        self.scene, self.target, self.settings = scene, target, question.settings
        self.is_watched = is_watched
        settings = self.settings
        self.size = settings.replicate_size or 1
        self.kernel = scene.kernel(settings)
        here = KernelLauncher(self.kernel, settings.seed)
        self.launcher = here if launcher is None else launcher(scene, settings)
        self.notes = {"warnings": list(scene.warnings), "cannot_see": list(scene.cannot_see(settings))}
        self.short = question.short
        self.scope = target.region.scope(scene.width, scene.height) if target.region is not None else None
        correlation = question.identity.correlation
        self.rule = StopRule(target, scene.width, self.size, self.scope, settings.adaptive, correlation)
        empty = Moments.empty(scene.width * scene.height, self.kernel.has_stokes)
        self.state = RenderState.begun(question.identity, empty, start, *self.rule.question)
        self.audit = start.audit if start is not None else None
        self.is_audited = not scene.needs_audit(settings)
        self.are_lights_checked = False
        self.in_flight: deque[_Launch] = deque()  # in the order in which they are added
        self.sequence = 0
        self.clock, self.snapshots = Clock(), SnapshotPace(is_watched)
        self.pace = Pace(self.size, question.samples_per_second)

    def run(self, should_stop: Callable[[], bool]) -> Iterator[Snapshot | None]:
        stopped_by: Reason | None = self._stop_reason()
        while stopped_by is None:
            following = next_round(self.state, self.rule, self.settings, self._allowed())
            self.state.planned = following.planned
            for is_added in self._rendered(following.passes):
                if should_stop():
                    stopped_by = "interrupted"
                elif not is_added:
                    # A pass is never left because its time is over: those with long paths would be missing.
                    yield from self._suspended()
                    continue
                elif self._is_time_over():
                    stopped_by = "seconds"
                if stopped_by:
                    break
                if self.snapshots.is_due(self.sequence == 0, self.pace.pass_seconds):
                    snapshot = self._snapshot(None)
                    self._count_time()
                    yield snapshot
                    self.clock.resume()
            while self.in_flight:
                if self.in_flight[0].lanes.step():
                    self._add(self.in_flight.popleft())
                elif should_stop():
                    self.in_flight.clear()
                else:
                    yield from self._suspended()
            stopped_by = stopped_by or self._stop_reason()
        yield self._snapshot(stopped_by)

    def _suspended(self) -> Iterator[None]:
        if self.launcher.places:  # else nothing renders
            self._count_time()
        yield None
        self.clock.resume()

    def _rendered(self, works: Iterator[plan.Pass]) -> Iterator[bool]:
        """Renders passes and adds them in their order; says whether one was added, or a part of it has run. The next
        ones run while a pass's results are added, and while the caller looks at a snapshot: nothing waits for that.
        """
        while True:
            self._fill(works, 1)
            if not self.in_flight:
                return
            while not self.in_flight[0].lanes.step():
                yield False
            launched = self.in_flight.popleft()
            self._note_pace(launched)
            self._fill(works, 0)
            self._add(launched)
            yield True

    def _fill(self, works: Iterator[plan.Pass], least: int) -> None:
        """Launches passes until there are as many as the launcher wants, or at least so many."""
        # Nothing holds back the first picture.
        is_seen = self.sequence > 0 or not self.is_watched
        most = self.launcher.most_launched if is_seen and not self._is_time_nearly_over() else least
        while len(self.in_flight) < max(most, least) and (work := next(works, None)) is not None:
            self.in_flight.append(self._launch(work))

    def _count_time(self) -> None:
        """Brings `seconds` up to now; suspended time does not count."""
        passed = self.clock.passed()
        self.state.seconds += passed
        self.snapshots.since += passed

    def _is_time_over(self) -> bool:
        self._count_time()
        return self.rule.is_time_over(self.state.seconds)

    def _is_time_nearly_over(self) -> bool:
        """Whether a further pass would begin before the one at hand has shown that the time is over."""
        self._count_time()
        return self.rule.is_time_over(self.state.seconds + min(plan.PASS_SECONDS, self.pace.pass_seconds))

    def _allowed(self) -> Allowed:
        seconds, least = self.target.seconds, 0.0
        if self.target.error is None:  # rounds need not be shorter than their planning is worth
            least = ROUND_SECONDS * SAMPLES_PER_SECOND[self.scene.is_listed] / self.size
        left = math.inf
        if seconds is not None:
            places = max(1, self.launcher.places)
            left = self.pace.samples_per_second * places * max(0.0, seconds - self.state.seconds)
        waits = self.is_watched or seconds is not None  # somebody, or the end of the time
        aimed = plan.PASS_SECONDS if waits else UNSEEN_PASS_SECONDS
        return Allowed(lambda: self.pace.pass_samples(seconds, aimed), left, least, self.is_watched)

    def _launch(self, work: plan.Pass) -> _Launch:
        began = time.perf_counter()  # on a single thread the pass is over when the launch returns
        return _Launch(work, self.launcher.launch(work), began, self.sequence)

    def _note_pace(self, launched: _Launch) -> None:
        """What a pass that is done tells of the time and the segments that the next one will take."""
        took = self.launcher.seconds_of(launched.lanes)
        if took is None and launched.sequence == self.sequence:  # else it may have waited for us
            took = time.perf_counter() - launched.began
        self.pace.note(launched.work, launched.lanes.results()[2], None if launched.lanes.is_long else took)

    def _add(self, launched: _Launch) -> None:
        radiance, invalid, segments = launched.lanes.results()
        began, work = time.perf_counter(), launched.work
        if work.is_look:
            self.state.add_look(work.pixels, radiance.T)
            return
        moments = self.state.own_moments()
        self.snapshots.cost += time.perf_counter() - began
        moments.add_runs(work.pixels, work.n_replicates, radiance.T, invalid, self.size, segments)

    def _stop_reason(self) -> Reason | None:
        """Why to stop now, at the end of a round. Looking at targets here only does not fool them."""
        self._count_time()
        state = self.state
        if limit := self.rule.limit_reached(state.moments.tried, state.seconds):
            return limit
        if not self.rule.is_look(state.moments.tried, state.is_round_over):
            return None
        found = self.rule.error(state.moments, self._missing())
        if self.rule.is_reached(found) and not self.is_audited:
            if not self._is_audit_affordable(AUDIT_SECONDS):
                return None  # it goes on to the end of its time: what was not looked for may be missing
            self._look_for_hidden_light()
            found = self.rule.error(state.moments, self._missing())
        self._count_time()
        state.extend_curve(found, self.size)
        return "error" if self.rule.is_reached(found) else None

    def _look_for_hidden_light(self) -> None:
        """Finds what the technique hardly does; worked out once for a scene, never before the first picture."""
        self.audit = self.scene.audit(self.settings)
        self.is_audited = True

    def _is_audit_affordable(self, reserve: float) -> bool:
        self._count_time()
        return self.target.seconds is None or self.state.seconds + reserve <= self.target.seconds

    def _is_audit_due(self, stopped_by: Reason | None) -> bool:
        """Whether hidden light is to be looked for now: where an error is asked for, that is worth any time that there
        is; elsewhere, once it is a small part of the render."""
        is_asked = self.target.error is not None
        if self.is_audited or not (stopped_by or self.sequence > 1):
            return False
        reserve = AUDIT_SECONDS if is_asked else AUDIT_RESERVE
        return (is_asked or self.state.seconds >= BRIEF_SECONDS) and self._is_audit_affordable(reserve)

    def _missing(self) -> Missing:
        """Light that no sample has met; part of every error that is said or judged."""
        self.state.missing = missing_of(self.audit, self.state.moments, self.size, self.scope)
        return self.state.missing

    def _snapshot(self, stopped_by: Reason | None) -> Snapshot:
        began = time.perf_counter()
        self.sequence += 1
        state = self.state
        if self._is_audit_due(stopped_by):
            self._look_for_hidden_light()
        is_due = not self.are_lights_checked and (stopped_by or self.sequence > 1)
        if is_due and self._is_audit_affordable(LIGHT_CHECK_SECONDS):
            self.are_lights_checked = True
            self.notes["warnings"] += self.scene.missed_lights(self.settings)
        found = self.rule.error(state.moments, self._missing())
        state.extend_curve(found, self.size)
        wanted = dict.fromkeys((*self.settings.channels, *self.scene.requirements.channels))
        missing = tuple(name for name in wanted if name not in state.channels)
        if missing and (stopped_by or self.sequence > 1):  # nothing holds the first picture back
            state.channels |= self.scene.channels(self.settings, missing)
        estimate = replace(
            state.estimate(self.scene.width, self.scene.height, self.size, self._notes(stopped_by)), audit=self.audit
        )
        snapshot = Snapshot(
            sequence=self.sequence,
            estimate=estimate,
            error=found.error,
            share_within=found.share_within,
            share_trusted=float(estimate.trust.mean()),
            spp=estimate.spp,
            samples=estimate.samples,
            seconds=state.seconds,
            invalid=int(state.moments.invalid.sum()),
            forecast=self._forecast() if not stopped_by else None,
            curve=state.curve.points,
            stopped_by=stopped_by,
            upper=found.upper,
            unknown=found.unknown,
            short=self._said_short(),
            health=estimate.health,
        )
        self.snapshots.cost, self.snapshots.since = time.perf_counter() - began, 0.0
        return snapshot

    def _forecast(self) -> Forecast | None:
        is_level_so_far = self.settings.adaptive and float(self.state.moments.tried.mean()) <= plan.ADAPTIVE_FROM
        goal = self.target.error
        return None if goal is None else forecast(self.state.curve.points, goal, is_level_so_far)

    def _notes(self, stopped_by: Reason | None) -> dict[str, list[str]]:
        """For the health: what is known of the scene, of a time that is too short while there are gaps, and, in the
        end, of light that was not looked for."""
        said = [self._said_short(), NOT_AUDITED if stopped_by and not self.is_audited and self.audit is None else None]
        return self.notes | {"warnings": [*filter(None, said), *self.notes["warnings"]]}

    def _said_short(self) -> str | None:
        return None if self.state.moments.tried.all() else self.short
