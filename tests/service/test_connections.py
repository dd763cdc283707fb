"""Open connections cost their place, and none of an honest client; a log counts what comes again and again."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import resource
import socket
import time
from collections.abc import Sequence

import httpx
import pytest
from service_process import Server, made_keys, wait_for

from service.connections import Connections, most_connections
from service.repeats import Repeats


class Line:
    def __init__(self) -> None:
        self.is_ended = False

    def end(self) -> None:
        self.is_ended = True


def test_the_oldest_stranger_makes_room_and_nobody_who_is_known_does() -> None:
    connections, lines = Connections(6, 3, grace=0.0), [Line() for _ in range(6)]
    for line in lines[:3]:
        connections.opened(line)
    connections.is_known(lines[0])
    connections.opened(lines[3])
    connections.opened(lines[4])
    assert [line.is_ended for line in lines[:5]] == [False, True, False, False, False]
    for line in lines[2:5]:
        connections.is_known(line)
    more = [Line() for _ in range(3)]
    for line in more:
        connections.opened(line)
    assert [line.is_ended for line in more] == [True, False, False], "seven are more than six"
    assert not any(line.is_ended for line in (lines[0], *lines[2:5]))
    assert len(connections) == 6
    connections.closed(lines[0])
    assert len(connections) == 5


def test_a_burst_closes_nobody_before_it_could_speak() -> None:
    async def burst() -> tuple[int, int, int]:
        connections, lines = Connections(64, 4, grace=0.2), [Line() for _ in range(20)]
        for line in lines:
            connections.opened(line)
        at_once = sum(line.is_ended for line in lines)
        connections.is_known(lines[0])
        while len(connections) > 5:
            await asyncio.sleep(0.01)
        return at_once, sum(line.is_ended for line in lines[:1]), sum(line.is_ended for line in lines)

    assert asyncio.run(asyncio.wait_for(burst(), 30)) == (0, 0, 15), "whoever spoke stays, and four who did not"


def test_descriptors_are_left_for_everything_else(monkeypatch: pytest.MonkeyPatch) -> None:
    for soft, most in ((256, 128), (1024, 896), (resource.RLIM_INFINITY, 4096), (1 << 20, 4096)):
        monkeypatch.setattr(resource, "getrlimit", lambda _, soft=soft: (soft, soft))
        assert most_connections(4096) == most


def is_open(line: socket.socket) -> bool:
    line.settimeout(0.01)
    try:
        return line.recv(1) != b""
    except TimeoutError:
        return True
    except OSError:
        return False


@pytest.mark.parametrize("keys", ["off", "on"])
def test_silent_connections_do_not_keep_others_out(own_server: Server, keys: str) -> None:
    own_server.environment |= {"FREDHOLM_MAX_UNKNOWN_CONNECTIONS": "8", "FREDHOLM_REQUEST_HEAD_SECONDS": "120"}
    own_server.environment |= {"FREDHOLM_API_KEYS": keys, "FREDHOLM_PING_SECONDS": "1"}
    server = own_server.start(wait_until="/healthz")
    heads = {"Authorization": f"Bearer {made_keys(server)['read']}"} if keys == "on" else {}
    with contextlib.ExitStack() as stack:
        stream = stack.enter_context(httpx.stream("GET", f"{server.url}/api/events", headers=heads, timeout=60))
        told = stream.iter_lines()
        next(told)
        address = ("127.0.0.1", server.port)
        silent = [stack.enter_context(socket.create_connection(address)) for _ in range(40)]
        assert httpx.get(f"{server.url}/healthz", timeout=20).status_code == 200
        wait_for(lambda: sum(map(is_open, silent)) <= 8, 20, "a place for others")
        assert any("ping" in line for line in told), "a stream is no stranger"
    counted = [line for line in server.log() if "without a known sender" in str(line.get("event"))]
    assert 0 < len(counted) <= 8, "said, and not once for each"


def test_a_body_has_a_deadline_however_steadily_it_comes(own_server: Server) -> None:
    own_server.environment |= {"FREDHOLM_BODY_SECONDS": "1"}
    server = own_server.start(wait_until="/healthz")
    head = "POST /api/scenes HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Requested-With: test\r\nContent-Length: 60000000\r\n"
    head += "Content-Type: multipart/form-data; boundary=b\r\n\r\n"
    with socket.create_connection(("127.0.0.1", server.port)) as line:
        line.sendall(head.encode())
        with contextlib.suppress(ConnectionError):
            for _ in range(600):
                line.sendall(b"x" * 4000)
                time.sleep(0.05)
            raise AssertionError("a body was waited for that took half a minute")


def log_of(clock: list[float], lines: Sequence[tuple[float, object]]) -> tuple[list[object], Repeats]:
    repeats, told = Repeats(lambda: clock[0], 30.0), []
    for at, message in lines:
        clock[0] = at
        record = logging.LogRecord("a", logging.WARNING, "", 0, message, (), None)
        if repeats.filter(record):
            told.append(message)
    return told, repeats


def test_the_same_line_is_counted_and_told_again_after_a_while(caplog: pytest.LogCaptureFixture) -> None:
    clock = [0.0]
    same = {"event": "socket.accept() out of system resource"}
    told, repeats = log_of(clock, [(0.01 * i, {**same, "timestamp": str(i)}) for i in range(1000)] + [(31.0, same)])
    assert len(told) == 6
    with caplog.at_level(logging.WARNING):
        repeats.tell()
    assert "(995 in 30 s)" in caplog.messages[0]
    caplog.clear()
    repeats.tell()
    assert not caplog.messages, "said once"


def test_different_lines_of_one_event_have_a_limit_too_and_other_events_are_told() -> None:
    lines = [(0.0, {"event": "request", "path": f"/{i}"}) for i in range(5000)]
    told, _ = log_of([0.0], [*lines, (0.0, {"event": "another"})])
    assert len(told) == 1501
    assert told[-1] == {"event": "another"}


def test_a_flood_of_nonsense_leaves_few_lines(own_server: Server) -> None:
    server = own_server.start(wait_until="/healthz")
    before = len(server.log())
    for _ in range(200):
        with socket.create_connection(("127.0.0.1", server.port)) as line:
            line.sendall(b"nonsense\r\n\r\n")
            line.recv(100)
    assert len(server.log()) - before < 20
