"""The data folder that a database belongs to: its jobs name files in there."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"


def upgrade() -> None:
    """One row at most."""
    op.create_table("data_folder", sa.Column("identity", sa.Text, primary_key=True))
    op.create_index("events_by_time", "events", ["at"])
