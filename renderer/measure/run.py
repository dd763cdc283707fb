"""Measures the settings of a scene: all take turns, snapshot by snapshot, so that a busy machine slows them alike."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from renderer.errors import SettingsError
from renderer.estimate.error import floor_of, pixel_rel_mse, rel_mse
from renderer.measure.candidates import Candidate, candidates
from renderer.measure.reference import Reference
from renderer.measure.result import Measurement, Point, Row
from renderer.progress import Snapshot, steps
from renderer.scene.parameters import Source
from renderer.settings import Settings, Target

if TYPE_CHECKING:
    from renderer.scene.compile import Scene

DEFAULT_SECONDS = 3.0
WARM_UP = Target(spp=1)
CURVE_GROWTH = 1.15
Z95 = 1.96
OFTEN, NEARLY_ALWAYS = 6, 0.9  # replicates that found light
MIN_REPLICATES, LONGEST = 4, 4.0  # a setting goes on until it has these, for at most this many times its seconds
MOST_PIXELS = 2**15  # where no size is asked for


def measure(
    scene: Scene | Source,
    *,
    seconds: float = DEFAULT_SECONDS,
    settings: Settings | None = None,
    techniques_only: bool = False,
    reference: str | Path | None = None,
    on_progress: Callable[[str, float], None] | None = None,
) -> Measurement:
    """Renders the scene with each of the settings worth comparing, `seconds` each, and says what each of them gives.

    scene: a loaded scene or anything that `load_scene` takes. settings: what all share (size, seed, …).
    reference: an EXR of the converged image, ours or any other; true errors are then measured as well, at its size.
    Without a size or a reference, the image is shrunk to 2^15 pixels: time per pixel is what is measured.
    on_progress: told the setting at work and the share done.
    """
    from renderer.scene.compile import Scene, load_scene

    if not 0.1 <= seconds <= 86_400:
        raise SettingsError(f"seconds is {seconds!r}; it must be from 0.1 to 86400")
    asked = settings or Settings()
    truth = Reference.read(Path(reference)) if reference is not None else None
    if truth is not None:
        asked = replace(asked, **truth.size_for(asked))
    loaded = scene.sized(asked) if isinstance(scene, Scene) else load_scene(scene, settings=asked)
    if truth is not None:
        truth.check(loaded)
    full_pixels = loaded.width * loaded.height
    if truth is None:
        loaded = shrunk(loaded, asked)
    depth = loaded.requirements.max_depth if asked.max_depth is None else asked.max_depth
    tried = candidates(replace(asked, width=loaded.width, height=loaded.height), depth, techniques_only)
    measuring = Measuring(loaded, tried, seconds, truth, full_pixels)
    while not measuring.is_done:
        measuring.round(on_progress)
    return measuring.result(None if reference is None else Path(reference).name)


class Measuring:
    """A measurement on its way: all settings take turns. It may be suspended between steps, which costs no time that is
    counted, and may be given more time.

    scene: at the size that is measured. full_pixels: of the scene's own picture. most_seconds: that each setting may
    get at all, where that is more than `seconds`.
    """

    def __init__(
        self,
        scene: Scene,
        tried: tuple[Candidate, ...],
        seconds: float,
        truth: Reference | None = None,
        full_pixels: int | None = None,
        most_seconds: float | None = None,
    ) -> None:
        self.scene, self.seconds = scene, seconds
        self._runs = [_Run(scene, each, seconds, truth, most_seconds) for each in tried]
        self._scale = 1.0 if full_pixels is None else full_pixels / (scene.width * scene.height)
        self._next = 0

    @property
    def is_done(self) -> bool:
        """Whether each setting had its time."""
        return all(run.is_done for run in self._runs)

    @property
    def share(self) -> float:
        """Of what is to be done, what is done: 0…1."""
        return sum(run.share_done for run in self._runs) / len(self._runs)

    @property
    def at_work(self) -> str:
        """Name of the setting whose turn is next."""
        return self._runs[self._next].candidate.name

    def give(self, seconds: float) -> None:
        """Let each setting have so many seconds in all; those that had less go on."""
        if seconds > self.seconds:
            self.seconds = seconds
            for run in self._runs:
                run.give(seconds)

    def step(self) -> None:
        """The next setting's turn: to its next snapshot, or a part of the way. Nothing where all are done."""
        for _ in self._runs:
            run = self._runs[self._next]
            self._next = (self._next + 1) % len(self._runs)
            if not run.is_done:
                run.step()
                return

    def round(self, on_progress: Callable[[str, float], None] | None = None) -> None:
        """A turn of each setting that is not done."""
        for run in [run for run in self._runs if not run.is_done]:
            if on_progress is not None:
                on_progress(run.candidate.name, self.share)
            run.step()

    def result(self, reference: str | None = None) -> Measurement:
        """What is known by now. reference: name of the file that true errors are against."""
        full = self._runs[0].last
        rows = tuple(run.row(full) for run in self._runs)
        scene = self.scene
        about = (scene.name, scene.digest, scene.width, scene.height, self.seconds)
        return Measurement(*about, rows, reference, self._scale)


