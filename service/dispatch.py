"""Which job gets the renderer next. Pure: nothing is rendered while deciding."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
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


def seconds_until_start(position: int, remaining: Sequence[float | None], slots: int) -> float | None:
    """When the queued job at `position` (1 = next) will start: seconds from now, None while it cannot be told.

    remaining: render seconds that each running job still needs, None where unknown. The running jobs share one
    renderer evenly and the queue keeps every slot filled, so one that needs r seconds ends after slots · r.
    """
    to_end = position - (slots - len(remaining))
    if to_end <= 0:
        return 0.0
    known = sorted(seconds for seconds in remaining if seconds is not None)
    return slots * known[to_end - 1] if to_end <= len(known) else None


def seconds_left(
    target: dict[str, float | None], progress_seconds: float, spp: float, forecast: float | None
) -> float | None:
    """Render seconds that a running job still needs: the limit that is reached first. None while unknown."""
    ends: list[float] = []
    if (limit := target.get("seconds")) is not None:
        ends.append(limit - progress_seconds)
    if (wanted := target.get("spp")) is not None and spp > 0:
        ends.append(progress_seconds * (wanted / spp - 1))
    if target.get("error") is not None and forecast is not None:
        ends.append(forecast)
    return max(0.0, min(ends)) if ends else None
