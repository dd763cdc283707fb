"""Measures the settings of a scene: all take turns, snapshot by snapshot, so that a busy machine slows them alike."""

from __future__ import annotations

import math
from collections.abc import Callable
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
from renderer.progress import Snapshot, progressive
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
    runs = [_Run(loaded, candidate, seconds, truth) for candidate in tried]
    while going := [run for run in runs if not run.is_done]:
        for run in going:
            if on_progress is not None:
                on_progress(run.candidate.name, sum(r.share_done for r in runs) / len(runs))
            run.step()
    full = runs[0].last
    rows = tuple(run.row(full) for run in runs)
    name = None if reference is None else Path(reference).name
    scale = full_pixels / (loaded.width * loaded.height)
    return Measurement(loaded.name, loaded.digest, loaded.width, loaded.height, seconds, rows, name, scale)


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
    """One setting on its way."""

    def __init__(self, scene: Scene, candidate: Candidate, seconds: float, truth: Reference | None) -> None:
        self.scene, self.candidate, self.seconds, self.truth = scene, candidate, seconds, truth
        self.curve: list[Point] = []
        self.last: Snapshot | None = None
        self.is_done = False
        self.snapshots = progressive(scene, Target(seconds=LONGEST * seconds), candidate.settings)
        self.is_warm = False

    @property
    def share_done(self) -> float:
        if self.is_done:
            return 1.0
        return 0.0 if self.last is None else min(1.0, self.last.seconds / self.seconds)

    def step(self) -> None:
        """Goes on to the next snapshot."""
        if not self.is_warm:  # compiling is not what is measured
            for _ in progressive(self.scene, WARM_UP, self.candidate.settings):
                pass
            self.is_warm = True
        self.last = next(self.snapshots)
        few = int(self.last.estimate.moments.tried.min()) < MIN_REPLICATES
        self.is_done = self.last.stopped_by is not None or (self.last.seconds >= self.seconds and not few)
        is_due = not self.curve or self.last.seconds >= self.curve[-1].seconds * CURVE_GROWTH
        if is_due or self.is_done:
            self._add_point(self.last)

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
        assert self.last is not None
        lost, lost_rel_mse = 0.0, 0.0
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
