"""Connections: SQLite by default, PostgreSQL by URL, the same statements on both.

On SQLite every writing transaction takes the write lock first: anything later loses updates or fails. PostgreSQL
locks the rows that a statement changes; what reads before it writes says FOR UPDATE, which SQLite need not be told.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from typing import Any

from sqlalchemy import Connection, Engine, create_engine, event, insert, select, text
from sqlalchemy.engine import make_url
from sqlalchemy.exc import ArgumentError, NoSuchModuleError

from service.store.schema import data_folder
from service.store.upgrade import upgrade

# Held by whoever writes an event until its transaction ends.
_EVENT_ORDER = 0x46524545
_CONNECT_SECONDS = 5


class DatabaseError(Exception):
    """The database cannot be used."""


def _on_connect(connection: Any, _record: Any) -> None:
    # The driver must not begin transactions of its own; SQLAlchemy's "begin" below does.
    connection.isolation_level = None
    cursor = connection.cursor()
    cursor.execute("PRAGMA busy_timeout=60000")
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
            # A connection that the server closed meanwhile is replaced before it is used.
            is_server = backend == "postgresql"
            how = {"client_encoding": "utf8", "connect_timeout": _CONNECT_SECONDS} if is_server else {}
            self._writing = create_engine(url, pool_pre_ping=is_server, connect_args=how)
        except (ArgumentError, NoSuchModuleError):
            raise DatabaseError("the database URL is not understood; write postgresql://user@host/name") from None
        except ModuleNotFoundError:
            raise DatabaseError("the driver of PostgreSQL is missing; pip install 'fredholm[postgres]'") from None
        self._reading = self._writing
        # SQLite lets one transaction write, and those that wait only look again now and then: on a slow disk one may
        # wait in vain. Threads of this process take turns here instead.
        self._turn = threading.Lock() if backend == "sqlite" else nullcontext()
        if backend == "sqlite":
            self._reading = create_engine(url)
            for engine, begin in ((self._writing, _begin_writing), (self._reading, _begin_reading)):
                event.listen(engine, "connect", _on_connect)
                event.listen(engine, "begin", begin)

    @property
    def engine(self) -> Engine:
        """The engine that writes."""
        return self._writing

    def create_tables(self) -> None:
        """Create what is missing and bring older tables up to date."""
        with self.write() as connection:
            upgrade(connection)

    def belong_to(self, identity: str) -> None:
        """Bind the database to a data folder, whose files its jobs name. Raises DatabaseError."""
        with self.write() as connection:
            known = connection.execute(select(data_folder.c.identity)).scalar()
            if known is None:
                connection.execute(insert(data_folder).values(identity=identity))
            elif known != identity:
                raise DatabaseError("this database belongs to another data folder; give that one, or another database")

    @contextmanager
    def write(self) -> Iterator[Connection]:
        """One transaction that may write; committed at the end of the block."""
        with self._turn, self._writing.begin() as connection:
            yield connection

    @contextmanager
    def read(self) -> Iterator[Connection]:
        """One transaction that only reads."""
        with self._reading.begin() as connection:
            yield connection

    def close(self) -> None:
        """Close all connections."""
        self._writing.dispose()
        self._reading.dispose()


def keep_event_order(connection: Connection) -> None:
    """From here to the end of the transaction, nobody else writes events: their ids become visible in order.

    Without this, PostgreSQL may show event 11 before event 10, and whoever has read 11 never asks for 10.
    """
    if connection.dialect.name == "postgresql":
        connection.execute(text("SELECT pg_advisory_xact_lock(:key)"), {"key": _EVENT_ORDER})
