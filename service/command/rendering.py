"""One render of a command: its progress, its files, and what is said of it in the end."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.progress import Progress, TaskID

from renderer.estimate import readings
from renderer.estimate.estimate import Estimate
from renderer.progress import Snapshot, progressive
from renderer.scene.compile import Scene
from renderer.scene.parameters import Source
from renderer.settings import DEFAULT_CONFIDENCE, Settings, Target
from service.command.console import Stop, say, say_seconds
from service.command.output import OutputFiles

CHECKPOINT_SECONDS = 5.0  # of work that a killed render loses at most
CHECKPOINT_SHARE = 0.05  # of the time that writing may take: large images are saved less often


@dataclass(frozen=True, slots=True)
class Rendering:
    """What a render needs besides its scene. task: of the bar, which it moves from `begun` by `part`."""

    target: Target
    files: OutputFiles
    stop: Stop
    bar: Progress
    task: TaskID
    begun: float = 0.0
    part: float = 1.0

    def run(self, source: Scene | Source, settings: Settings, title: str, start: Estimate | None = None) -> Snapshot:
        """Renders and saves, now and then and in the end. The last snapshot."""
        last: Snapshot | None = None
        saved, cost = time.monotonic(), 0.0
        for last in progressive(source, self.target, settings, start=start, should_stop=self.stop.is_asked):
            if last.sequence == 1 and last.short is not None:
                say(last.short, "yellow")
            self._show(_share_done(last, self.target), title, _detail(last))
            now = time.monotonic()
            if now - saved > max(CHECKPOINT_SECONDS, cost / CHECKPOINT_SHARE) and last.stopped_by is None:
                self.files.save(last.estimate, last.stopped_by)
                saved = time.monotonic()
                cost = saved - now
        assert last is not None
        if last.stopped_by != "interrupted":
            self._show(1.0, title, _detail(last))
        self.files.save(last.estimate, last.stopped_by)
        return last

    def _show(self, share: float, title: str, detail: str) -> None:
        done = self.begun + self.part * share
        self.bar.update(self.task, description=title, completed=done, detail=detail)


def _share_done(snapshot: Snapshot, target: Target) -> float:
    shares = [0.0]
    if target.spp:
        shares.append(snapshot.spp / target.spp)
    if target.seconds:
        shares.append(snapshot.seconds / target.seconds)
    if target.error and snapshot.error:
        shares.append((target.error / (snapshot.upper or snapshot.error)) ** 2)
    return min(1.0, max(shares))


def _detail(snapshot: Snapshot) -> str:
    error = "error –" if snapshot.error is None else f"error {100 * snapshot.error:.2f} %"
    parts = [error, f"{snapshot.spp:.0f} spp", say_seconds(snapshot.seconds)]
    if snapshot.forecast is not None:
        parts.append(f"about {say_seconds(snapshot.forecast.seconds_left)} left")
    return " · ".join(parts)


def summarise(snapshot: Snapshot, target: Target, output: Path) -> None:
    """Says what a render has come to."""
    error = snapshot.unknown if snapshot.error is None else f"{100 * snapshot.error:.2f} %"
    error = error or "not known yet"
    if snapshot.upper is not None:
        sure = 100 * (target.confidence or DEFAULT_CONFIDENCE)
        error += f" (below {100 * snapshot.upper:.2f} % with {sure:g} % confidence)"
    reasons = {
        "error": "target error reached",
        "seconds": "time used up",
        "spp": "samples done",
        "interrupted": "interrupted",
    }
    short = target.error is not None and snapshot.stopped_by in ("seconds", "spp") and snapshot.error is not None
    missed = f" (asked {100 * (target.error or 0):.2f} %)" if short else ""
    say(
        f"{output}: error {error}{missed}, {snapshot.spp:.0f} spp, {say_seconds(snapshot.seconds)}, "
        f"{reasons.get(snapshot.stopped_by or '', '')}; {100 * snapshot.share_trusted:.1f} % of pixels trusted"
    )
    for line in readings.lines(snapshot.estimate, target.confidence or DEFAULT_CONFIDENCE):
        say(line)
    for sentence in snapshot.health.sentences():
        say(sentence, "yellow")


def report(snapshot: Snapshot, target: Target) -> dict[str, Any]:
    """The same as plain values."""
    return {
        "seconds": round(snapshot.seconds, 4),
        "spp": snapshot.spp,
        "error": snapshot.error,
        "error_unknown": snapshot.unknown,
        "estimated_rel_mse": None if snapshot.error is None else snapshot.error**2,
        "samples": snapshot.samples,
        "stopped_by": snapshot.stopped_by,
        "scene": snapshot.estimate.identity.scene_name,
        "scene_digest": snapshot.estimate.identity.scene,
        "seed": snapshot.estimate.identity.seed,
        "width": snapshot.estimate.width,
        "height": snapshot.estimate.height,
        "share_trusted": snapshot.share_trusted,
        "invalid": snapshot.invalid,
        "error_upper": snapshot.upper,
        "share_within": snapshot.share_within,
        "health": snapshot.health.as_dict(),
        "readings": readings.readings(snapshot.estimate, target.confidence or DEFAULT_CONFIDENCE),
    }
