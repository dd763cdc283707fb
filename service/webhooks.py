"""Tells others of a job's end, as Standard Webhooks has it: an id, a time, and a signature (HMAC-SHA256).

The message is written in the transaction that ends the job, so there is one for each end whatever is killed when. It is
sent until a 2xx answers, at least once, always with one `webhook-id`: a receiver that has seen that ignores it. It can
arrive twice only where the service died, or lost its database, between the answer and the note that it came.

Clients choose the address, so this must be no way into the network around the service: a name is resolved once, each of
its addresses must be public, and the connection goes to an address that was checked. Redirects are not followed.
Source: https://www.standardwebhooks.com, specification 1.0.
"""

from __future__ import annotations

import asyncio
import base64
import binascii
import contextlib
import hashlib
import hmac
import http.client
import ipaddress
import re
import socket
import ssl
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from urllib.parse import SplitResult, urlsplit

import structlog
from sqlalchemy.exc import SQLAlchemyError

from service.store.threads import reading, writing
from service.store.webhooks import Delivery, WebhookStore

AT_ONCE = 4
LOOK_SECONDS = 1.0  # between two looks for what is due
ATTEMPT_SECONDS = 15.0  # for an attempt, from connecting to the status line
_FEWEST_SECRET_BYTES, _MOST_SECRET_BYTES = 24, 64
_LONGEST_URL = 2000
_NAT64 = ipaddress.ip_network("64:ff9b::/96")


class NotDelivered(Exception):
    """An attempt failed. is_final: there is no use in another."""

    def __init__(self, why: str, *, is_final: bool = False) -> None:
        self.is_final = is_final
        super().__init__(why)


def secret_bytes(secret: str) -> bytes:
    """The key in a secret of the form whsec_BASE64. Raises ValueError."""
    way_out = "write whsec_ and the base64 of 24 to 64 random bytes"
    try:
        key = base64.b64decode(secret.removeprefix("whsec_"), validate=True)
    except (binascii.Error, ValueError):
        raise ValueError(f"the secret is no base64; {way_out}") from None
    if not secret.startswith("whsec_") or not _FEWEST_SECRET_BYTES <= len(key) <= _MOST_SECRET_BYTES:
        raise ValueError(f"the secret has {len(key)} bytes or does not begin with whsec_; {way_out}")
    return key


def signature(secret: str, message_id: str, timestamp: int, body: bytes) -> str:
    """The header `webhook-signature`."""
    signed = f"{message_id}.{timestamp}.".encode() + body
    return "v1," + base64.b64encode(hmac.digest(secret_bytes(secret), signed, hashlib.sha256)).decode("ascii")


def check_url(url: str, *, is_private_allowed: bool) -> SplitResult:
    """An address that could be told, as far as it says itself. Raises ValueError."""
    if len(url) > _LONGEST_URL or not re.fullmatch(r"[\x21-\x7e]+", url):
        raise ValueError(f"the URL must be 1 to {_LONGEST_URL} printable ASCII characters")
    parts = urlsplit(url)  # raises ValueError for broken brackets
    schemes = ("https", "http") if is_private_allowed else ("https",)
    if parts.scheme not in schemes or not parts.hostname:
        raise ValueError(f"the URL must begin with {' or '.join(f'{one}://' for one in schemes)} and name a host")
    if parts.username is not None or parts.password is not None:
        raise ValueError("the URL must have no user name or password; put a token into its path")
    _ = parts.port  # raises ValueError where that is none
    literal = _literal(parts.hostname)
    if literal is not None and not is_private_allowed and not is_public(literal):
        raise ValueError(f"{parts.hostname} is no public address; this service tells public addresses only")
    return parts


def _literal(host: str) -> str | None:
    try:
        return str(ipaddress.ip_address(host))
    except ValueError:
        return None


def is_public(address: str) -> bool:
    """Whether an IP address is one of the internet, and not of this machine or a network around it."""
    ip = ipaddress.ip_address(address.partition("%")[0])
    if isinstance(ip, ipaddress.IPv6Address):
        inner = ip.ipv4_mapped or ip.sixtofour or (ip.teredo[1] if ip.teredo else None)
        if ip in _NAT64:
            inner = ipaddress.IPv4Address(int(ip) & 0xFFFFFFFF)
        if inner is not None and not is_public(str(inner)):
            return False
        if inner is not None and ip.ipv4_mapped:
            return True
    return ip.is_global and not ip.is_multicast


