"""Facts about webhooks: how they are signed, where they may go, and that each end of a job is told, whatever dies."""

from __future__ import annotations

import asyncio
import base64
import hashlib
import hmac
import json
import socket
import threading
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Any

import httpx
import pytest
from service_process import LONG, SMALL, Server, wait_for
from sqlalchemy import func, select, update

from service import webhooks
from service.messages import JobRequest
from service.states import Step
from service.store import Database, JobStore, NewJob
from service.store.records import iso
from service.store.schema import events, webhook_deliveries
from service.store.schema import webhooks as remembered
from service.store.webhooks import BACKOFF_SECONDS, Delivery, WebhookStore
from service.submission import request_digest
from service.webhooks import Messenger, NotDelivered, attempt, check_url, is_public, secret_bytes, signature

KEY = bytes(range(32))
SECRET = "whsec_" + base64.b64encode(KEY).decode()
PAST = iso(datetime.now(UTC) - timedelta(days=1))


class Receiver:
    """A server that hears webhooks. answers: status codes to give, the last one for ever; headers: of answers."""

    def __init__(self) -> None:
        self.heard: list[tuple[str, dict[str, str], bytes]] = []
        self.answers = [204]
        self.location = ""
        receiver = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                body = self.rfile.read(int(self.headers["Content-Length"]))
                receiver.heard.append((self.path, {k.lower(): v for k, v in self.headers.items()}, body))
                self.send_response(receiver.answers.pop(0) if len(receiver.answers) > 1 else receiver.answers[0])
                if receiver.location:
                    self.send_header("Location", receiver.location)
                self.send_header("Content-Length", "0")
                self.end_headers()

            def log_message(self, format: str, *args: Any) -> None:
                pass

        self.server = HTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.server.server_port}/told?by=fredholm"
        threading.Thread(target=self.server.serve_forever, daemon=True).start()


@pytest.fixture
def receiver() -> Iterator[Receiver]:
    made = Receiver()
    yield made
    made.server.shutdown()
    made.server.server_close()


@pytest.fixture
def database(database_url: str) -> Iterator[Database]:
    made = Database(database_url)
    made.create_tables()
    yield made
    made.close()


def queued(jobs: JobStore, url: str) -> str:
    hook = {"url": url, "secret": SECRET}
    new = NewJob("Box", "gallery", "cornell-box", "Box", {"spp": 1}, {"width": 4}, webhook=hook)
    return jobs.add(new)[0].id


def make_due(database: Database) -> None:
    with database.write() as connection:
        connection.execute(update(webhook_deliveries).values(due_at=PAST))


def pending(database: Database) -> int:
    with database.read() as connection:
        return connection.execute(select(func.count()).select_from(webhook_deliveries)).scalar_one()


def send_due(database: Database) -> int:
    """What one server does in one look."""

    async def once() -> int:
        return await Messenger(WebhookStore(database), is_private_allowed=True).send_due()

    return asyncio.run(once())


def delivery(url: str) -> Delivery:
    return Delivery("msg_1", "job", url, SECRET, "{}", 1, PAST)


def test_the_signature_is_that_of_the_standard() -> None:
    # The example of the reference libraries.
    secret = "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw"
    told = signature(secret, "msg_p5jXN8AQM9LWM0D4loKWxJek", 1614265330, b'{"test": 2432232314}')
    assert told == "v1,g0hM9SsE+OTPJTGt/tmIKtSyZlE3uFJELVlNIOLJ1OE="


@pytest.mark.parametrize("secret", ["", "MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw", "whsec_!", "whsec_c2hvcnQ="])
def test_a_secret_that_is_none_is_refused(secret: str) -> None:
    with pytest.raises(ValueError, match="whsec_ and the base64 of 24 to 64"):
        secret_bytes(secret)


@pytest.mark.parametrize(
    "address",
    [
        *("127.0.0.1", "127.8.8.8", "10.0.0.1", "172.16.0.1", "192.168.1.1", "169.254.169.254", "0.0.0.0"),
        *("100.64.0.1", "224.0.0.1", "255.255.255.255", "::1", "::", "fe80::1", "fe80::1%eth0", "fc00::1", "ff02::1"),
        *("::ffff:127.0.0.1", "::ffff:10.0.0.1", "64:ff9b::7f00:1", "2002:7f00:1::", "2002:a00:1::1"),
    ],
)
def test_addresses_of_this_machine_and_its_networks_are_not_public(address: str) -> None:
    assert not is_public(address)


@pytest.mark.parametrize("address", ["1.1.1.1", "93.184.215.14", "2606:4700:4700::1111", "::ffff:1.1.1.1"])
def test_addresses_of_the_internet_are_public(address: str) -> None:
    assert is_public(address)


