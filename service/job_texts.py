"""Jobs as a list tells them: written as JSON once, and again only when something about them has changed."""

from __future__ import annotations

from service.messages import Job
from service.store import JobRecord

_KEPT = 2000


class JobTexts:
    """The newest text of each job. For use from one event loop."""

    def __init__(self) -> None:
        # By job: what its text was made of, and the text.
        self._texts: dict[str, tuple[tuple[object, ...], bytes]] = {}

    def text(
        self,
        stored: JobRecord,
        job: JobRecord,
        place: int | None,
        expected_start: str | None,
        waits_for: str | None = None,
    ) -> bytes:
        """A job as the JSON of a `Job`. stored: as the store told it; job: with what its renderer has told since."""
        # Values that are replaced when they change: comparing those that have not takes no look into them.
        made_of = (stored, job.progress, job.warnings, job.losses, place, expected_start, waits_for)
        kept = self._texts.get(job.id)
        if kept is not None and kept[0] == made_of:
            return kept[1]
        told = Job.of(job, queue_position=place, expected_start=expected_start, waits_for=waits_for)
        text = told.model_dump_json().encode()
        if len(self._texts) >= _KEPT:
            self._texts.clear()
        self._texts[job.id] = made_of, text
        return text
