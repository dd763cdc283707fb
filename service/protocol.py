"""HTTP parsing with limits: a request whose head is too long or no HTTP is answered with a problem body."""

from __future__ import annotations

import json
from typing import Any

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

MAX_HEAD_BYTES = 64 << 10
MAX_HEADERS = 100


class LimitedProtocol(HttpToolsProtocol):
    """Counts what arrives before the body: the parser itself would take any amount."""

    _head_bytes = 0
    _refusal: tuple[int, str, str] | None = None

    def on_message_begin(self) -> None:
        """A request begins."""
        self._head_bytes = 0
        super().on_message_begin()

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
        reason = {400: "Bad Request", 431: "Request Header Fields Too Large"}[status]
        head = (
            f"HTTP/1.1 {status} {reason}\r\ncontent-type: application/problem+json\r\n"
            f"content-length: {len(body)}\r\nx-content-type-options: nosniff\r\nconnection: close\r\n\r\n"
        )
        self.transport.write(head.encode() + body)
        self.transport.close()
