"""Clients that trickle and clients that do not read cost the service nothing for long."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import time
from pathlib import Path
from types import SimpleNamespace

from service_process import Server

from service.protocol import LEAST_RATE, LimitedProtocol

HEAD = b"POST /api/jobs HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json\r\nContent-Length: 100000\r\n\r\n"


class Pipe:
    """A connection's other end, as a protocol sees it: takes what it is told to take."""

    def __init__(self) -> None:
        self.unread, self.is_aborted = 1 << 20, False

    def get_write_buffer_size(self) -> int:
        return self.unread

    def abort(self) -> None:
        self.is_aborted = True


def test_a_body_that_trickles_is_not_waited_for(own_server: Server) -> None:
    own_server.environment |= {"FREDHOLM_REQUEST_HEAD_SECONDS": "1", "FREDHOLM_BODY_SILENCE_SECONDS": "60"}
    server = own_server.start()
    with socket.create_connection(("127.0.0.1", server.port)) as trickling:
        trickling.sendall(HEAD)
        with contextlib.suppress(ConnectionError):
            for _ in range(600):
                trickling.sendall(b" ")
                time.sleep(0.1)
            raise AssertionError("a minute of ten bytes a second was waited for")


def test_a_client_sends_so_many_large_bodies_at_a_time(own_server: Server) -> None:
    """Three that trickle take all places of a client; small requests go on, and one that is let go makes room."""
    own_server.environment |= {"FREDHOLM_MAX_BODIES_OF_CLIENT": "3"}
    server = own_server.start()
    head = HEAD.replace(b"/api/jobs", b"/api/scenes").replace(b"application/json", b"multipart/form-data; boundary=b")
    head = head.replace(b"100000", b"50000000")
    with contextlib.ExitStack() as stack:
        sending = [stack.enter_context(socket.create_connection(("127.0.0.1", server.port))) for _ in range(3)]
        for one in sending:
            one.sendall(head + b"--b")

        def answer() -> bytes:
            with socket.create_connection(("127.0.0.1", server.port)) as one_more:
                one_more.settimeout(1.0)
                one_more.sendall(head + b"--b")
                with contextlib.suppress(TimeoutError):
                    return one_more.recv(4096)
            return b""

        until = time.monotonic() + 60
        while not (refused := answer()) and time.monotonic() < until:
            pass  # those three have not all arrived yet
        assert b" 429 " in refused[:40], "a fourth one is refused"
        with server.client() as client:
            assert client.get("/api/jobs").status_code == 200
            asked = client.post("/api/jobs", json={"scene": {"gallery": "nowhere"}, "target": {"spp": 1}})
            assert asked.status_code in (404, 422), "small bodies need no place"
        sending[0].close()
        until = time.monotonic() + 60
        while answer() and time.monotonic() < until:
            pass
        assert time.monotonic() < until, "a place of one that went away is free again"


def test_a_reader_who_takes_nothing_is_let_go_and_a_slow_one_is_not() -> None:
    async def watched() -> None:
        protocol, pipe = object.__new__(LimitedProtocol), Pipe()
        setattr(protocol, "flow", SimpleNamespace(pause_writing=int, resume_writing=int))  # noqa: B010
        protocol.loop, protocol.transport = asyncio.get_running_loop(), pipe  # type: ignore[assignment]
        protocol.pause_writing()
        pipe.unread -= int(LEAST_RATE * protocol.silence_seconds)
        protocol._look_at_reader()
        assert not pipe.is_aborted
        protocol._look_at_reader()
        assert pipe.is_aborted, "nothing was taken since"
        protocol.resume_writing()
        assert protocol._reader is None, "nobody waits any more"

    asyncio.run(watched())


def test_the_service_takes_as_many_descriptors_as_it_may(own_server: Server) -> None:
    own_server.wrapper = ["sh", "-c", 'ulimit -Sn 256; exec "$@"', "sh"]
    server = own_server.start(wait_until="/healthz")
    assert server.process is not None
    limits = Path(f"/proc/{server.process.pid}/limits").read_text()
    soft, hard = next(line.split()[3:5] for line in limits.splitlines() if line.startswith("Max open files"))
    assert soft == hard or int(soft) == 65536
