"""Connections: SQLite by default, PostgreSQL by URL, the same statements on both.

On SQLite every writing transaction takes the write lock first: anything later loses updates or fails. PostgreSQL
locks the rows that a statement changes; what reads before it writes says FOR UPDATE, which SQLite need not be told.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, Engine, create_engine, event, text
from sqlalchemy.engine import make_url
from sqlalchemy.exc import ArgumentError, NoSuchModuleError, OperationalError, ProgrammingError
from sqlalchemy.exc import TimeoutError as PoolTimeout

from service.store.belonging import DatabaseFacts, facts_of
from service.store.lines import Lines
from service.store.presence import Presence
from service.store.threads import READERS, WRITERS, check_wanted
from service.store.turns import Turns
from service.store.upgrade import NewerTables, check_version, upgrade

# Held by whoever writes an event until its transaction ends.
_EVENT_ORDER = 0x46524545
_WRITE_SECONDS = 1.0  # that a transaction waits for another one's end; who waits for longer is told to come again


class DatabaseError(Exception):
    """The database cannot be used."""


def _on_connect(connection: Any, _record: Any) -> None:
    # The driver must not begin transactions of its own; SQLAlchemy's "begin" below does.
    connection.isolation_level = None
    cursor = connection.cursor()
    cursor.execute(f"PRAGMA busy_timeout={round(1000 * _WRITE_SECONDS)}")
    cursor.execute("PRAGMA journal_mode=WAL")
    cursor.execute("PRAGMA synchronous=FULL")
    cursor.execute("PRAGMA foreign_keys=ON")
    cursor.close()


def _begin_writing(connection: Connection) -> None:
    connection.exec_driver_sql("BEGIN IMMEDIATE")


def _begin_reading(connection: Connection) -> None:
    connection.exec_driver_sql("BEGIN")


class Database:
    """One engine that writes and one that only reads, so that readers never wait for the write lock."""

    def __init__(self, url: str) -> None:
        """Raises DatabaseError for a URL that is not understood, or whose driver is not installed."""
        try:
            backend = make_url(url).get_backend_name()
            if backend not in ("sqlite", "postgresql"):
                raise DatabaseError(f"the database {backend} is not supported; use sqlite:/// or postgresql://")
            self._lines = Lines()
            self._writing = self._lines.engine(url, WRITERS) if backend == "postgresql" else create_engine(url)
        except (ArgumentError, NoSuchModuleError):
            raise DatabaseError("the database URL is not understood; write postgresql://user@host/name") from None
        except ModuleNotFoundError:
            raise DatabaseError("the driver of PostgreSQL is missing; pip install 'fredholm[postgres]'") from None
        # SQLite lets one transaction write, and those that wait only look again now and then: on a slow disk one may
        # wait in vain. Threads of this process take turns here instead.
        self._turn = Turns() if backend == "sqlite" else None
        name = make_url(url).database
        self.path = Path(name) if backend == "sqlite" and name and name != ":memory:" else None
        self._presence = Presence(self.path)
        if backend == "postgresql":
            self._reading = self._lines.engine(url, READERS, is_reading=True)
        else:
            self._reading = create_engine(url)
            for engine, begin in ((self._writing, _begin_writing), (self._reading, _begin_reading)):
                # A connection to a file that was deleted would make an empty one in its place.
                event.listen(engine, "do_connect", lambda *_: self._presence.check_file())
                event.listen(engine, "connect", _on_connect)
                event.listen(engine, "begin", begin)
            self._presence.open_connection = self._reading.raw_connection

    @property
    def engine(self) -> Engine:
        """The engine that writes."""
        return self._writing

    def facts(self) -> DatabaseFacts | None:
        """What it says of itself, of whatever version it is; None where there is no file yet. Raises DatabaseError."""
        if self.path is not None and (not self.path.exists() or self.path.stat().st_size == 0):
            return None
        with self._reading.begin() as connection:
            _check_version(connection)
            return facts_of(connection)

    def create_tables(self) -> None:
        """Create what is missing and bring older tables up to date. Raises DatabaseError for newer ones."""
        with self.write() as connection:
            _check_version(connection)
            upgrade(connection)

    def pin(self, database_id: str) -> None:
        """From now on it must be this one: whatever else lies at its address raises DatabaseReplaced."""
        self._presence.pin(database_id)

    def verify(self) -> None:
        """Whether it answers and is still the one that was pinned. Raises DatabaseReplaced, SQLAlchemyError."""
        with self.read() as connection:
            self._presence.check_id(connection)

    def check_presence(self) -> None:
        """Whether its file is still there; takes no transaction. Raises DatabaseReplaced."""
        self._presence.check_file()

    @contextmanager
    def write(self) -> Iterator[Connection]:
        """One transaction that may write; committed at the end of the block.

        Raises where others write for too long, and DatabaseReplaced.
        """
        self._presence.check_file()
        with self._in_turn(), self._writing.begin() as connection:
            self._presence.check_id(connection)
            yield connection
            check_wanted()
        # What was committed to a file that is deleted is not kept, and must not be acknowledged.
        self._presence.check_file()

    @contextmanager
    def _in_turn(self) -> Iterator[None]:
        if self._turn is None:
            yield
            return
        if not self._turn.acquire(_WRITE_SECONDS):
            raise PoolTimeout("another transaction writes")
        try:
            yield
        finally:
            self._turn.release()

    @contextmanager
    def read(self) -> Iterator[Connection]:
        """One transaction that only reads. Raises DatabaseReplaced."""
        self._presence.check_file()
        with self._reading.begin() as connection:
            try:
                yield connection
            except (OperationalError, ProgrammingError) as error:
                self._presence.judge(error)
                raise

    def close(self) -> None:
        """Close all connections, also those on which somebody waits for a database that does not answer."""
        self._lines.cut()
        self._presence.close()
        self._writing.dispose()
        self._reading.dispose()


def _check_version(connection: Connection) -> None:
    try:
        check_version(connection)
    except NewerTables as newer:
        raise DatabaseError(str(newer)) from None


def keep_event_order(connection: Connection) -> None:
    """From here to the end of the transaction, nobody else writes events: their ids become visible in order.

    Without this, PostgreSQL may show event 11 before event 10, and whoever has read 11 never asks for 10.
    """
    if connection.dialect.name == "postgresql":
        connection.execute(text("SELECT pg_advisory_xact_lock(:key)"), {"key": _EVENT_ORDER})
