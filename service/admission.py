"""Which queued job starts next: the first in line that fits into memory beside those that run. The others are passed
for some minutes, say what they wait for, and start by themselves once there is room."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from service.accountant import Accountant, Need
from service.dispatch import Waiting, may_start
from service.room import Disk, Shortage
from service.store import JobNotFound, JobRecord, JobStore, RowUnreadable

LOOK_AGAIN_SECONDS = 1.0  # for memory that others have given back
# That a job is passed by smaller ones; then those wait until it fits, or a large one would never begin.
PASSED_SECONDS = 300.0


@dataclass(frozen=True, slots=True)
class Choice:
    """The job to start, None if there is none. passed: jobs before it that do not fit now, and what they lack."""

    job: Waiting | None
    passed: Mapping[str, Shortage] = field(default_factory=dict)


def choose(
    queue: list[Waiting],
    running: Mapping[str, int],
    slots: int,
    lacks: Callable[[str], Shortage | None],
    is_patient: Callable[[str], bool] = lambda _: True,
) -> Choice:
    """The first in the queue that may start. lacks: what a job, by its id, needs and cannot have now. is_patient:
    whether a job that lacks something lets others pass; where nothing runs, waiting would not help it.
    """
    passed: dict[str, Shortage] = {}
    for waiting in queue:
        if not may_start(waiting.client_id, running, slots):
            continue
        if (shortage := lacks(waiting.job_id)) is None:
            return Choice(waiting, passed)
        passed[waiting.job_id] = shortage
        if running and not is_patient(waiting.job_id):
            break
    return Choice(None, passed)


class Admission:
    """Lets jobs start. need_of: what a job needs of the renderer; synchronous, as it looks at files."""

    def __init__(
        self, store: JobStore, disk: Disk, accountant: Accountant, slots: int, need_of: Callable[[JobRecord], Need]
    ) -> None:
        self._store = store
        self._disk = disk
        self._accountant = accountant
        self._slots = slots
        self._need_of = need_of
        self._needs: dict[str, Need] = {}  # of queued and running jobs
        self._passed: Mapping[str, Shortage] = {}
        self._passed_since: dict[str, float] = {}
        self._looked = 0.0
        self._no_disk: Shortage | None = None

    def look(self, running: Mapping[str, str]) -> Choice:
        """The job to start. running: clients of the running jobs, by job. Synchronous: call it from a thread."""
        self._looked = time.monotonic()
        self._no_disk = self._disk.shortage(0)
        if self._no_disk is not None:
            return Choice(None)
        queue = self._store.queue()
        waiting = {one.job_id for one in queue}
        self._needs = {job: need for job, need in self._needs.items() if job in waiting or job in running}
        held = [need for job in running if (need := self._need(job)) is not None]
        clients: dict[str, int] = {}
        for client_id in running.values():
            clients[client_id] = clients.get(client_id, 0) + 1

        def lacks(job_id: str) -> Shortage | None:
            need = self._need(job_id)
            return None if need is None else self._accountant.shortage(need, held)

        def is_patient(job_id: str) -> bool:
            return self._looked < self._passed_since.get(job_id, self._looked) + PASSED_SECONDS

        found = choose(queue, clients, self._slots, lacks, is_patient)
        self._passed = found.passed
        self._passed_since = {job: self._passed_since.get(job, self._looked) for job in found.passed}
        return found

    def _need(self, job_id: str) -> Need | None:
        """None of a job that is gone or cannot be read: whoever claims it will find out."""
        if job_id not in self._needs:
            try:
                self._needs[job_id] = self._need_of(self._store.get(job_id))
            except (JobNotFound, RowUnreadable):
                return None
        return self._needs[job_id]

    def held(self, running: Mapping[str, str]) -> list[Need]:
        """What the running jobs need, as far as it is known."""
        return [self._needs[job] for job in running if job in self._needs]

    @property
    def waits(self) -> bool:
        """Whether a job that could start is kept by want of memory or disk."""
        return self._no_disk is not None or bool(self._passed)

    @property
    def first_shortage(self) -> Shortage | None:
        """What the first job that cannot start lacks."""
        return self._no_disk or next(iter(self._passed.values()), None)

    @property
    def is_due(self) -> bool:
        """Whether to look again: nobody tells when there is room."""
        return self.waits and time.monotonic() >= self._looked + LOOK_AGAIN_SECONDS

    def shortage_of(self, job_id: str) -> Shortage | None:
        """What keeps a queued job from being started."""
        return self._no_disk or self._passed.get(job_id)
