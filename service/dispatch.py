"""Which job gets the renderer next, and which client may start one. Pure: nothing is rendered while deciding.

A client's *share* is the render time that it has had. First pictures go before refinement, as long as their client is
not far ahead of the others, nor they of their client's other jobs; then the client with the smallest share; within a
client priority, then the job that has had the least time. What a client asks beside its jobs has turns as a job has.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from heapq import heapify, heappop, heapreplace
from typing import NamedTuple

# Render seconds that a client may be ahead of the others and still have its first pictures before their refinement:
# a flood of new jobs from one client must not stop everyone else.
PREVIEW_CREDIT = 5.0


@dataclass(frozen=True, slots=True)
class Candidate:
    """A running job as the dispatcher sees it.

    last_turn: number of its latest turn, 0 if it had none. is_loaded: its scene is compiled in the renderer.
    seconds: of the renderer that it has had; one that comes later begins with what the others have had.
    """

    job_id: str
    number: int
    has_picture: bool
    last_turn: int
    client_id: str = ""
    priority: int = 0
    is_loaded: bool = False
    seconds: float = 0.0


class Waiting(NamedTuple):
    """A queued job as the dispatcher sees it. A tuple: a queue of hundreds is read with every change of state."""

    job_id: str
    number: int
    has_picture: bool
    client_id: str = ""
    priority: int = 0

    @property
    def rank(self) -> tuple[bool, int, int]:
        """Its place among the queued jobs of its client: one without any picture first."""
        return self.has_picture, -self.priority, self.number


class Shares:
    """Render seconds that each client has had. One that comes back does not make up for the time it was away."""

    def __init__(self) -> None:
        self._used: defaultdict[str, float] = defaultdict(float)

    def enter(self, client_id: str, active: Iterable[str]) -> None:
        """A client without running jobs starts one; active: the clients that have some."""
        others = [self._used[one] for one in active if one != client_id]
        self._used[client_id] = max(self._used[client_id], min(others, default=0.0))

    def charge(self, client_id: str, seconds: float) -> None:
        """A turn has taken `seconds`."""
        self._used[client_id] += seconds

    def of(self, client_id: str) -> float:
        """The share of a client."""
        return self._used[client_id]


def next_job(running: Iterable[Candidate], shares: Shares | None = None) -> str | None:
    """The job that has the next turn, None if there is none."""
    jobs = list(running)
    if not jobs:
        return None
    share = shares.of if shares is not None else lambda _: 0.0
    least = min(share(job.client_id) for job in jobs)
    had: dict[str, float] = {}
    for job in jobs:
        had[job.client_id] = min(job.seconds, had.get(job.client_id, job.seconds))

    def is_young(job: Candidate) -> bool:
        # A picture that takes long to begin waits like any other.
        return not job.has_picture and job.seconds <= had[job.client_id] + PREVIEW_CREDIT

    previews = [job for job in jobs if is_young(job) and share(job.client_id) <= least + PREVIEW_CREDIT]
    if previews:
        chosen = min(
            previews,
            key=lambda job: (share(job.client_id), -job.priority, not job.is_loaded, job.last_turn, job.number),
        )
    else:
        chosen = min(
            jobs,
            key=lambda job: (
                *(share(job.client_id), not is_young(job), -job.priority),
                *(job.seconds, job.last_turn, job.number),
            ),
        )
    return chosen.job_id


def start_order(queued: Iterable[Waiting], running: Mapping[str, int]) -> list[str]:
    """Ids of the queued jobs in the order in which they will start: the client with the fewest running jobs first.

    running: how many jobs of each client run now.
    """
    lines: defaultdict[str, list[tuple[tuple[bool, int, int], str]]] = defaultdict(list)
    for job in queued:
        lines[job.client_id].append((job.rank, job.job_id))
    for line in lines.values():
        line.sort(reverse=True)
    # Per client: how many run by then, and the rank of its next job. No two jobs have the same rank.
    heads = [(running.get(client, 0), line[-1][0], client) for client, line in lines.items()]
    heapify(heads)
    order: list[str] = []
    while heads:
        started, _, client = heads[0]
        line = lines[client]
        order.append(line.pop()[1])
        if line:
            heapreplace(heads, (started + 1, line[-1][0], client))
        else:
            heappop(heads)
    return order


def may_start(client_id: str, running: Mapping[str, int], slots: int) -> bool:
    """Whether a client may start a job now. A client with no running job need not wait for the others' to end."""
    return sum(running.values()) < slots or running.get(client_id, 0) == 0


def seconds_until_start(position: int, remaining: Sequence[float | None], slots: int) -> float | None:
    """When the queued job at `position` (1 = next) will start: seconds from now, None while it cannot be told.

    remaining: render seconds that each running job still needs, None where unknown. The running jobs share one
    renderer evenly and the queue keeps every slot filled, so one that needs r seconds ends after slots · r.
    """
    to_end = position - (slots - len(remaining))
    if to_end <= 0:
        return 0.0
    if to_end > len(remaining):
        return None
    known = sorted(seconds for seconds in remaining if seconds is not None)
    return slots * known[to_end - 1] if to_end <= len(known) else None


def seconds_left(
    target: Mapping[str, float | None], progress_seconds: float, spp: float, forecast: float | None
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
