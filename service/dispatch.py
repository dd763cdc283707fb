"""Which job gets the renderer next. Pure: nothing is rendered while deciding."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Candidate:
    """A running job as the dispatcher sees it. last_turn: number of its latest turn, 0 if it had none."""

    job_id: str
    number: int
    has_picture: bool
    last_turn: int


def next_job(running: Iterable[Candidate]) -> str | None:
    """A job's first picture goes before anyone's refinement; then in turn, the longest waiting first."""
    order = sorted(running, key=lambda job: (job.has_picture, job.last_turn, job.number))
    return order[0].job_id if order else None
