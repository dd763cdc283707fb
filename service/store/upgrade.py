"""Brings the tables of a database up to date at every start; Alembic keeps the version in the database."""

from __future__ import annotations

from pathlib import Path

from alembic import command
from alembic.config import Config
from alembic.script import ScriptDirectory
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


class NewerTables(Exception):
    """The tables are those of a newer version of this program."""


def check_version(connection: Connection) -> None:
    """Whether this program knows the tables. Raises NewerTables."""
    if "alembic_version" not in inspect(connection).get_table_names():
        return
    script = ScriptDirectory.from_config(configuration(connection))
    known = {step.revision for step in script.walk_revisions()}
    for (found,) in connection.execute(text("SELECT version_num FROM alembic_version")).all():
        if found not in known:
            raise NewerTables(
                f"the tables of the database have version {found}, and this program knows them up to "
                f"{script.get_current_head()}: a newer version has used it; start that one, or put back a copy of the "
                "database from before"
            )


def upgrade(connection: Connection) -> None:
    """Take the missing steps, all or none, inside the connection's transaction."""
    if connection.dialect.name == "postgresql":
        connection.execute(text("SET LOCAL lock_timeout = 0"))  # another server's upgrade may take long
        connection.execute(text("SELECT pg_advisory_xact_lock(:key)"), {"key": _ADVISORY_LOCK})
    config = configuration(connection)
    tables = inspect(connection).get_table_names()
    if "jobs" in tables and "alembic_version" not in tables:
        # Made before versions were kept: it has the first tables.
        command.stamp(config, _FIRST)
    command.upgrade(config, "head")
