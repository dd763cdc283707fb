"""Brings the tables of a database up to date at every start; Alembic keeps the version in the database."""

from __future__ import annotations

from pathlib import Path

from alembic import command
from alembic.config import Config
from sqlalchemy import Connection, inspect, text

_FIRST = "0001"
# Two servers that start at once on one PostgreSQL must not both create the tables.
_ADVISORY_LOCK = 0x46524544


def configuration(connection: Connection) -> Config:
    """Alembic's configuration for a connection, without a file."""
    config = Config()
    config.set_main_option("script_location", str(Path(__file__).parent / "migrations"))
    config.attributes["connection"] = connection
    return config


def upgrade(connection: Connection) -> None:
    """Take the missing steps, all or none, inside the connection's transaction."""
    if connection.dialect.name == "postgresql":
        connection.execute(text("SELECT pg_advisory_xact_lock(:key)"), {"key": _ADVISORY_LOCK})
    config = configuration(connection)
    tables = inspect(connection).get_table_names()
    if "jobs" in tables and "alembic_version" not in tables:
        # Made before versions were kept: it has the first tables.
        command.stamp(config, _FIRST)
    command.upgrade(config, "head")
