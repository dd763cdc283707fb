"""Whether the database is still the one with which this process started.

SQLite goes on with a file that was deleted, and acknowledges what nobody will ever find again; a server's database may
be dropped and made anew under open connections. Checked around every writing transaction.
"""

from __future__ import annotations

import os
import sqlite3
import threading
from collections.abc import Callable
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

import structlog
from sqlalchemy import Connection, select
from sqlalchemy.exc import OperationalError, ProgrammingError

from service.durable_files import sync_path
from service.store.belonging import rescue_path
from service.store.schema import data_folder

_REPLACED = "the database was replaced by another one while the service ran"


class DatabaseReplaced(Exception):
    """The database was deleted or replaced while the service ran."""


class Presence:
    """The identity of a database in use. path: its file, None where it has none."""

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self._file: tuple[int, int] | None = None
        self._id: str | None = None
        self._lock = threading.Lock()
        self._reason: str | None = None
        # Replaced by who can open a connection to the file.
        self.open_connection: Callable[[], Any] | None = None
        # One that is kept open for what may be deleted: others may all be in use then, and a new one finds nothing.
        self._held: Any = None

    def pin(self, database_id: str) -> None:
        """From now on it must be this one."""
        self._id = database_id
        self._file = _file_of(self._path) if self._path is not None else None
        if self._path is not None and self.open_connection is not None and self._held is None:
            self._held = self.open_connection()

    def close(self) -> None:
        """Let the connection go; one from which a deleted file is being saved stays until that is done."""
        with self._lock:
            if self._reason is None and self._held is not None:
                self._held.close()
                self._held = None

    def check_file(self) -> None:
        """Cheap enough for every transaction. Raises DatabaseReplaced."""
        if self._reason is None and self._file is not None and _file_of(self._path) != self._file:
            what = "deleted" if _file_of(self._path) is None else "replaced by another file"
            self._lose(f"the database {self._path} was {what} while the service ran", is_file_gone=True)
        if self._reason is not None:
            raise DatabaseReplaced(self._reason)

    def check_id(self, connection: Connection) -> None:
        """Inside a transaction. Raises DatabaseReplaced."""
        if self._id is None:
            return
        try:
            found = connection.execute(select(data_folder.c.database_id)).scalar()
        except (OperationalError, ProgrammingError) as error:
            self.judge(error)
            raise
        if found != self._id:
            self._lose(_REPLACED)
            raise DatabaseReplaced(_REPLACED)

    def judge(self, error: Exception) -> None:
        """What a failed statement says: a database without our tables is another one. Raises DatabaseReplaced."""
        has_no_table = "no such table" in str(error) or getattr(getattr(error, "orig", None), "sqlstate", "") == "42P01"
        if self._id is not None and has_no_table:
            self._lose(_REPLACED)
            raise DatabaseReplaced(_REPLACED) from None

    def _lose(self, reason: str, *, is_file_gone: bool = False) -> None:
        with self._lock:
            if self._reason is not None:
                return
            self._reason = reason
        log = structlog.get_logger("service.database")
        log.error("the database is gone: nothing new is taken until the service is started again", why=reason)
        if is_file_gone and self._held is not None:
            # Not a daemon: a service that is stopped now still finishes it.
            threading.Thread(target=self._rescue, name="rescue").start()

    def _rescue(self) -> None:
        """Copy what the deleted file held: it is there as long as a connection is open."""
        assert self._path is not None
        log, target = structlog.get_logger("service.database"), rescue_path(self._path)
        part = target.with_name(f"{target.name}.part")
        try:
            part.unlink(missing_ok=True)
            with closing(self._held) as connection:
                # Its own transactions would begin one, in which SQLite copies nothing.
                connection.cursor().execute("VACUUM INTO ?", (str(part),))
            part.chmod(0o600)
            sync_path(part)
            os.replace(part, target)
            sync_path(target.parent)
            log.warning("what the database held was saved: stop the service and rename that file", file=str(target))
        except (sqlite3.Error, OSError, DatabaseReplaced) as error:
            log.error("what the database held could not be saved", cause=str(error))


def _file_of(path: Path | None) -> tuple[int, int] | None:
    """Device and inode."""
    with suppress(OSError):
        if path is not None:
            found = path.stat()
            return found.st_dev, found.st_ino
    return None
