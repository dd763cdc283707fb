"""Jobs that were queued together know it."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"


def upgrade() -> None:
    """A column alone; jobs of older versions are in no series."""
    op.add_column("jobs", sa.Column("series", sa.Text))
    op.create_index("jobs_by_series", "jobs", ["series"])
