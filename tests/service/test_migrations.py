"""Databases of any age are brought up to date, and end up as the code describes them."""

from __future__ import annotations

import json

from alembic import command
from alembic.autogenerate import compare_metadata
from alembic.runtime.migration import MigrationContext
from sqlalchemy import JSON, column, insert, table, text

from service.store import Database, JobStore
from service.store.schema import metadata
from service.store.upgrade import configuration

FIRST_EVENTS = table("events", column("job_id"), column("at"), column("job", JSON))


def test_the_steps_lead_to_the_tables_of_the_code(database_url: str) -> None:
    database = Database(database_url)
    database.create_tables()
    with database.write() as connection:
        options = {"compare_type": True, "compare_server_default": False}
        assert compare_metadata(MigrationContext.configure(connection, opts=options), metadata) == []
        command.check(configuration(connection))
    database.create_tables()
    database.close()


def test_a_database_from_before_versions_keeps_its_jobs_and_events(database_url: str) -> None:
    old = Database(database_url)
    with old.write() as connection:
        command.upgrade(configuration(connection), "0001")
        connection.execute(text("DROP TABLE alembic_version"))
        for number, name in ((1, "a"), (2, "b")):
            connection.execute(
                text(
                    "INSERT INTO jobs (number, id, name, scene_kind, scene_ref, scene_name, state, target, settings, "
                    "created_at, attempt, crashes, frame_seq, progress, curve, warnings) VALUES (:number, :name, 'n', "
                    "'gallery', 'cornell-box', 'n', 'queued', '{}', '{}', '2026-01-01T00:00:00.000Z', 0, 0, 0, "
                    "'{}', '[]', '[]')"
                ),
                {"number": number, "name": name},
            )
            told = (
                '{"number": 1, "id": "a", "name": "n", "scene_kind": "gallery", "scene_ref": "cornell-box", '
                '"scene_name": "n", "state": "queued", "target": {}, "settings": {}, "created_at": "t", '
                '"started_at": null, "finished_at": null, "attempt": 0, "crashes": 0, "checkpoint": null, '
                '"progress": {}, "stopped_by": null, "cause": null, "warnings": []}'
            )
            connection.execute(insert(FIRST_EVENTS).values(job_id=name, at="2026-01-01", job=json.loads(told)))
    old.create_tables()
    jobs = JobStore(old)
    assert [waiting.job_id for waiting in jobs.queue()] == ["a", "b"]
    assert [(event.id, event.job_id) for event in jobs.events_after(0, 10)] == [(1, "a"), (2, "b")]
    claimed = jobs.claim()
    assert claimed is not None
    assert claimed.client_id == ""
    assert jobs.last_event_id() == 3
    old.close()
