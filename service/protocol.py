"""HTTP parsing with limits: a request whose head is too long, too slow or no HTTP is answered with a problem body."""

from __future__ import annotations

import asyncio
import json
from typing import Any

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from service.connections import KNOWN, Connections
from service.settings import ServiceSettings

MAX_HEAD_BYTES = 64 << 10
MAX_HEADERS = 100
LEAST_RATE = 1024.0  # bytes a second of a body, and of an answer that somebody takes


class LimitedProtocol(HttpToolsProtocol):
    """Counts what arrives before the body, which the parser would take any amount of, and waits for nothing for ever.

    head_seconds: from a connection, or from the first byte of a request, to the end of its head. silence_seconds:
    within a body that has not ended, and of a reader who does not take its answer. A body that is slower than
    LEAST_RATE once it has had as long as a head may take is not waited for either, nor one that takes body_seconds.
    places: where this connection is counted. are_keys_required: senders are known by their keys, and otherwise once
    they have sent a whole request.
    """

    places = Connections(1 << 16, 1 << 16)
    are_keys_required = False
    body_seconds = 900.0

    head_seconds = 10.0
    silence_seconds = 30.0

    _body_bytes = 0
    _body_began = 0.0
    _unread_bytes = 0
    _reader: asyncio.TimerHandle | None = None

    _head_bytes = 0
    _refusal: tuple[int, str, str] | None = None
    _is_in_head = False
    _patience: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """A connection begins."""
        super().connection_made(transport)
        self.places.opened(self)
        self._wait(self.head_seconds)

    def connection_lost(self, exc: Exception | None) -> None:
        """A connection is over."""
        self._wait(None)
        self._watch_reader(False)
        self.places.closed(self)
        super().connection_lost(exc)

    def end(self) -> None:
        """Close it now: others need its place."""
        self.transport.abort()

    def on_message_begin(self) -> None:
        """A request begins."""
        self._head_bytes = 0
        self._is_in_head = True
        self._wait(self.head_seconds)
        super().on_message_begin()

    def on_headers_complete(self) -> None:
        """Its head has ended."""
        self._is_in_head = False
        self._body_bytes, self._body_began = 0, self.loop.time()
        self._wait(self.silence_seconds)
        self.scope.setdefault("state", {})[KNOWN] = self._is_known
        super().on_headers_complete()

    def _is_known(self) -> None:
        """What asks is told here whose key came with the head."""
        if self.are_keys_required:
            self.places.is_known(self)

    def on_body(self, body: bytes) -> None:
        """A part of its body."""
        self._body_bytes += len(body)
        seconds = self.loop.time() - self._body_began
        is_slow = seconds > self.head_seconds and self._body_bytes < LEAST_RATE * seconds
        if (is_slow or seconds > self.body_seconds) and not self.flow.read_paused:
            self.transport.close()
        self._wait(self.silence_seconds)
        super().on_body(body)

    def on_message_complete(self) -> None:
        """It has arrived."""
        self._wait(None)
        if not self.are_keys_required:
            self.places.is_known(self)
        super().on_message_complete()

    def pause_writing(self) -> None:
        """More of an answer waits for its reader than should."""
        super().pause_writing()
        self._watch_reader(True)

    def resume_writing(self) -> None:
        """Its reader has taken most of it."""
        super().resume_writing()
        self._watch_reader(False)

    def _watch_reader(self, is_behind: bool) -> None:
        if self._reader is not None:
            self._reader.cancel()
        self._reader = None
        if is_behind:
            self._unread_bytes = self.transport.get_write_buffer_size()
            self._reader = self.loop.call_later(self.silence_seconds, self._look_at_reader)

    def _look_at_reader(self) -> None:
        """What a reader does not take stays in memory: one that takes next to nothing is not waited for."""
        if self._unread_bytes - self.transport.get_write_buffer_size() < LEAST_RATE * self.silence_seconds:
            self.transport.abort()
        else:
            self._watch_reader(True)

    def _wait(self, seconds: float | None) -> None:
        if self._patience is not None:
            self._patience.cancel()
        self._patience = None if seconds is None else self.loop.call_later(seconds, self._lose_patience)

    def _lose_patience(self) -> None:
        if self.flow.read_paused:  # the service itself does not read: it has more than it can take
            self._wait(self.silence_seconds)
        elif self._is_in_head:
            self._refusal = (408, "Too slow", f"The head of a request must arrive within {self.head_seconds:g} s.")
            self.send_400_response("")
        else:
            self.transport.close()

    def on_url(self, url: bytes) -> None:
        """A part of the address."""
        self._count(len(url))
        super().on_url(url)

    def on_header(self, name: bytes, value: bytes) -> None:
        """A header line."""
        self._count(len(name) + len(value))
        if len(self.headers) >= MAX_HEADERS:
            self._refuse(431, "Too many headers", f"A request may have {MAX_HEADERS} headers.")
        super().on_header(name, value)

    def _count(self, size: int) -> None:
        self._head_bytes += size
        if self._head_bytes > MAX_HEAD_BYTES:
            self._refuse(431, "Headers too long", f"Address and headers may have {MAX_HEAD_BYTES >> 10} KiB.")

    def _refuse(self, status: int, title: str, detail: str) -> None:
        self._refusal = (status, title, detail)
        raise ValueError(title)

    def send_400_response(self, msg: str) -> None:
        """Answer what cannot be parsed, and close."""
        status, title, detail = self._refusal or (400, "Bad Request", "This is not a request that HTTP knows.")
        self._refusal = None
        problem: dict[str, Any] = {"type": "about:blank", "title": title, "status": status, "detail": detail}
        body = json.dumps(problem).encode()
        reason = {400: "Bad Request", 408: "Request Timeout", 431: "Request Header Fields Too Large"}[status]
        head = (
            f"HTTP/1.1 {status} {reason}\r\ncontent-type: application/problem+json\r\n"
            f"content-length: {len(body)}\r\nx-content-type-options: nosniff\r\nconnection: close\r\n\r\n"
        )
        self.transport.write(head.encode() + body)
        self.transport.close()


def protocol_for(settings: ServiceSettings, most_connections: int) -> type[LimitedProtocol]:
    """The protocol with the limits of a service."""
    strangers = min(settings.max_unknown_connections, most_connections)
    limits: dict[str, Any] = {
        "head_seconds": settings.request_head_seconds,
        "silence_seconds": settings.body_silence_seconds,
        "body_seconds": settings.body_seconds,
        "are_keys_required": settings.are_keys_required,
        "places": Connections(most_connections, strangers),
    }
    return type("Protocol", (LimitedProtocol,), limits)