def shrunk(scene: Scene, asked: Settings) -> Scene:
    """The scene at a size at which a few seconds say something, where no size is asked for."""
    if asked.width is not None or asked.height is not None:
        return scene
    return scene.sized(replace(asked, **_small(scene)))


def _small(scene: Scene) -> dict[str, int]:
    """A size of the scene's proportions at which a few seconds say something."""
    shrink = min(1.0, math.sqrt(MOST_PIXELS / (scene.width * scene.height)))
    return {"width": max(1, round(scene.width * shrink)), "height": max(1, round(scene.height * shrink))}


class _Run:
    """One setting on its way. most_seconds: that it may get at all."""

    def __init__(
        self, scene: Scene, candidate: Candidate, seconds: float, truth: Reference | None, most_seconds: float | None
    ) -> None:
        self.scene, self.candidate, self.seconds, self.truth = scene, candidate, seconds, truth
        self.curve: list[Point] = []
        self.last: Snapshot | None = None
        self.is_done = False
        self._steps = self._rendered(LONGEST * max(seconds, most_seconds or 0.0))

    def _rendered(self, seconds: float) -> Iterator[Snapshot | None]:
        for _ in steps(self.scene, WARM_UP, self.candidate.settings):  # compiling is not what is measured
            yield None
        yield from steps(self.scene, Target(seconds=seconds), self.candidate.settings)

    @property
    def share_done(self) -> float:
        if self.is_done:
            return 1.0
        return 0.0 if self.last is None else min(1.0, self.last.seconds / self.seconds)

    def give(self, seconds: float) -> None:
        """Go on, unless the render itself has ended."""
        self.seconds = seconds
        self.is_done = self.last is not None and self.last.stopped_by is not None

    def step(self) -> None:
        """Goes on to the next snapshot, or a part of the way where the paths are long."""
        snapshot = next(self._steps)
        if snapshot is None:
            return
        self.last = snapshot
        few = int(snapshot.estimate.moments.tried.min()) < MIN_REPLICATES
        has_had_enough = snapshot.seconds >= self.seconds * (LONGEST if few else 1.0)
        self.is_done = snapshot.stopped_by is not None or has_had_enough
        is_due = not self.curve or snapshot.seconds >= self.curve[-1].seconds * CURVE_GROWTH
        if is_due or self.is_done:
            self._add_point(snapshot)

    def _add_point(self, snapshot: Snapshot) -> None:
        if snapshot.error is None or not (snapshot.estimate.moments.count >= 2).all():
            return
        if self.is_done and self.curve and snapshot.seconds < self.curve[-1].seconds * math.sqrt(CURVE_GROWTH):
            self.curve.pop()
        moments = snapshot.estimate.moments
        low, high = error_interval(pixel_rel_mse(moments))
        true = None if self.truth is None else self.truth.error_of(snapshot.estimate.mean)
        error = snapshot.error
        self.curve.append(Point(snapshot.seconds, snapshot.spp, error, low * error, high * error, true))

    def row(self, full: Snapshot | None) -> Row:
        lost, lost_rel_mse = 0.0, 0.0
        if self.last is None:  # its first turn is still to come
            return Row(self.candidate, (), 0, 0.0, 0.0, 0.0, 0)
        if self.candidate.is_biased and full is not None and self.curve:
            lost, lost_rel_mse = lost_light(self.last, full)
        return Row(
            candidate=self.candidate,
            curve=tuple(self.curve),
            samples=self.last.samples,
            seconds=self.last.seconds,
            share_trusted=self.last.share_trusted,
            share_found=share_found(self.last),
            invalid=self.last.invalid,
            lost_light=lost,
            lost_rel_mse=lost_rel_mse,
        )


def error_interval(squared: NDArray[np.float64]) -> tuple[float, float]:
    """95 % interval of an image error, as multiples of it, from the spread of its pixels' squared errors, (n,)."""
    mean = float(np.mean(squared))
    if mean <= 0:
        return 1.0, 1.0
    margin = Z95 * float(np.std(squared)) / math.sqrt(len(squared)) / mean
    return math.sqrt(1 / (1 + margin)), math.sqrt(1 + margin)


def share_found(snapshot: Snapshot) -> float:
    """Share of the lit pixels that have found light often enough, or nearly always so far."""
    moments = snapshot.estimate.moments
    lit = moments.nonzero > 0
    found = (moments.nonzero >= OFTEN) | (moments.nonzero >= NEARLY_ALWAYS * moments.count)
    return float(found[lit].mean()) if lit.any() else 0.0


def lost_light(shallow: Snapshot, full: Snapshot) -> tuple[float, float]:
    """Share of the light that shallower paths leave out, and the relative squared error that this makes.

    Both images are noisy; what their noise adds to the difference is known, and taken off.
    """
    few, all_ = shallow.estimate, full.estimate
    share = 1 - float(few.moments.luminance().mean()) / max(float(all_.moments.luminance().mean()), 1e-300)
    noise = few.moments.variance_of_mean()[:, :3] + all_.moments.variance_of_mean()[:, :3]
    noise_rel_mse = float(np.nanmean(noise / (all_.moments.mean**2 + floor_of(all_.moments.mean))))
    return share, max(0.0, rel_mse(few.mean, all_.mean) - noise_rel_mse)