@pytest.mark.parametrize(
    ("url", "why"),
    [
        ("http://example.com/", "must begin with https://"),
        ("ftp://example.com/", "must begin with https://"),
        ("https:///path", "name a host"),
        ("https://user:password@example.com/", "no user name"),
        ("https://example.com:99999/", "[Pp]ort"),
        ("https://example.com/a b", "printable"),
        ("https://example.com/\r\nX: y", "printable"),
        ("https://127.0.0.1/", "no public address"),
        ("https://[::1]/", "no public address"),
        ("https://[::ffff:10.0.0.1]/", "no public address"),
        ("https://example.com/" + "a" * 2000, "2000"),
    ],
)
def test_a_url_that_cannot_be_told_is_refused(url: str, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        check_url(url, is_private_allowed=False)


def test_a_name_of_a_private_address_is_not_told(monkeypatch: pytest.MonkeyPatch, receiver: Receiver) -> None:
    port = receiver.server.server_port
    found = [(socket.AF_INET, socket.SOCK_STREAM, 6, "", (a, port)) for a in ("1.1.1.1", "127.0.0.1")]
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: found)
    monkeypatch.setattr(socket, "create_connection", lambda *_, **__: pytest.fail("connected"))
    with pytest.raises(NotDelivered, match="not public"):
        attempt(delivery(f"https://hooks.example.com:{port}/"), is_private_allowed=False)


def test_the_connection_goes_to_the_address_that_was_checked(monkeypatch: pytest.MonkeyPatch) -> None:
    """A name may mean something else a moment later: it is asked for once."""
    answers = iter(["1.1.1.1", "127.0.0.1"])
    asked, connected = [], []

    def resolve(host: str, port: int, **_: Any) -> list[Any]:
        asked.append(host)
        return [(socket.AF_INET, socket.SOCK_STREAM, 6, "", (next(answers), port))]

    def connect(address: tuple[str, int], **_: Any) -> socket.socket:
        connected.append(address)
        raise ConnectionRefusedError

    monkeypatch.setattr(socket, "getaddrinfo", resolve)
    monkeypatch.setattr(socket, "create_connection", connect)
    with pytest.raises(NotDelivered, match="connection failed"):
        attempt(delivery("https://hooks.example.com/"), is_private_allowed=False)
    assert (asked, connected) == (["hooks.example.com"], [("1.1.1.1", 443)])


def test_redirects_are_not_followed(receiver: Receiver) -> None:
    receiver.answers, receiver.location = [302], receiver.url
    with pytest.raises(NotDelivered, match="302"):
        attempt(delivery(receiver.url), is_private_allowed=True)
    assert len(receiver.heard) == 1


