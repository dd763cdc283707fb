"""A running job: what is known of it beyond its row."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from service.damage import loss
from service.dispatch import Candidate, seconds_left
from service.engine.turn import Start, TurnResult, Unsaved
from service.room import Shortage
from service.shown import shown
from service.states import Step
from service.store import JobRecord, Kept, Progress

# Frames after the last saved one are forgotten when the server dies; their numbers must not come again.
_SEQ_GAP = 1000
_CURVE_LIMIT = 400


@dataclass(slots=True)
class LiveJob:
    """The mutable side of a job while it runs."""

    record: JobRecord
    progress: Progress
    kept: tuple[Kept, ...]  # its saved estimates, newest first
    curve: list[dict[str, Any]]
    display_path: Path
    seq: int
    has_picture: bool
    scene: str = ""  # what the renderer is to load: a gallery name or a file
    last_turn: int = 0
    turn_seconds: float | None = None  # that its latest turn took, if it came back
    seconds: float = 0.0  # of the renderer, that it has had while it runs; see `Candidate`
    given_up: asyncio.Event = field(default_factory=asyncio.Event)  # nobody waits for its turn any more
    wish: Literal[Step.PAUSE, Step.CANCEL] | None = None
    wants_save: bool = False
    unsaved: Unsaved | None = None  # it has no turn until there is room to save what it has
    shortage: Shortage | None = None  # of room for that, when last looked
    tried_at: float = 0.0  # when it was last tried to save that, on the monotonic clock
    changed: asyncio.Event = field(default_factory=asyncio.Event)

    @classmethod
    def of(cls, record: JobRecord, display_path: Path) -> LiveJob:
        """A job that has just been claimed."""
        return cls(
            record=record,
            progress=record.progress,
            kept=record.kept,
            curve=list(record.curve),
            display_path=display_path,
            seq=record.progress.frame_seq + (_SEQ_GAP if record.attempt > 1 else 0),
            has_picture=record.checkpoint is not None,
        )

    def candidate(self, loaded: set[str]) -> Candidate:
        """The job as the dispatcher sees it. loaded: scenes that the renderer has compiled."""
        job = self.record
        return Candidate(
            *(job.id, job.number, self.has_picture, self.last_turn, job.client_id, job.priority),
            is_loaded=job.loaded_scene in loaded,
            seconds=self.seconds,
        )

    def seconds_left(self) -> float | None:
        """Render seconds that it still needs, None while unknown."""
        told = self.progress.forecast
        forecast = told.get("seconds_left") if told else None
        return seconds_left(self.record.target, self.progress.seconds, self.progress.spp, forecast)

    def absorb(self, result: TurnResult) -> None:
        """Note what a turn told."""
        if result.progress is not None:
            self.progress = result.progress
            self.seq = result.progress.frame_seq
        self.unsaved = result.unsaved
        if result.saved is not None:
            if not self.kept or self.kept[0].name != result.saved.name:
                self.kept = (result.saved, *self.kept[:1])
            self.wants_save = self.wants_save and result.saved.progress.seconds < self.progress.seconds
        elif result.unsaved is not None:
            self.wants_save = True
        if result.warnings and (warnings := shown(result.warnings)) != self.record.warnings:
            self.record = replace(self.record, warnings=warnings)
        if result.curve:
            # After a crash it goes on from the checkpoint, and comes by the same points again.
            first = result.curve[0]["spp"]
            self.curve = [point for point in self.curve if point["spp"] < first]
            self.curve.extend(result.curve)
        if len(self.curve) > _CURVE_LIMIT:
            # The convergence chart is logarithmic: of the older points every other one is enough.
            half = len(self.curve) // 2
            self.curve = self.curve[:half:2] + self.curve[half:]

    @property
    def checkpoint(self) -> str | None:
        """Its newest saved estimate."""
        return self.kept[0].name if self.kept else None

    def begin(self, start: Start) -> tuple[str, ...]:
        """Note from what the renderer began; what was lost, in sentences."""
        if not start.damaged:
            return ()
        losses = tuple(loss(kept, why, start.kept) for kept, why in start.damaged)
        self.kept = (start.kept,) if start.kept is not None else ()
        told = (*self.record.losses, *(one for one in losses if one not in self.record.losses))
        self.record = replace(self.record, losses=told)
        return losses

    def lose_unsaved(self, why: str) -> None:
        """It leaves the renderer, and what was rendered since it was last saved could not be."""
        kept = self.kept[0].progress.spp if self.kept else 0.0
        if self.progress.spp > kept:
            lost = f"Of {self.progress.spp:.4g} samples per pixel {kept:.4g} are kept: {why}"
            self.record = replace(self.record, losses=(*self.record.losses, lost))

    def lasting(self) -> Progress:
        """What is true of the picture that stays: what was rendered since it was saved may be lost."""
        if not self.kept:
            return Progress()
        saved = self.kept[0].progress
        if saved.samples == self.progress.samples:
            return self.progress
        return replace(saved, frame_seq=self.seq + 1)  # news to those who saw a newer picture

    def notify(self) -> None:
        """Wake those who wait for this job now; whoever waits later waits for the next change."""
        self.changed.set()
        self.changed.clear()
