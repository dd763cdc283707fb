"""Clients with keys, leases of running jobs, idempotent submission, and events that outlive their job."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"


def upgrade() -> None:
    """Add columns to jobs in place: SQLite would otherwise drop the table, and with it what refers to it."""
    for column in (
        sa.Column("client_id", sa.Text, nullable=False, server_default=""),
        sa.Column("priority", sa.Integer, nullable=False, server_default="0"),
        sa.Column("idempotency_key", sa.Text),
        sa.Column("request_digest", sa.Text),
        sa.Column("lease_owner", sa.Text),
        sa.Column("lease_until", sa.Text),
    ):
        op.add_column("jobs", column)
    op.create_index("jobs_by_idempotency_key", "jobs", ["client_id", "idempotency_key"], unique=True)
    op.create_index("jobs_by_client", "jobs", ["client_id", "state"])

    op.rename_table("events", "old_events")
    op.drop_index("ix_events_job_id", "old_events")
    op.create_table(
        "events",
        sa.Column("id", sa.Integer, primary_key=True, autoincrement=True),
        sa.Column("job_id", sa.Text, nullable=False),
        sa.Column("client_id", sa.Text, nullable=False, server_default=""),
        sa.Column("at", sa.Text, nullable=False),
        sa.Column("queue_position", sa.Integer),
        sa.Column("job", sa.JSON),
        sqlite_autoincrement=True,
    )
    op.create_index("events_by_job", "events", ["job_id"])
    op.execute(
        "INSERT INTO events (id, job_id, at, queue_position, job) "
        "SELECT id, job_id, at, queue_position, job FROM old_events"
    )
    if op.get_context().dialect.name == "postgresql":
        op.execute("SELECT setval(pg_get_serial_sequence('events', 'id'), coalesce(max(id), 0) + 1, false) FROM events")
    op.drop_table("old_events")

    op.create_table(
        "api_keys",
        sa.Column("id", sa.Text, primary_key=True),
        sa.Column("client", sa.Text, nullable=False),
        sa.Column("role", sa.Text, nullable=False),
        sa.Column("digest", sa.Text, nullable=False, unique=True),
        sa.Column("created_at", sa.Text, nullable=False),
        sa.Column("revoked_at", sa.Text),
    )
    op.create_table(
        "scene_clients",
        sa.Column("scene_id", sa.Text, sa.ForeignKey("scenes.id", ondelete="CASCADE"), primary_key=True),
        sa.Column("client_id", sa.Text, primary_key=True),
        sa.Column("name", sa.Text, nullable=False),
        sa.Column("created_at", sa.Text, nullable=False),
    )
    op.execute(
        "INSERT INTO scene_clients (scene_id, client_id, name, created_at) SELECT id, '', name, created_at FROM scenes"
    )
