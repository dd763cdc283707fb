"""Who asks: API keys, roles, and how often each client may ask.

A key is random, shown once and stored only as a keyed digest. Its form is frd_ID_SECRET. Between the request that
brings it and the lookup it is a SecretStr, which no log and no trace shows.
"""

from __future__ import annotations

import hashlib
import hmac
import re
import secrets
import time
from collections import OrderedDict
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path

from pydantic import SecretStr

from service.store.keys import KeyRecord, KeyStore
from service.store.records import now
from service.written_once import written_once

KEY_FORM = re.compile(r"frd_([0-9a-f]{10})_([A-Za-z0-9_-]{43})")
_KNOWN_SECONDS = 5.0  # a revoked key is refused after at most this long
_CLIENT = re.compile(r"[A-Za-z0-9][A-Za-z0-9._@-]{0,63}")


class Role(IntEnum):
    """What a client may do; each may do what those before it may."""

    READ = 1
    SUBMIT = 2
    ADMIN = 3


class ClientError(Exception):
    """A client or key is not as it must be."""


@dataclass(frozen=True, slots=True)
class Caller:
    """Who asks. client_id: "" where no keys are asked for."""

    client_id: str
    role: Role

    @property
    def scope(self) -> str | None:
        """Whose jobs the caller sees: its own, or all (None)."""
        return None if self.role is Role.ADMIN else self.client_id


ANYONE = Caller("", Role.ADMIN)


class Keys:
    """Makes keys and tells whose they are."""

    def __init__(self, store: KeyStore, secret_file: Path) -> None:
        self._store = store
        self._secret_file = secret_file
        self._secret: bytes | None = None
        self._known: dict[str, tuple[float, Caller | None]] = {}

    def create(self, client: str, role: str) -> tuple[KeyRecord, str]:
        """A new key and its text, which is kept nowhere. Raises ClientError."""
        if not _CLIENT.fullmatch(client):
            raise ClientError(f"the client {client!r} is not a name; use 1 to 64 letters, digits and . _ @ -")
        if role.upper() not in Role.__members__:
            raise ClientError(f"the role {role!r} is not known; choose read, submit or admin")
        key_id, secret = secrets.token_hex(5), secrets.token_urlsafe(32)
        record = KeyRecord(key_id, client, role.lower(), self._digest(secret), now(), None)
        self._store.add(record)
        return record, f"frd_{key_id}_{secret}"

    def any_in_use(self) -> bool:
        """Whether there is a key that opens something."""
        return any(key.revoked_at is None for key in self._store.all())

    def known(self, key: SecretStr) -> Caller | None:
        """Whose key this is, if that was looked up a moment ago: a page asks several times a second."""
        found = KEY_FORM.fullmatch(key.get_secret_value())
        if found is None or self._secret is None:
            return None
        known = self._known.get(found[1] + self._digest(found[2]))
        return known[1] if known is not None and time.monotonic() - known[0] < _KNOWN_SECONDS else None

    def caller(self, key: SecretStr) -> Caller | None:
        """Whose key this is, None if it is nobody's. Synchronous: call it from a thread."""
        found = KEY_FORM.fullmatch(key.get_secret_value())
        if found is None:
            return None
        # The digest stands for the key, which is not kept.
        digest, moment = self._digest(found[2]), time.monotonic()
        known = self._known.get(found[1] + digest)
        if known is not None and moment - known[0] < _KNOWN_SECONDS:
            return known[1]
        record = self._store.get(found[1])
        is_right = record is not None and hmac.compare_digest(record.digest, digest) and record.revoked_at is None
        caller = Caller(record.client, Role[record.role.upper()]) if record is not None and is_right else None
        if len(self._known) > 10_000:
            self._known.clear()
        self._known[found[1] + digest] = (moment, caller)
        return caller

    def _digest(self, secret: str) -> str:
        if self._secret is None:
            self._secret = read_secret(self._secret_file)
        return hmac.new(self._secret, secret.encode(), hashlib.sha256).hexdigest()


def read_secret(path: Path) -> bytes:
    """The service's own secret, made at first use and readable by its user alone."""
    return bytes.fromhex(written_once(path, secrets.token_hex(32)))


class RateLimit:
    """A bucket for each who asks: `burst` at once, then `rate` a second."""

    def __init__(self, rate: float, burst: float, most: int = 10_000) -> None:
        self._rate = rate
        self._burst = burst
        self._most = most
        self._buckets: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def take(self, who: str, moment: float | None = None) -> float:
        """0 if the request may pass, else seconds until one may."""
        moment = time.monotonic() if moment is None else moment
        left, at = self._buckets.pop(who, (self._burst, moment))
        left = min(self._burst, left + (moment - at) * self._rate)
        wait = 0.0 if left >= 1 else (1 - left) / self._rate
        self._buckets[who] = (left - 1 if wait == 0 else left, moment)
        if len(self._buckets) > self._most:
            self._buckets.popitem(last=False)
        return wait
