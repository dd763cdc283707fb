"""Requests that no well-meaning client sends: each ends as 4xx with a problem body, and the service goes on."""

from __future__ import annotations

import contextlib
import json
import socket
import time
from collections.abc import Callable
from typing import Any

import httpx
import pytest
from event_stream import EventStream
from service_process import PLAIN_SCENE, Server

from service.protocol import LEAST_RATE

BOX: dict[str, Any] = {"scene": {"gallery": "cornell-box"}, "target": {"spp": 4}}


def raw(server: Server, request: bytes) -> tuple[int, dict[str, Any]]:
    """Status and problem body of an answer to bytes that need not be HTTP."""
    with socket.create_connection(("127.0.0.1", server.port), timeout=20) as connection:
        with contextlib.suppress(OSError):  # it may be refused before all of it was sent
            connection.sendall(request)
        answer = b""
        try:
            while chunk := connection.recv(1 << 16):
                answer += chunk
                _, _, body = answer.partition(b"\r\n\r\n")
                if body and body.rstrip().endswith(b"}"):
                    break
        except OSError:
            pass
    return int(answer.split(b" ", 2)[1]), json.loads(answer.partition(b"\r\n\r\n")[2])


LINE = b"POST /api/jobs HTTP/1.1\r\nHost: localhost\r\n"
HARDLY_HTTP: dict[str, tuple[Callable[[], bytes], set[int]]] = {
    "no HTTP": (lambda: b"\x16\x03\x01\x02\x00\x01\x00\r\n\r\n", {400}),
    "a flood of headers": (lambda: LINE + b"X-A: 1\r\n" * 100_000 + b"\r\n", {431}),
    "a huge header": (lambda: LINE + b"X-A: " + b"a" * (4 << 20) + b"\r\n\r\n", {400, 431}),
    "a huge address": (lambda: b"GET /" + b"a" * (1 << 20) + b" HTTP/1.1\r\n\r\n", {400, 431}),
    "a body without end": (lambda: LINE + b"Content-Length: 9999999999999\r\n\r\n", {413}),
    "two lengths": (lambda: LINE + b"Content-Length: 3\r\nContent-Length: 4\r\n\r\n{}", {400}),
}


@pytest.mark.parametrize("what", HARDLY_HTTP)
def test_what_is_hardly_http_is_refused(server: Server, what: str) -> None:
    request_of, statuses = HARDLY_HTTP[what]
    status, problem = raw(server, request_of())
    assert status in statuses
    assert problem["status"] == status
    assert problem["title"]
    assert httpx.get(f"{server.url}/healthz").status_code == 200


