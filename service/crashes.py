"""What follows from a turn that was lost or failed, and how long one may take. Pure: nothing is done here."""

from __future__ import annotations

from dataclasses import replace

from service.engine.interface import Lost
from service.engine.turn import Failure
from service.without_paths import without_paths

# A turn that takes this many times as long as the last one that came back hangs, if that is more than the time of a
# first turn: any turn may have to load and compile its scene again. None has more than so many times that.
_DEADLINE_FACTOR, _MOST_TIMES = 10.0, 3.0
# An exception that nobody foresaw may be the fault of what its process did before: the job is tried in another one.
_SURPRISES = 2


def turn_deadline(first_seconds: float, last_seconds: float | None) -> float:
    """Seconds until a turn is killed.

    first_seconds: for a first turn. last_seconds: that the last turn of this run took, None before one has come back: a
    turn that was lost says nothing about the next one.
    """
    if last_seconds is None:
        return first_seconds
    return min(max(_DEADLINE_FACTOR * last_seconds, first_seconds), _MOST_TIMES * first_seconds)


def failure_of_losses(crashes: int, limit: int, lost: Lost) -> Failure | None:
    """How a job fails whose render process died; None while it is tried again."""
    if crashes < limit:
        return None
    words = shown_words(lost.last_words)
    return Failure(
        title="The render process died",
        detail=f"Rendering was tried {crashes} times, and each time {lost}. Other jobs are not affected."
        + (f" Its last words: {words}" if words else ""),
        hint="The scene may be damaged, too large for the memory or too slow: try fewer pixels, a simpler scene, or a "
        "lower max_depth.",
    )


def failure_of_surprises(crashes: int, limit: int, failure: Failure) -> Failure | None:
    """How a job fails that raised an unexpected exception; None while it is tried again in another process."""
    if crashes < min(_SURPRISES, limit):
        return None
    return replace(failure, detail=f"{failure.detail} It was tried {crashes} times, each time in a process of its own.")


def shown_words(words: str) -> str:
    """The last line with anything in it, short, without the folders of this machine."""
    lines = [line.strip() for line in words.splitlines() if line.strip()]
    kept = next((line for line in reversed(lines) if not line.startswith(("File ", "Thread ", "Extension "))), "")
    return " ".join(part.rpartition("/")[2] for part in without_paths(kept).split())[:300]
