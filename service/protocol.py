"""HTTP parsing with limits: a request whose head is too long, too slow or no HTTP is answered with a problem body."""

from __future__ import annotations

import asyncio
import json
from typing import Any

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

MAX_HEAD_BYTES = 64 << 10
MAX_HEADERS = 100


class LimitedProtocol(HttpToolsProtocol):
    """Counts what arrives before the body, which the parser would take any amount of, and waits for nothing for ever.

    head_seconds: from a connection, or from the first byte of a request, to the end of its head. silence_seconds:
    within a body that has not ended.
    """

    head_seconds = 10.0
    silence_seconds = 30.0

    _head_bytes = 0
    _refusal: tuple[int, str, str] | None = None
    _is_in_head = False
    _patience: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """A connection begins."""
        super().connection_made(transport)
        self._wait(self.head_seconds)

    def connection_lost(self, exc: Exception | None) -> None:
        """A connection is over."""
        self._wait(None)
        super().connection_lost(exc)

    def on_message_begin(self) -> None:
        """A request begins."""
        self._head_bytes = 0
        self._is_in_head = True
        self._wait(self.head_seconds)
        super().on_message_begin()

    def on_headers_complete(self) -> None:
        """Its head has ended."""
        self._is_in_head = False
        self._wait(self.silence_seconds)
        super().on_headers_complete()

    def on_body(self, body: bytes) -> None:
        """A part of its body."""
        self._wait(self.silence_seconds)
        super().on_body(body)

    def on_message_complete(self) -> None:
        """It has arrived."""
        self._wait(None)
        super().on_message_complete()

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


def protocol_for(head_seconds: float, silence_seconds: float) -> type[LimitedProtocol]:
    """The protocol with these limits."""
    return type("Protocol", (LimitedProtocol,), {"head_seconds": head_seconds, "silence_seconds": silence_seconds})
