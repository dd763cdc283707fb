"""A running job: what is known of it beyond its row."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from service.dispatch import Candidate, seconds_left
from service.engine.turn import TurnResult
from service.states import Step
from service.store import JobRecord, Progress

# Frames after the last saved one are forgotten when the server dies; their numbers must not come again.
_SEQ_GAP = 1000
_CURVE_LIMIT = 400


@dataclass(slots=True)
class LiveJob:
    """The mutable side of a job while it runs."""

    record: JobRecord
    scene: str  # what the renderer is to load: a gallery name or a file
    progress: Progress
    checkpoint: str | None
    saved: Progress  # what the checkpoint holds
    curve: list[dict[str, float]]
    display_path: Path
    seq: int
    has_picture: bool
    last_turn: int = 0
    turn_seconds: float = 0.0  # that its latest turn took
    wish: Literal[Step.PAUSE, Step.CANCEL] | None = None
    wants_save: bool = False
    changed: asyncio.Event = field(default_factory=asyncio.Event)

    @classmethod
    def of(cls, record: JobRecord, display_path: Path, scene: str) -> LiveJob:
        """A job that has just been claimed."""
        return cls(
            record=record,
            scene=scene,
            progress=record.progress,
            checkpoint=record.checkpoint,
            saved=record.progress,
            curve=list(record.curve),
            display_path=display_path,
            seq=record.progress.frame_seq + (_SEQ_GAP if record.attempt > 1 else 0),
            has_picture=record.checkpoint is not None,
        )

    def candidate(self, loaded: set[str]) -> Candidate:
        """The job as the dispatcher sees it. loaded: scenes that the renderer has compiled."""
        job = self.record
        return Candidate(
            job.id, job.number, self.has_picture, self.last_turn, job.client_id, job.priority, job.scene_ref in loaded
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
        if result.saved is not None:
            self.checkpoint, self.saved = result.saved.name, result.saved.progress
            self.wants_save = self.wants_save and result.saved.progress.seconds < self.progress.seconds
        if result.warnings and result.warnings != self.record.warnings:
            self.record = replace(self.record, warnings=result.warnings)
        if result.curve:
            # After a crash it goes on from the checkpoint, and comes by the same points again.
            first = result.curve[0]["spp"]
            self.curve = [point for point in self.curve if point["spp"] < first]
            self.curve.extend(result.curve)
        if len(self.curve) > _CURVE_LIMIT:
            # The convergence chart is logarithmic: of the older points every other one is enough.
            half = len(self.curve) // 2
            self.curve = self.curve[:half:2] + self.curve[half:]

    def kept(self) -> Progress:
        """What is true of the picture that stays: what was rendered since it was saved may be lost."""
        if self.checkpoint is None:
            return Progress()
        if self.saved.samples == self.progress.samples:
            return self.progress
        return replace(self.saved, frame_seq=self.seq + 1)  # news to those who saw a newer picture

    def notify(self) -> None:
        """Wake those who wait for this job now; whoever waits later waits for the next change."""
        self.changed.set()
        self.changed.clear()
