"""The data folder as a service takes it: its own, readable by its user alone, with the database that belongs to it."""

from __future__ import annotations

import contextlib
import secrets
import stat
from pathlib import Path

import structlog

from service.settings import ServiceSettings
from service.store import Database, DatabaseError
from service.store.belonging import DatabaseFacts, FolderFacts, bind, mismatch
from service.written_once import written_once


def make_folder(folder: Path) -> None:
    """Make the folder, for its user's eyes only: it holds everyone's scenes, pictures and the digests of keys."""
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    mode = stat.S_IMODE(folder.stat().st_mode)
    if mode & 0o077:
        with contextlib.suppress(OSError):  # another user's folder, lent to this one
            folder.chmod(mode & ~0o077)
            structlog.get_logger("service").info("others can look into the data folder no more", folder=str(folder))


def open_database(settings: ServiceSettings, database: Database) -> None:
    """Bring the tables up and bind folder and database to each other. Raises DatabaseError; then nothing was changed.

    The folder must be the caller's: see DataLock.
    """
    folder = _facts(settings)
    known = database.facts()
    missing = database.path if known is None and settings.database_url is None else None
    if why := mismatch(folder, known or DatabaseFacts(), missing):
        raise DatabaseError(why)
    database.create_tables()
    database_id = (known and known.id) or folder.database or secrets.token_hex(16)
    # First the database, which may be taken up again with a folder that does not know it yet.
    with database.write() as connection:
        bind(connection, folder.identity, database_id)
    written_once(settings.database_note, database_id)
    database.pin(database_id)


def _facts(settings: ServiceSettings) -> FolderFacts:
    note = settings.database_note
    noted = note.read_text().strip() or None if note.exists() else None
    kept = (settings.estimates_dir, settings.scenes_dir)
    is_used = any(not one.name.startswith(".") for folder in kept if folder.is_dir() for one in folder.iterdir())
    return FolderFacts(settings.data_dir, settings.data_identity(), noted, is_used)
