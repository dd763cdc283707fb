"""The jobs that run on this server, and what follows from them: whose they are, and when a slot becomes free."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from datetime import UTC, datetime, timedelta

from service.dispatch import seconds_until_start
from service.live import LiveJob
from service.store.records import iso

_TOLD_SECONDS = 7 * 86400.0


class RunningJobs:
    """may_claim: something was queued, or a slot became free, since the queue was last looked at."""

    def __init__(self) -> None:
        self._live: dict[str, LiveJob] = {}
        self.may_claim = True

    def get(self, job_id: str) -> LiveJob | None:
        """A running job, or None."""
        return self._live.get(job_id)

    def of(self, job_id: str) -> LiveJob:
        """One that is known to run."""
        return self._live[job_id]

    def all(self) -> list[LiveJob]:
        """All of them."""
        return list(self._live.values())

    def add(self, live: LiveJob) -> None:
        """One that was claimed."""
        self._live[live.record.id] = live

    def drop(self, live: LiveJob) -> None:
        """It runs here no longer."""
        if self._live.get(live.record.id) is live:
            del self._live[live.record.id]
        self.may_claim = True

    def clients(self) -> dict[str, str]:
        """Whose the running jobs are, by job."""
        return {job_id: live.record.client_id for job_id, live in self._live.items()}

    def by_client(self) -> Counter[str]:
        """How many jobs of each client run."""
        return Counter(live.record.client_id for live in self._live.values())

    def least_seconds(self, client_id: str) -> float:
        """Of the renderer, that the running jobs of a client have had at least: who comes beside them begins there."""
        return min((live.seconds for live in self._live.values() if live.record.client_id == client_id), default=0.0)

    def expected_starts(self, queue_positions: Iterable[int], slots: int) -> dict[int, str | None]:
        """About when queued jobs will start, by place in the queue: ISO 8601 in UTC, None while it cannot be told."""
        remaining = [live.seconds_left() for live in self._live.values()]
        at = datetime.now(UTC)
        starts: dict[int, str | None] = {}
        for position in queue_positions:
            seconds = seconds_until_start(position, remaining, slots)
            if seconds is None or seconds > _TOLD_SECONDS:
                starts[position] = None
            else:
                starts[position] = iso(at + timedelta(seconds=seconds))
        return starts
