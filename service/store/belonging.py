"""Which data folder a database belongs to, and which database a folder: each keeps the other's name.

A database names files in its folder, and what no database names is swept away; so a folder with another database,
such as an empty one, would lose everything. What does not belong together is refused with the way out.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from sqlalchemy import Connection, insert, inspect, select, text, update

from service.store.schema import data_folder


@dataclass(frozen=True, slots=True)
class DatabaseFacts:
    """What a database says of itself.

    folder: identity of its data folder; id: its own; None where it does not say. has_rows: it knows jobs or scenes.
    """

    folder: str | None = None
    id: str | None = None
    has_rows: bool = False


@dataclass(frozen=True, slots=True)
class FolderFacts:
    """What a data folder says of itself. database: id of its database; is_used: it holds estimates or scenes."""

    path: Path
    identity: str
    database: str | None
    is_used: bool


def facts_of(connection: Connection) -> DatabaseFacts:
    """Read from tables of any version, or none."""
    tables = set(inspect(connection).get_table_names())
    folder = own = None
    if "data_folder" in tables:
        columns = {column["name"] for column in inspect(connection).get_columns("data_folder")}
        known = [name for name in ("identity", "database_id") if name in columns]
        row = connection.execute(select(*(data_folder.c[name] for name in known))).mappings().first()
        if row is not None:
            folder, own = row["identity"], row.get("database_id")
    has_rows = any(
        connection.execute(text(f"SELECT 1 FROM {name} LIMIT 1")).first() is not None
        for name in ("jobs", "scenes")
        if name in tables
    )
    return DatabaseFacts(folder, own, has_rows)


def bind(connection: Connection, identity: str, database_id: str) -> None:
    """Write both names into the database."""
    if connection.execute(select(data_folder.c.identity)).first() is None:
        connection.execute(insert(data_folder).values(identity=identity, database_id=database_id))
    else:
        connection.execute(update(data_folder).values(database_id=database_id))


def mismatch(folder: FolderFacts, database: DatabaseFacts, missing_file: Path | None = None) -> str | None:
    """Why the two do not belong together, with the way out; None where they do.

    missing_file: of the database, where that is a file which is not there. Pure.
    """
    if database.folder not in (None, folder.identity):
        return (
            f"this database belongs to another data folder than {folder.path}; give that one with --data, or another "
            "database with FREDHOLM_DATABASE_URL"
        )
    if folder.database is not None:
        # A copy from before databases had names says its folder only.
        is_own = database.id == folder.database or (database.id is None and database.folder == folder.identity)
    else:
        is_own = not folder.is_used or database.folder is not None or database.has_rows
    if is_own:
        return None
    anew = "or choose another folder with --data to begin anew"
    if missing_file is not None and (rescued := rescue_path(missing_file)).exists():
        return (
            f"the database {missing_file} was deleted; what it held is in {rescued.name} beside it: rename that, {anew}"
        )
    if missing_file is not None:
        return f"the database {missing_file}, to which this data folder belongs, is not there; put it back, {anew}"
    return (
        f"the data folder {folder.path} belongs to another database than the one given, which knows nothing of its "
        f"files; give its own with FREDHOLM_DATABASE_URL (without it: SQLite in the folder), {anew}"
    )


def rescue_path(database: Path) -> Path:
    """Where the content of a database goes whose file was deleted under a running service."""
    return database.with_name(f"{database.name}.rescued")
