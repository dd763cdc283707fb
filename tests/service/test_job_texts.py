"""The JSON of jobs in a list."""

from __future__ import annotations

from dataclasses import replace

from service.job_texts import JobTexts
from service.messages import Job
from service.states import State
from service.store import JobRecord, Progress

SETTINGS = {"width": 4, "height": 4, "seed": 1, "max_depth": None, "technique": "mis"}
JOB = JobRecord(
    *(1, "a", "Box", "gallery", "cornell-box", "Box", State.QUEUED),
    *({"error": None, "seconds": 1.0, "spp": None}, SETTINGS),
    *("2026-01-01T00:00:00.000Z", None, None, 0, 0, None, Progress(), None, None, ()),
)


def test_a_job_is_written_as_its_message() -> None:
    told = Job.of(JOB, queue_position=3, expected_start="2026-01-01T00:01:00.000Z").model_dump_json().encode()
    assert JobTexts().text(JOB, JOB, 3, "2026-01-01T00:01:00.000Z") == told


def test_it_is_written_again_only_when_something_has_changed() -> None:
    texts = JobTexts()
    first = texts.text(JOB, JOB, 3, None)
    assert texts.text(JOB, replace(JOB), 3, None) is first
    assert b'"queue_position":2' in texts.text(JOB, JOB, 2, None)
    assert b'"spp":8.0' in texts.text(JOB, replace(JOB, progress=Progress(spp=8.0)), 2, None)
    assert b'"warnings":["dark"]' in texts.text(JOB, replace(JOB, warnings=("dark",)), 2, None)
    cancelled = replace(JOB, state=State.CANCELLED)
    assert b'"state":"cancelled"' in texts.text(cancelled, cancelled, None, None)
