"""Which jobs this server runs: claimed with a lease that it renews, so that others take up what it loses."""

from __future__ import annotations

from collections.abc import Collection
from datetime import UTC, datetime, timedelta

from service.store import JobRecord, JobStore
from service.store.records import iso


class Lease:
    """The leases of one server.

    place: the machine and data folder, which one server at a time may hold; server: this run of it.
    """

    def __init__(self, store: JobStore, place: str, server: str, seconds: float) -> None:
        self._store = store
        self._place = f"{place}#"
        self._owner = f"{self._place}{server}"
        self._seconds = seconds

    def claim(self, client_id: str, passed: Collection[str] = ()) -> JobRecord | None:
        """Start the next queued job of a client that is not among those `passed`."""
        return self._store.claim(self._owner, self._until(), client_id, passed)

    def renew(self) -> dict[str, int]:
        """Renew all; the attempts of the jobs that are still held, by id."""
        return self._store.renew(self._owner, self._until())

    def take_up_own(self) -> list[JobRecord]:
        """Queue what an earlier server at this place left running: it has ended, for this one holds the place."""
        return self._store.give_back(iso(datetime.now(UTC)), self._place)

    def take_up_expired(self) -> list[JobRecord]:
        """Queue what servers elsewhere have lost."""
        return self._store.give_back(iso(datetime.now(UTC)))

    def _until(self) -> str:
        return iso(datetime.now(UTC) + timedelta(seconds=self._seconds))
