"""Nothing that opens a door is written anywhere, and nothing of a stranger is stored before its key is looked at."""

from __future__ import annotations

import asyncio
import json
import signal
import socket
import subprocess
import sys
from collections.abc import AsyncIterator, Iterator
from pathlib import Path

import httpx
import pytest
from pydantic import SecretStr
from service_process import ROOT, Server, assert_no_secret_in, made_keys, wait_for
from sqlalchemy.exc import OperationalError

from service.app import create_app
from service.logs import without_secrets
from service.messages import SessionRequest
from service.routes.events import _until_trouble
from service.settings import ServiceSettings

KEY = "frd_0123456789_" + "aB-_" * 10 + "abc"
_LOGGED = """
import asyncio, logging, sys
import structlog
from service.logs import configure
from service.settings import ServiceSettings

configure(ServiceSettings(log_json=sys.argv[1] == "1"))
KEY = sys.argv[2]

def deep(depth, headers):
    authorization, padding = f"Bearer {KEY}", "x" * 100_000
    if depth:
        return deep(depth - 1, headers)
    raise RuntimeError(f"while {KEY} was looked up")

log = structlog.get_logger("test")
try:
    deep(50, {"authorization": KEY})
except RuntimeError:
    log.exception("request failed")
    logging.getLogger("uvicorn.error").error("Exception in ASGI application", exc_info=True)
    logging.getLogger("asyncio").error("Task exception was never retrieved", exc_info=sys.exc_info())
try:
    raise RuntimeError("y" * 1_000_000)
except RuntimeError:
    log.exception("a long one")
log.info("asked", authorization="Bearer short", cookie="fredholm_key=short", headers={"Cookie": "a=short"})
head = [(b"cookie", b"fredholm_key=short")]
logging.getLogger("other").warning("cannot reach postgresql://me:short@host/db with %s", head)
try:
    raise asyncio.CancelledError
except asyncio.CancelledError as cut:
    logging.getLogger("uvicorn.error").error("Exception in ASGI application", exc_info=cut)
log.info("the end")
"""


@pytest.mark.parametrize("is_json", [False, True])
def test_a_log_has_plain_short_traces_and_no_secret(is_json: bool) -> None:
    command = [sys.executable, "-c", _LOGGED, str(int(is_json)), KEY]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, cwd=ROOT)
    log = done.stdout + done.stderr
    assert log.count("Traceback (most recent call last)") == 4
    assert "while frd_0123456789_… was looked up" in log or "\\u2026" in log
    assert KEY[16:] not in log
    assert "short" not in log
    assert "xxxx" not in log, "a variable's value"
    assert len(log) < 60_000
    assert "a request was cut by the end of the service" in log
    assert "the end" in log


@pytest.mark.parametrize(
    "line",
    [
        f"Authorization: Bearer {KEY}",
        f"{{'authorization': 'Bearer {KEY}', 'x': 1}}",
        f"(b'cookie', b'fredholm_key={KEY}')",
        'authorization="Basic c2VjcmV0"',
        "Set-Cookie: fredholm_key=c2VjcmV0; Path=/",
        "postgresql+psycopg://me:c2VjcmV0@host/name",
    ],
)
def test_what_opens_something_is_blotted_out(line: str) -> None:
    told = without_secrets(line)
    assert KEY[16:] not in told
    assert "c2VjcmV0" not in told


def test_what_opens_nothing_stays() -> None:
    line = "GET http://127.0.0.1:8017/api/jobs?a=b@c key 0123456789 of alice, 12:30:01 [info] cookies are eaten"
    assert without_secrets(line) == line


def test_types_that_hold_secrets_do_not_print_them() -> None:
    settings = ServiceSettings(database_url=SecretStr("postgresql://me:short@host/db"))
    assert settings.resolved_database_url == "postgresql://me:short@host/db"
    assert "short" not in f"{settings!r} {settings} {settings.model_dump()}"
    assert KEY not in repr(SessionRequest(key=SecretStr(KEY)))


def test_the_test_of_logs_finds_a_key(tmp_path: Path) -> None:
    (tmp_path / "log").write_text(f"x {KEY[:-20]} y\n")
    with pytest.raises(AssertionError, match="1 keys"):
        assert_no_secret_in(tmp_path / "log")


def test_trouble_within_a_stream_ends_it() -> None:
    async def parts(trouble: Exception) -> AsyncIterator[bytes]:
        yield b"hello"
        raise trouble

    async def heard(trouble: Exception) -> list[bytes]:
        return [part async for part in _until_trouble(parts(trouble))]

    for trouble in (OperationalError("SELECT", {}, Exception()), RuntimeError("a mistake")):
        assert asyncio.run(heard(trouble)) == [b"hello"]


def test_every_route_that_takes_a_body_looks_at_the_head_first() -> None:
    """Those that need no key take a short message only."""
    described = create_app(ServiceSettings(api_keys="on")).openapi()["paths"]
    takes_body = {path for path, methods in described.items() for one in methods.values() if "requestBody" in one}
    from service.access import HeadFirst
    from service.routes import jobs, scenes, series

    routes = [route for module in (jobs, scenes, series) for route in module.router.routes]
    first = {route.path for route in routes if isinstance(route, HeadFirst)}
    assert takes_body - first == {"/api/session"}


@pytest.fixture(scope="module")
def keyed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Server, dict[str, str]]]:
    """A service that asks for keys and logs as people read it, and a key for each role."""
    environment = {"FREDHOLM_API_KEYS": "on", "FREDHOLM_WARM_UP": "0", "FREDHOLM_LOG_JSON": "0"}
    server = Server(tmp_path_factory.mktemp("secrets") / "data", environment).start(wait_until="/healthz")
    yield server, made_keys(server)
    server.stop()


