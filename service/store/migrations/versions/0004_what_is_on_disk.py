"""A name of the database itself; checksums of saved estimates, the one before the newest, what was lost of a job."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"


def upgrade() -> None:
    """Columns alone; what older versions have saved has no checksum."""
    op.add_column("data_folder", sa.Column("database_id", sa.Text))
    for column in (
        sa.Column("checkpoint_digest", sa.Text),
        sa.Column("earlier", sa.JSON(none_as_null=True)),
        sa.Column("losses", sa.JSON(none_as_null=True)),
    ):
        op.add_column("jobs", column)