def test_nobody_is_waited_for_for_ever(own_server: Server) -> None:
    own_server.environment |= {"FREDHOLM_REQUEST_HEAD_SECONDS": "1", "FREDHOLM_BODY_SILENCE_SECONDS": "1"}
    own_server.start()

    def connected() -> socket.socket:
        return socket.create_connection(("127.0.0.1", own_server.port), timeout=20)

    def until_closed(connection: socket.socket) -> tuple[float, bytes]:
        began, answer = time.monotonic(), b""
        with connection, contextlib.suppress(OSError):
            while chunk := connection.recv(1 << 16):
                answer += chunk
        return time.monotonic() - began, answer

    # A head that comes in drops: each of them is in time, all of them are not.
    drops = connected()
    for byte in b"GET /healthz HTTP/1.1\r\nHost: loc"[:20]:
        with contextlib.suppress(OSError):
            drops.sendall(bytes([byte]))
            time.sleep(0.1)
    took, answer = until_closed(drops)
    assert answer.startswith(b"HTTP/1.1 408 Request Timeout")
    assert json.loads(answer.partition(b"\r\n\r\n")[2])["status"] == 408
    assert took < 5

    # Nothing at all, on a new connection and after an answer, and a body that never ends.
    silent, again, unending = connected(), connected(), connected()
    again.sendall(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n")
    unending.sendall(LINE + b"Content-Type: application/json\r\nContent-Length: 90\r\n\r\n{")
    assert until_closed(silent)[0] < 5
    assert until_closed(again)[1].startswith(b"HTTP/1.1 200")
    assert until_closed(unending)[0] < 5

    # A stream that says nothing for longer than that stays open, and so does an upload that goes on, faster than the
    # least rate of a body.
    with EventStream(own_server.url) as stream:
        part = PLAIN_SCENE.encode() + b"<!--" + b" " * 4 * round(LEAST_RATE) + b"-->"
        head = b'--x\r\nContent-Disposition: form-data; name="file"; filename="a.xml"\r\n\r\n'
        body = head + part + b"\r\n--x--\r\n"
        slow = connected()
        slow.sendall(b"POST /api/scenes HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n")
        slow.sendall(b"Content-Type: multipart/form-data; boundary=x\r\nContent-Length: %d\r\n\r\n" % len(body))
        for start in range(0, len(body), len(body) // 5):
            slow.sendall(body[start : start + len(body) // 5])
            time.sleep(0.4)
        assert until_closed(slow)[1].startswith(b"HTTP/1.1 201")
        assert not stream.is_over.is_set()
    assert "Traceback" not in own_server.log_path.read_text()


@pytest.mark.parametrize(
    "body",
    [
        b'{"scene": {"gallery": "cornell-box"}, "target": {"error": NaN}}',
        b'{"scene": {"gallery": "cornell-box"}, "target": {"error": Infinity}}',
        b'{"scene": {"gallery": "cornell-box"}, "target": {"error": 1e999}}',
        b'{"scene": {"gallery": "cornell-box"}, "target": {"spp": 1' + b"0" * 5000 + b"}}",
        b'{"scene": {"gallery": "cornell-box"}, "target": {"seconds": 1e308}}',
        b'{"scene": {"gallery": "cornell-box"}, "target": {"spp": 4}, "settings": {"seed": 9223372036854775808}}',
        b'{"scene": {"gallery": "cornell-box"}, "target": {"spp": 4}, "settings": {"width": 16384, "height": 16384}}',
        b'{"scene": {"gallery": "cornell-box"}, "target": {"spp": 4}, "settings": {"width": true}}',
        b'{"scene": {"gallery": "cornell-box"}, "target": {"spp": 4}, "priority": 99999}',
        b'{"scene": {"gallery": "\\ud800"}, "target": {"spp": 4}}',
        b'{"scene": {"gallery": "\\u0000"}, "target": {"spp": 4}}',
        b'{"scene": {"id": "../../etc/passwd"}, "target": {"spp": 4}}',
        b'{"scene": {"id": "\\u0000"}, "target": {"spp": 4}}',
        b"[" * 100_000,
        b'{"a":' * 20_000,
        b"\xff\xfe",
        b"null",
        b"",
    ],
    ids=lambda body: repr(body[-40:]),
)
def test_bad_json_is_refused(client: httpx.Client, body: bytes) -> None:
    answer = client.post("/api/jobs", content=body, headers={"Content-Type": "application/json"})
    assert answer.status_code in (400, 422), answer.text
    assert answer.headers["Content-Type"] == "application/problem+json"
    json.loads(answer.text, parse_constant=lambda name: pytest.fail(f"{name} in an answer"))
    assert len(answer.text) < 5000


def test_only_uploads_may_be_long(server: Server) -> None:
    """64 MiB of empty lists held the service for 20 s and took 1.5 GiB."""
    lists = b'{"scene": [' + b"[]," * 150_000 + b"0]}"
    head = LINE + b"Content-Type: application/json\r\n"
    known = head + b"Content-Length: " + str(len(lists)).encode() + b"\r\n\r\n" + lists
    part = hex(len(lists))[2:].encode() + b"\r\n" + lists
    unknown = head + b"Transfer-Encoding: chunked\r\n\r\n" + part + b"\r\n0\r\n\r\n"
    for request in (known, unknown):
        status, problem = raw(server, request)
        assert status == 413
        assert "0.25 MiB" in problem["detail"]
        assert "FREDHOLM_MAX_MESSAGE_BYTES" in problem["detail"]


def test_hundreds_of_unknown_fields_are_not_all_told(client: httpx.Client) -> None:
    answer = client.post("/api/jobs", json=BOX | {f"x{'y' * n}": 1 for n in range(600)})
    assert answer.status_code == 422
    assert len(answer.text) < 8000


@pytest.mark.parametrize(
    "path",
    [
        "/api/jobs/..%2f..%2fsecret",
        "/api/jobs/%00",
        "/api/jobs/%ff%fe",
        "/api/jobs/" + "a" * 5000,
        "/api/scenes/%00",
        "/api/gallery/..%2f..%2f/thumbnail.png",
        "/api/gallery/%00/thumbnail.png",
        "/..%2f..%2fetc%2fpasswd",
        "/assets/..%2f..%2f..%2fsettings.py",
        "/%00",
        "/%2e%2e/%2e%2e/settings.py",
        "/" + "a" * 5000,
        "//etc/passwd",
        "/api/jobs?limit=1e9",
        "/api/jobs?limit=99999999999999999999999999",
    ],
)
def test_odd_addresses_lead_nowhere(server: Server, client: httpx.Client, path: str) -> None:
    answer = client.get(path)
    assert 400 <= answer.status_code < 500, answer.text
    assert answer.headers["Content-Type"] == "application/problem+json"
    assert str(server.data_dir) not in answer.text
    assert "Traceback" not in answer.text


def test_odd_headers_are_harmless(client: httpx.Client) -> None:
    for headers in (
        {"Last-Event-ID": "9" * 1000},
        {"X-Request-ID": "a\tb" * 100},
        {"Accept-Encoding": "zstd;q=nan, gzip;q=, ;;;"},
        {"If-None-Match": '"' * 1000},
        {"Authorization": "Bearer " + "x" * 1000},
        {"Cookie": "fredholm_key=" + "é" * 10},
    ):
        sent = [(name.encode(), value.encode()) for name, value in headers.items()]
        assert client.get("/api/jobs", headers=sent).status_code == 200
    too_long = client.post("/api/jobs", json=BOX, headers={"Idempotency-Key": "k" * 256})
    assert too_long.status_code == 422


def test_a_page_of_another_site_is_not_let_in_by_cors(client: httpx.Client) -> None:
    headers = {"Origin": "https://evil.example", "Access-Control-Request-Method": "POST"}
    answer = client.options("/api/jobs", headers=headers)
    assert answer.status_code == 405
    assert not [name for name in answer.headers if name.lower().startswith("access-control-")]