def begun(
    server: Server, key: str | None, path: str = "/api/scenes", length: str = "Content-Length: 60000000"
) -> bytes:
    """What is answered to the head of an upload whose body never comes."""
    with socket.create_connection(("127.0.0.1", server.port), timeout=8) as connection:
        head = (
            f"POST {path} HTTP/1.1\r\nHost: localhost\r\nContent-Type: multipart/form-data; boundary=x\r\n{length}\r\n"
        )
        head += f"Authorization: Bearer {key}\r\n" if key else ""
        connection.sendall(head.encode() + b"\r\n")
        try:
            return connection.recv(1 << 16)
        except TimeoutError:
            return b"nothing"


@pytest.mark.parametrize("length", ["Content-Length: 60000000", "Transfer-Encoding: chunked"])
def test_a_stranger_is_refused_before_a_byte_of_the_body_is_taken(
    keyed: tuple[Server, dict[str, str]], length: str
) -> None:
    server, keys = keyed
    assert begun(server, None, length=length).startswith(b"HTTP/1.1 401 ")
    assert begun(server, KEY, length=length).startswith(b"HTTP/1.1 401 ")
    assert begun(server, keys["read"], length=length).startswith(b"HTTP/1.1 403 ")
    assert begun(server, None, "/api/jobs", "Content-Length: 9000").startswith(b"HTTP/1.1 401 ")
    assert begun(server, None, "/api/jobs/x/continue", "Content-Length: 9000").startswith(b"HTTP/1.1 401 ")


def test_a_page_of_another_port_changes_nothing(keyed: tuple[Server, dict[str, str]]) -> None:
    server, keys = keyed
    mine = {"Authorization": f"Bearer {keys['submit']}"}
    body = {"scene": {"gallery": "cornell-box"}, "target": {"spp": 4}}
    for headers in ({"Origin": "http://127.0.0.1:1"}, {"Origin": "null"}, {"Sec-Fetch-Site": "same-site"}):
        refused = httpx.post(f"{server.url}/api/jobs", json=body, headers=mine | headers)
        assert refused.status_code == 403
        assert refused.json()["type"] == "urn:fredholm:cross-site"
    form = {"Cookie": f"fredholm_key={keys['submit']}", "Content-Type": "application/x-www-form-urlencoded"}
    assert httpx.post(f"{server.url}/api/jobs/x/cancel", headers=form).status_code == 403
    own = {"Origin": server.url, "Cookie": f"fredholm_key={keys['submit']}"}
    assert httpx.post(f"{server.url}/api/jobs/x/cancel", headers=own).status_code == 404
    assert httpx.get(f"{server.url}/login").headers["Referrer-Policy"] == "same-origin"


def guesses(server: Server, keys: list[str]) -> set[int]:
    """Statuses of wrong keys, each said to come from another address."""
    with httpx.Client(base_url=server.url) as client:
        heads = [{"Authorization": f"Bearer {key}", "X-Forwarded-For": f"10.0.0.{i}"} for i, key in enumerate(keys)]
        return {client.get("/api/session", headers=head).status_code for head in heads}


def test_guesses_are_limited_whatever_address_they_name(keyed: tuple[Server, dict[str, str]]) -> None:
    server, keys = keyed
    wrong = [f"frd_{i:010x}_{'a' * 43}" for i in range(80)]
    assert guesses(server, wrong) == {401, 429}
    right = httpx.get(f"{server.url}/api/session", headers={"Authorization": f"Bearer {keys['read']}"})
    assert right.status_code == 200, "who guesses keeps nobody else out"


def test_behind_a_proxy_that_is_named_guesses_at_one_key_are_limited(own_server: Server) -> None:
    own_server.environment |= {"FREDHOLM_API_KEYS": "on", "FREDHOLM_TRUSTED_PROXIES": "127.0.0.1"}
    server = own_server.start(wait_until="/healthz")
    assert guesses(server, [f"frd_{i:010x}_{'a' * 43}" for i in range(80)]) == {401}, "80 addresses, 80 keys"
    assert guesses(server, [f"frd_0123456789_{i:043}" for i in range(80)]) == {401, 429}, "80 addresses, one key"


def test_a_proxy_is_named_by_its_address() -> None:
    with pytest.raises(ValueError, match="no address or network"):
        ServiceSettings(trusted_proxies="10.0.0.1, everyone")


def test_a_key_of_a_wrong_form_is_not_repeated(keyed: tuple[Server, dict[str, str]]) -> None:
    answer = httpx.post(f"{keyed[0].url}/api/session", json={"key": KEY * 5})
    assert answer.status_code == 422
    assert KEY[:14] not in json.dumps(answer.json())


def test_a_request_in_flight_when_the_service_ends_writes_no_key(own_server: Server) -> None:
    own_server.environment |= {"FREDHOLM_API_KEYS": "on", "FREDHOLM_LOG_JSON": "0"}
    server = own_server.start(wait_until="/healthz")
    admin = made_keys(server)["admin"]
    with socket.create_connection(("127.0.0.1", server.port), timeout=20) as connection:
        head = f"POST /api/jobs HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {admin}\r\nContent-Length: 90\r\n"
        connection.sendall(head.encode() + b"Content-Type: application/json\r\nCookie: fredholm_key=x\r\n\r\n{")
        wait_for(lambda: httpx.get(f"{server.url}/healthz").status_code == 200, 60, "an answer")
        assert server.process is not None
        server.process.send_signal(signal.SIGTERM)
        server.process.wait(60)
    log = server.log_path.read_text()
    assert admin[14:] not in log
    assert "Traceback" not in log, log
