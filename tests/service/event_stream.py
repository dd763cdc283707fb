"""Reads server-sent events in a thread, as a page would."""

from __future__ import annotations

import contextlib
import json
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Self

import httpx


@dataclass(frozen=True)
class Received:
    """One event."""

    kind: str
    id: str | None
    data: dict[str, Any]


class EventStream:
    """An open stream; `events` grows while it lasts."""

    def __init__(self, url: str, last_event_id: int | None = None, key: str | None = None) -> None:
        self.events: list[Received] = []
        self.headers: dict[str, str] = {}
        self.is_over = threading.Event()
        self._sockets: list[socket.socket] = []
        headers = {} if last_event_id is None else {"Last-Event-ID": str(last_event_id)}
        if key is not None:
            headers["Authorization"] = f"Bearer {key}"
        self._client = httpx.Client(timeout=httpx.Timeout(10, read=None))
        self._request = self._client.build_request("GET", f"{url}/api/events", headers=headers)
        self._thread = threading.Thread(target=self._read, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        self.wait(lambda events: bool(events))
        return self

    def __exit__(self, *_: object) -> None:
        # Closing a socket in which another thread reads would not tell the other side.
        for stream in self._sockets:
            with contextlib.suppress(OSError):
                stream.shutdown(socket.SHUT_RDWR)
        self._client.close()

    def _read(self) -> None:
        try:
            response = self._client.send(self._request, stream=True)
            self._sockets.append(response.extensions["network_stream"].get_extra_info("socket"))
            self.headers = dict(response.headers)
            fields: dict[str, str] = {}
            for line in response.iter_lines():
                if line:
                    name, _, value = line.partition(": ")
                    fields[name] = value
                elif "event" in fields:
                    self.events.append(Received(fields["event"], fields.get("id"), json.loads(fields["data"])))
                    fields = {}
        except (httpx.TransportError, httpx.StreamError, OSError):
            pass
        finally:
            self.is_over.set()

    def wait(self, until: Callable[[list[Received]], bool], seconds: float = 30) -> list[Received]:
        """The events once `until` holds."""
        ends = time.monotonic() + seconds
        while not until(self.events):
            assert time.monotonic() < ends, f"not seen within {seconds} s: {self.events[-5:]}"
            time.sleep(0.02)
        return list(self.events)
