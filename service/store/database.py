"""Connections.

On SQLite every writing transaction takes the write lock first: anything later loses updates or fails.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from sqlalchemy import Connection, Engine, create_engine, event
from sqlalchemy.engine import make_url

from service.store.upgrade import upgrade


def _on_connect(connection: Any, _record: Any) -> None:
    # The driver must not begin transactions of its own; SQLAlchemy's "begin" below does.
    connection.isolation_level = None
    cursor = connection.cursor()
    cursor.execute("PRAGMA busy_timeout=10000")
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
        self._writing = create_engine(url)
        self._reading = self._writing
        if make_url(url).get_backend_name() == "sqlite":
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

    @contextmanager
    def write(self) -> Iterator[Connection]:
        """One transaction that may write; committed at the end of the block."""
        with self._writing.begin() as connection:
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
