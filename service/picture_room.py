"""Memory for work on pictures: reading, encoding, sending take many bytes a pixel, and many may ask at once."""

from __future__ import annotations

import asyncio
import os
from collections import deque
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import structlog
from starlette.responses import Response
from starlette.types import Receive, Scope, Send

# Per pixel, measured: to read a saved estimate, to encode a frame or a PNG of a display.
READ_BYTES, ENCODE_BYTES, PNG_BYTES = 330, 60, 80
ROOM_BYTES = 384 << 20
_SHORT_BYTES = 8 << 20  # of work that takes hundredths of a second
_PART_BYTES = 64 << 10
_SEND_SECONDS, _SEND_RATE = 60.0, 16 << 10  # for an answer; beyond that, bytes a second that it is taken with


class PictureRoom:
    """So many bytes and so many pieces of work at a time; who needs more than are left waits in its client's line.

    Lines have their turns one after the other, so that one who asks for hundreds of pictures makes itself wait. Work
    that needs more bytes than there are has them alone. A processor is left to whoever renders: one of many pixels
    takes seconds. at_once: pieces of work that are not short.
    """

    def __init__(self, size: int = ROOM_BYTES, at_once: int | None = None) -> None:
        self._size = size
        self._free = size
        self._places = max(1, (os.cpu_count() or 1) - 1) if at_once is None else at_once
        self._waiting: dict[str, deque[tuple[int, asyncio.Future[None]]]] = {}  # in the order of their turns

    @asynccontextmanager
    async def taking(self, size: int, client: str = "") -> AsyncIterator[None]:
        """Room for some work of a client, while the block lasts."""
        size = min(size, self._size)
        place: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._waiting.setdefault(client, deque()).append((size, place))
        self._give()
        try:
            await place
            yield
        finally:
            if place.done() and not place.cancelled():
                self._free += size
                self._places += size > _SHORT_BYTES
            self._give()

    def _give(self) -> None:
        """Begin what there is room for. Nobody goes before one who waits for bytes: large work would never begin."""
        for client in list(self._waiting):
            line = self._waiting[client]
            while line and line[0][1].done():  # given up
                line.popleft()
            if not line:
                del self._waiting[client]
                continue
            size, place = line[0]
            is_long = size > _SHORT_BYTES
            if is_long and self._places < 1:
                continue  # what is short need not wait for a processor
            if size > self._free:
                return
            line.popleft()
            del self._waiting[client]
            if line:
                self._waiting[client] = line  # behind the others
            self._free -= size
            self._places -= is_long
            place.set_result(None)
            self._give()
            return

    @property
    def free(self) -> int:
        """Bytes that nobody has."""
        return self._free


class SharedBody(Response):
    """A body that many are sent, in parts: who reads slowly keeps a part, and the whole for a bounded time."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        await send({"type": "http.response.start", "status": self.status_code, "headers": self.raw_headers})
        body = memoryview(self.body)
        seconds = _SEND_SECONDS + len(body) / _SEND_RATE
        try:
            async with asyncio.timeout(seconds):
                for start in range(0, len(body), _PART_BYTES):
                    part = bytes(body[start : start + _PART_BYTES])
                    await send({"type": "http.response.body", "body": part, "more_body": True})
                await send({"type": "http.response.body", "body": b"", "more_body": False})
        except TimeoutError:
            # An answer without its end: the server closes the connection.
            structlog.get_logger("service.pictures").warning("a picture was not taken in time", seconds=round(seconds))
