"""How many connections there may be, and which one ends where there are too many.

A *stranger* is a connection of which nothing is known yet: no request has come, or none whose sender has a key (where
none is asked for: none that has arrived as a whole). Those are closed, the oldest first, where a crowd of them stands
in the way; whoever is known is not. What is known of a connection holds until it is closed, as idle ones soon are.
"""

from __future__ import annotations

import contextlib
from typing import Protocol

import structlog

KNOWN = "fredholm.known"  # in a request's scope: what to call once its sender is known
_RESERVED = 128  # descriptors that are not for connections: files, database, processes


class Connection(Protocol):
    """What is open."""

    def end(self) -> None:
        """Close it now."""
        ...


class Connections:
    """Those of one server. most: of all. strangers: of those of which nothing is known."""

    def __init__(self, most: int, strangers: int) -> None:
        self._most = most
        self._most_strangers = strangers
        self._all: set[Connection] = set()
        self._strangers: dict[Connection, None] = {}  # oldest first
        self._log = structlog.get_logger("service.connections")

    def opened(self, connection: Connection) -> None:
        """One more."""
        self._all.add(connection)
        self._strangers[connection] = None
        if len(self._strangers) > self._most_strangers:
            self._log.warning("too many connections without a known sender: the oldest is closed")
            self._end(next(iter(self._strangers)))
        elif len(self._all) > self._most:
            self._log.warning("too many connections: one is closed", limit=self._most)
            self._end(next(iter(self._strangers)))

    def is_known(self, connection: Connection) -> None:
        """Its sender may ask."""
        self._strangers.pop(connection, None)

    def closed(self, connection: Connection) -> None:
        """One less."""
        self._all.discard(connection)
        self._strangers.pop(connection, None)

    def _end(self, connection: Connection) -> None:
        self.closed(connection)
        connection.end()

    def __len__(self) -> int:
        return len(self._all)


def most_connections(wanted: int) -> int:
    """As many as are wanted, and as descriptors are left for."""
    with contextlib.suppress(ImportError, ValueError, OSError):  # Windows has no such limit
        import resource

        soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
        if soft != resource.RLIM_INFINITY:
            return max(16, min(wanted, soft - min(_RESERVED, soft // 2)))
    return wanted