def test_a_receiver_that_never_answers_is_cut_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(webhooks, "ATTEMPT_SECONDS", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as silent, pytest.raises(NotDelivered):
        attempt(delivery(f"http://127.0.0.1:{silent.getsockname()[1]}/"), is_private_allowed=True)


def test_each_end_is_told_once_and_signed(database: Database, receiver: Receiver) -> None:
    jobs = JobStore(database)
    job = queued(jobs, receiver.url)
    assert send_due(database) == 0
    jobs.move(job, Step.CANCEL)
    assert send_due(database) == 1
    assert send_due(database) == 0
    ((path, headers, body),) = receiver.heard
    assert path == "/told?by=fredholm"
    signed = f"{headers['webhook-id']}.{headers['webhook-timestamp']}.".encode() + body
    assert headers["webhook-signature"] == "v1," + base64.b64encode(hmac.digest(KEY, signed, hashlib.sha256)).decode()
    told = json.loads(body)
    assert told["type"] == "job.cancelled"
    assert (told["data"]["id"], told["data"]["state"], told["data"]["error"]) == (job, "cancelled", None)
    assert told["timestamp"] == jobs.get(job).finished_at
    jobs.move(job, Step.CONTINUE)
    jobs.move(job, Step.CANCEL)
    assert send_due(database) == 1
    assert len({headers["webhook-id"] for _, headers, _ in receiver.heard}) == 2


def test_failures_are_tried_again_under_one_id_and_in_the_end_given_up(database: Database, receiver: Receiver) -> None:
    jobs = JobStore(database)
    jobs.move(queued(jobs, receiver.url), Step.CANCEL)
    receiver.answers = [500]
    pauses = []
    for _ in BACKOFF_SECONDS:
        assert send_due(database) == 1
        assert send_due(database) == 0  # not before its time
        with database.read() as connection:
            due = connection.execute(select(webhook_deliveries.c.due_at)).scalar_one()
        pauses.append((datetime.fromisoformat(due) - datetime.now(UTC)).total_seconds())
        make_due(database)
    assert all(0 < pause <= planned for pause, planned in zip(pauses, BACKOFF_SECONDS, strict=True))
    assert pauses == sorted(pauses)
    assert send_due(database) == 1
    assert pending(database) == 0
    assert len(receiver.heard) == len(BACKOFF_SECONDS) + 1
    assert len({headers["webhook-id"] for _, headers, _ in receiver.heard}) == 1


def test_one_who_is_gone_is_not_tried_again(database: Database, receiver: Receiver) -> None:
    jobs = JobStore(database)
    jobs.move(queued(jobs, receiver.url), Step.CANCEL)
    receiver.answers = [410]
    assert send_due(database) == 1
    assert pending(database) == 0


def test_two_servers_do_not_make_one_attempt_twice(database: Database, receiver: Receiver) -> None:
    jobs = JobStore(database)
    for _ in range(3):
        jobs.move(queued(jobs, receiver.url), Step.CANCEL)
    stores = [WebhookStore(database) for _ in range(4)]
    taken: list[Delivery] = []
    threads = [threading.Thread(target=lambda store=store: taken.extend(store.take(2))) for store in stores]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(taken) == len({one.id for one in taken}) == 3


def test_a_deleted_job_forgets_its_secret(database: Database) -> None:
    jobs = JobStore(database)
    job = queued(jobs, "https://example.com/")
    with database.read() as connection:
        assert SECRET not in json.dumps([row.job for row in connection.execute(select(events))])
    jobs.delete(job)
    with database.read() as connection:
        assert connection.execute(select(remembered)).all() == []
    assert pending(database) == 0


def submit(server: Server, hook: dict[str, str]) -> httpx.Response:
    body = {"scene": {"gallery": "cornell-box"}, "target": LONG, "settings": SMALL, "webhook": hook}
    return httpx.post(f"{server.url}/api/jobs", json=body, timeout=60)


def test_the_end_of_a_job_is_told_across_a_killed_service(tmp_path: Path, receiver: Receiver) -> None:
    server = Server(tmp_path / "data", {"FREDHOLM_WEBHOOK_PRIVATE_ADDRESSES": "1", "FREDHOLM_WARM_UP": "0"})
    server.start(wait_until="/healthz")
    try:
        receiver.answers = [503]
        answer = submit(server, {"url": receiver.url, "secret": SECRET})
        assert answer.status_code == 201, answer.text
        assert SECRET not in answer.text
        assert server.cancel(answer.json()["id"]).status_code == 200
        wait_for(lambda: len(receiver.heard) == 1, 60, "the first attempt")
        server.kill()
        assert SECRET not in server.log_path.read_text()
        receiver.answers = [204]
        server.start(wait_until="/healthz")
        wait_for(lambda: len(receiver.heard) == 2, 60, "the attempt after the crash")
        said = [line["event"] for line in server.log() if "webhook" in line]
        wait_for(
            lambda: "webhook delivered" in [line["event"] for line in server.log() if "webhook" in line],
            60,
            "the note that it was heard",
            lambda: str(said),
        )
    finally:
        server.stop()
    assert len({headers["webhook-id"] for _, headers, _ in receiver.heard}) == 1
    assert {json.loads(body)["type"] for _, _, body in receiver.heard} == {"job.cancelled"}
    database = Database(f"sqlite:///{tmp_path / 'data' / 'fredholm.sqlite'}")
    assert pending(database) == 0
    database.close()


def test_a_private_address_is_refused_at_the_door(server: Server) -> None:
    for hook, field in (
        ({"url": "https://127.0.0.1/", "secret": SECRET}, "webhook.url"),
        ({"url": "http://example.com/", "secret": SECRET}, "webhook.url"),
        ({"url": "https://example.com/", "secret": "whsec_x"}, "webhook.secret"),
    ):
        answer = submit(server, hook)
        assert answer.status_code == 422, answer.text
        assert field in answer.text
        assert SECRET not in answer.text


def test_a_repeated_request_is_known_by_its_webhook_too_and_older_ones_as_before() -> None:
    body = {"scene": {"gallery": "cornell-box"}, "target": {"spp": 4}}
    plain = JobRequest.model_validate(body)
    assert request_digest(plain) == hashlib.sha256(plain.model_dump_json(exclude={"webhook"}).encode()).hexdigest()
    secrets = ["whsec_" + base64.b64encode(bytes([i]) * 24).decode() for i in range(2)]
    url = "https://example.org/hook"
    told = [JobRequest.model_validate(body | {"webhook": {"url": url, "secret": secret}}) for secret in secrets]
    assert len({request_digest(one) for one in (plain, *told)}) == 3
