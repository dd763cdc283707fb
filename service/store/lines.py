"""Lines to a PostgreSQL server that may fall silent: how long each step may take, and how to cut those that hang.

A server that is stopped or cut off leaves its connections open. Statements that it works at for too long it ends
itself; a network without answers is given up by the system after some seconds; of a server whose machine still
acknowledges what it is sent, whoever asks is told after a while (`threads`), and the thread goes on once it does.
"""

from __future__ import annotations

import contextlib
import os
import socket
import threading
from typing import Any
from weakref import WeakSet

from sqlalchemy import Engine, create_engine, event

CONNECT_SECONDS = 5
_SILENCE_SECONDS = 8  # of a network, within which nothing of what was sent is acknowledged
_READ_SECONDS, _LOCK_SECONDS = (
    5,
    5,
)  # that the server works at a statement that reads; that one waits for another's lock
_POOL_SECONDS = 1.0
_NETWORK = {
    "keepalives": 1,
    "keepalives_idle": 5,
    "keepalives_interval": 2,
    "keepalives_count": 2,
    "tcp_user_timeout": 1000 * _SILENCE_SECONDS,
}


class Lines:
    """The connections of one database to its server."""

    def __init__(self) -> None:
        self._open: WeakSet[Any] = WeakSet()
        self._lock = threading.Lock()

    def engine(self, url: str, threads: int, *, is_reading: bool = False) -> Engine:
        """An engine with a connection for each thread that uses it, and some for those that are lent none."""
        how = {"client_encoding": "utf8", "connect_timeout": CONNECT_SECONDS} | _NETWORK
        # A connection that the server closed meanwhile is replaced before it is used.
        engine = create_engine(
            url,
            pool_pre_ping=True,
            pool_size=threads,
            max_overflow=threads,
            pool_timeout=_POOL_SECONDS,
            connect_args=how,
        )
        limits = f"SET lock_timeout = {1000 * _LOCK_SECONDS}"
        if is_reading:
            limits += f"; SET statement_timeout = {1000 * _READ_SECONDS}"

        def on_connect(connection: Any, _record: Any) -> None:
            connection.execute(limits)
            connection.commit()
            with self._lock:
                self._open.add(connection)

        event.listen(engine, "connect", on_connect)
        return engine

    def cut(self) -> None:
        """End what hangs: whoever waits on one of these connections gets an error now."""
        with self._lock:
            some = list(self._open)
        for connection in some:
            with contextlib.suppress(Exception), socket.socket(fileno=os.dup(connection.fileno())) as line:
                line.shutdown(socket.SHUT_RDWR)
