"""The clients of the load test: pages that watch and poll, and one that asks all kinds of things.

They speak just enough HTTP/1.1 for this service, over one connection each: the renderer needs the processors that
clients take on the same machine, and httpx took five times as much as this.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import random
import statistics
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

STREAMS, POLLERS = 50, 20
POLL_SECONDS, ROUND_SECONDS = 0.5, 0.3
_HEAD_END = b"\r\n\r\n"


@dataclass
class Answers:
    """Seconds of each answer by kind of request, and what went wrong."""

    seconds: dict[str, list[float]] = field(default_factory=dict)
    failures: list[str] = field(default_factory=list)
    events: int = 0

    def p95(self, kind: str | None = None) -> float:
        all_of = [s for name, some in self.seconds.items() if kind in (None, name) for s in some]
        return statistics.quantiles(all_of, n=20)[-1]


class Answer(NamedTuple):
    """head: in small letters; body: as it comes, for unpacking a frame is a browser's work, not the service's."""

    status: int
    head: bytes
    body: bytes

    def header(self, name: bytes) -> int:
        """A number in the head; 0 without that header."""
        _, found, rest = self.head.partition(b"\r\n" + name + b":")
        return int(rest.split(b"\r\n", 1)[0]) if found else 0


class Connection(asyncio.Protocol):
    """One question at a time; answers have a length or no body."""

    def __init__(self) -> None:
        self._transport: asyncio.Transport | None = None
        self._received = bytearray()
        self._answer: asyncio.Future[Answer] | None = None

    @classmethod
    async def open(cls, port: int) -> Connection:
        _, made = await asyncio.get_running_loop().create_connection(cls, "127.0.0.1", port)
        return made

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport

    def data_received(self, data: bytes) -> None:
        self._received += data
        if (end := self._received.find(_HEAD_END)) < 0:
            return
        head = bytes(self._received[:end]).lower()
        answer = Answer(int(head[9:12]), head, b"")
        start = end + len(_HEAD_END)
        ends = start + answer.header(b"content-length")
        if len(self._received) >= ends and self._answer is not None and not self._answer.done():
            self._answer.set_result(answer._replace(body=bytes(self._received[start:ends])))
            del self._received[:ends]

    def connection_lost(self, exc: Exception | None) -> None:
        if self._answer is not None and not self._answer.done():
            self._answer.set_exception(exc or ConnectionResetError("the service closed the connection"))

    async def ask(self, method: str, path: str, body: bytes = b"") -> Answer:
        assert self._transport is not None
        kind = "Content-Type: application/json\r\n" if body else ""
        head = f"{method} {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nAccept-Encoding: zstd\r\n{kind}"
        self._answer = asyncio.get_running_loop().create_future()
        self._transport.write(f"{head}Content-Length: {len(body)}\r\n\r\n".encode() + body)
        return await self._answer

    def close(self) -> None:
        if self._transport is not None:
            self._transport.close()


class Stream(asyncio.Protocol):
    """An open event stream."""

    def __init__(self, answers: Answers) -> None:
        self._answers = answers
        self._is_over = False
        self._transport: asyncio.Transport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        transport.write(b"GET /api/events HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")

    def data_received(self, data: bytes) -> None:
        self._answers.events += data.count(b"event:")

    def connection_lost(self, exc: Exception | None) -> None:
        if not self._is_over:
            self._answers.failures.append("an event stream was closed")

    def close(self) -> None:
        self._is_over = True
        if self._transport is not None:
            self._transport.close()


class Clients:
    """All of them, while the block lasts. shown: ids of running jobs; new_job: body of a submission."""

    def __init__(self, port: int, shown: list[str], new_job: Callable[[], dict[str, Any]], answers: Answers) -> None:
        self._port = port
        self._shown = shown
        self._new_job = new_job
        self._answers = answers
        self._streams: list[Stream] = []
        self._tasks: list[asyncio.Task[None]] = []

    async def __aenter__(self) -> Clients:
        loop = asyncio.get_running_loop()
        for _ in range(STREAMS):
            _, stream = await loop.create_connection(lambda: Stream(self._answers), "127.0.0.1", self._port)
            self._streams.append(stream)
        tasks = [self._poll_frames] * POLLERS + [self._ask_around]
        self._tasks = [asyncio.create_task(self._connected(task)) for task in tasks]
        return self

    async def __aexit__(self, *_: object) -> None:
        for task in self._tasks:
            task.cancel()
        for stream in self._streams:
            stream.close()
        for task in self._tasks:
            with contextlib.suppress(asyncio.CancelledError):
                await task

    async def _connected(self, task: Callable[[Connection], Awaitable[None]]) -> None:
        connection = await Connection.open(self._port)
        try:
            await task(connection)
        finally:
            connection.close()

    async def _ask(self, connection: Connection, kind: str, method: str, path: str, body: bytes = b"") -> Answer:
        began = time.perf_counter()
        answer = await connection.ask(method, path, body)
        self._answers.seconds.setdefault(kind, []).append(time.perf_counter() - began)
        if answer.status >= 400:
            self._answers.failures.append(f"{kind}: {answer.status} {answer.body[:200]!r}")
        return answer

    async def _poll_frames(self, connection: Connection) -> None:
        """A page that shows one job asks for what is newer than the frame it has."""
        path, seq = f"/api/jobs/{random.choice(self._shown)}/frames/latest?scale=1&after=", 0
        async for _ in every(POLL_SECONDS):
            seq = (await self._ask(connection, "frame", "GET", f"{path}{seq}")).header(b"x-frame-seq")

    async def _ask_around(self, connection: Connection) -> None:
        async for _ in every(ROUND_SECONDS):
            await self._ask(connection, "job", "GET", f"/api/jobs/{random.choice(self._shown)}")
            await self._ask(connection, "list", "GET", "/api/jobs?limit=100")
            await self._ask(connection, "pixel", "GET", f"/api/jobs/{self._shown[0]}/pixel?x=9&y=9")
            new = json.dumps(self._new_job()).encode()
            made = json.loads((await self._ask(connection, "submit", "POST", "/api/jobs", new)).body)
            await self._ask(connection, "cancel", "POST", f"/api/jobs/{made['id']}/cancel")


async def every(seconds: float) -> AsyncIterator[None]:
    """At that pace however long the answers take, from a random moment on."""
    due = time.perf_counter() + random.random() * seconds
    while True:
        await asyncio.sleep(max(0.0, due - time.perf_counter()))
        yield
        due = max(due + seconds, time.perf_counter())