def checked_addresses(host: str, port: int, *, is_private_allowed: bool) -> list[str]:
    """What a name means now, all of it checked. Raises NotDelivered."""
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError):
        raise NotDelivered("the name of the host is not known") from None
    addresses = list(dict.fromkeys(str(one[4][0]) for one in found))
    if not is_private_allowed and not all(map(is_public, addresses)):
        raise NotDelivered("the host has an address that is not public")
    return addresses


def attempt(delivery: Delivery, *, is_private_allowed: bool) -> None:
    """Send it once. Blocks for ATTEMPT_SECONDS at most, and the look-up of a name. Raises NotDelivered."""
    try:
        parts = check_url(delivery.url, is_private_allowed=is_private_allowed)
    except ValueError as error:  # it was allowed when the job was submitted
        raise NotDelivered(str(error), is_final=True) from None
    host, is_tls = parts.hostname or "", parts.scheme == "https"
    port = parts.port or (443 if is_tls else 80)
    body, timestamp = delivery.body.encode(), int(time.time())
    headers = {
        "Content-Type": "application/json",
        "User-Agent": "fredholm",
        "webhook-id": delivery.id,
        "webhook-timestamp": str(timestamp),
        "webhook-signature": signature(delivery.secret, delivery.id, timestamp, body),
    }
    target = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
    connection = http.client.HTTPConnection(host, port)  # for its words alone: it never resolves or connects
    ends = time.monotonic() + ATTEMPT_SECONDS
    try:
        line = _connect(checked_addresses(host, port, is_private_allowed=is_private_allowed), port, ends)
        with line, _cut_at(line, ends):
            connection.sock = ssl.create_default_context().wrap_socket(line, server_hostname=host) if is_tls else line
            with _cut_at(connection.sock, ends):
                connection.request("POST", target, body, headers)
                status = connection.getresponse().status
    except (OSError, http.client.HTTPException) as error:
        raise NotDelivered(f"the connection failed: {type(error).__name__}") from None
    finally:
        connection.close()
    if not 200 <= status < 300:
        raise NotDelivered(f"the answer was {status}", is_final=status == 410)


def _connect(addresses: list[str], port: int, ends: float) -> socket.socket:
    """To the first that takes it."""
    last: OSError = OSError("no address")
    for address in addresses:
        try:
            return socket.create_connection((address, port), timeout=max(ends - time.monotonic(), 0.1))
        except OSError as error:
            last = error
    raise last


@contextlib.contextmanager
def _cut_at(line: socket.socket, ends: float) -> Iterator[None]:
    """Shut a connection down at a moment: one that drips a byte now and then keeps every timeout of its own."""

    def cut() -> None:
        with contextlib.suppress(OSError):
            line.shutdown(socket.SHUT_RDWR)

    timer = threading.Timer(max(ends - time.monotonic(), 0), cut)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


class Messenger:
    """One task that sends what is due."""

    def __init__(self, store: WebhookStore, *, is_private_allowed: bool) -> None:
        self._store = store
        self._is_private_allowed = is_private_allowed
        self._threads = ThreadPoolExecutor(AT_ONCE, thread_name_prefix="webhook")
        self._task: asyncio.Task[None] | None = None
        self._log = structlog.get_logger("service.webhooks")

    def start(self) -> None:
        """Begin."""
        self._task = asyncio.create_task(self._again_and_again())

    async def stop(self) -> None:
        """End; what is on its way is tried again by whoever starts next."""
        if self._task is not None:
            self._task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._task
        self._threads.shutdown(wait=False, cancel_futures=True)

    async def _again_and_again(self) -> None:
        while True:
            try:
                while await self.send_due():
                    pass
            except SQLAlchemyError:
                pass  # others say that the database does not answer
            except Exception:
                self._log.exception("sending webhooks failed, trying again later")
            await asyncio.sleep(LOOK_SECONDS)

    async def send_due(self) -> int:
        """Make the attempts that are due, some at a time; how many."""
        if not await reading(self._store.is_any_due):
            return 0
        taken = await writing(self._store.take, AT_ONCE)
        await asyncio.gather(*map(self._send, taken))
        return len(taken)

    async def _send(self, delivery: Delivery) -> None:
        told = {"job": delivery.job_id, "webhook": delivery.id, "attempt": delivery.attempts}
        loop = asyncio.get_running_loop()
        try:
            await loop.run_in_executor(
                self._threads, lambda: attempt(delivery, is_private_allowed=self._is_private_allowed)
            )
        except NotDelivered as failure:
            if not failure.is_final and not delivery.is_last_attempt:
                self._log.info("webhook not delivered, trying again", why=str(failure), next=delivery.due_at, **told)
                return
            self._log.warning("webhook given up", why=str(failure), **told)
        else:
            self._log.info("webhook delivered", **told)
        await writing(self._store.finish, delivery.id)
