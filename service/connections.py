"""How many connections there may be, and which one ends where there are too many.

A *stranger* is a connection of which nothing is known yet: no request has come, or none whose sender has a key (where
none is asked for: none that has arrived as a whole). Those are closed, the oldest first, where a crowd of them stands
in the way, but none before it had a moment to speak; whoever is known is not. What is known of a connection holds until
it is closed, as idle ones soon are.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from typing import Protocol

import structlog

KNOWN = "fredholm.known"  # in a request's scope: what to call once its sender is known
GRACE_SECONDS = 0.5  # that a connection has to say who it is, however many come in that moment
_RESERVED = 128  # descriptors that are not for connections: files, database, processes


class Connection(Protocol):
    """What is open."""

    def end(self) -> None:
        """Close it now."""
        ...


class Connections:
    """Those of one server. most: of all. strangers: of those of which nothing is known. grace: seconds to speak."""

    def __init__(self, most: int, strangers: int, grace: float = GRACE_SECONDS) -> None:
        self._most = most
        self._most_strangers = strangers
        self._grace = grace
        self._all: set[Connection] = set()
        self._strangers: dict[Connection, float] = {}  # since when, oldest first
        self._look: asyncio.TimerHandle | None = None
        self._log = structlog.get_logger("service.connections")

    def opened(self, connection: Connection) -> None:
        """One more; within an event loop."""
        self._all.add(connection)
        self._strangers[connection] = time.monotonic()
        if len(self._all) > self._most:
            self._log.warning("too many connections: one is closed", limit=self._most)
            self._end(next(iter(self._strangers)))
        self._make_room()

    def is_known(self, connection: Connection) -> None:
        """Its sender may ask."""
        self._strangers.pop(connection, None)

    def closed(self, connection: Connection) -> None:
        """One less."""
        self._all.discard(connection)
        self._strangers.pop(connection, None)

    def _make_room(self) -> None:
        """Close the oldest strangers of too many, but none before it had the time to say who it is."""
        now = time.monotonic()
        while len(self._strangers) > self._most_strangers:
            oldest, since = next(iter(self._strangers.items()))
            if now - since < self._grace:
                if self._look is None:
                    self._look = asyncio.get_running_loop().call_later(self._grace - (now - since), self._look_again)
                return
            self._log.warning("too many connections without a known sender: the oldest is closed")
            self._end(oldest)

    def _look_again(self) -> None:
        self._look = None
        self._make_room()

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
