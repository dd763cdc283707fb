"""Keys, roles and rates."""

from __future__ import annotations

import os
import re
import stat
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from pydantic import SecretStr
from service_process import ROOT

from service.clients import Caller, ClientError, Keys, RateLimit, Role, read_secret
from service.store import Database
from service.store.keys import KeyStore


@pytest.fixture
def store(database_url: str) -> Iterator[KeyStore]:
    database = Database(database_url)
    database.create_tables()
    yield KeyStore(database)
    database.close()


def test_a_key_opens_what_its_role_says_and_is_kept_nowhere(store: KeyStore, tmp_path: Path) -> None:
    keys = Keys(store, tmp_path / "secret")
    record, text = keys.create("alice", "submit")
    assert keys.caller(SecretStr(text)) == Caller("alice", Role.SUBMIT)
    secret = text.split("_", 2)[2]
    assert len(secret) == 43
    assert secret not in repr(store.all())
    assert re.fullmatch("[0-9a-f]{64}", record.digest)
    assert stat.S_IMODE((tmp_path / "secret").stat().st_mode) == 0o600


@pytest.mark.parametrize("wrong", ["", "x", "frd_0000000000_" + "a" * 43, "frd_\n", "ключ"])
def test_what_is_no_key_opens_nothing(store: KeyStore, tmp_path: Path, wrong: str) -> None:
    assert Keys(store, tmp_path / "secret").caller(SecretStr(wrong)) is None


def test_a_key_with_another_secret_or_of_another_service_opens_nothing(store: KeyStore, tmp_path: Path) -> None:
    keys = Keys(store, tmp_path / "secret")
    _, text = keys.create("alice", "admin")
    assert keys.caller(SecretStr(text[:-1] + ("a" if text[-1] != "a" else "b"))) is None
    assert Keys(store, tmp_path / "other").caller(SecretStr(text)) is None


def test_a_revoked_key_opens_nothing(store: KeyStore, tmp_path: Path) -> None:
    record, text = Keys(store, tmp_path / "secret").create("alice", "read")
    assert store.revoke(record.id)
    assert not store.revoke(record.id)
    assert Keys(store, tmp_path / "secret").caller(SecretStr(text)) is None


def test_a_key_that_was_just_looked_up_is_known_without_the_database(store: KeyStore, tmp_path: Path) -> None:
    keys = Keys(store, tmp_path / "secret")
    _, text = keys.create("alice", "read")
    assert keys.known(SecretStr(text)) is None
    keys.caller(SecretStr(text))
    assert keys.known(SecretStr(text)) == Caller("alice", Role.READ)
    assert keys.known(SecretStr(text[:-1] + ("a" if text[-1] != "a" else "b"))) is None


def test_a_bad_client_or_role_is_told(store: KeyStore, tmp_path: Path) -> None:
    keys = Keys(store, tmp_path / "secret")
    with pytest.raises(ClientError, match="not a name"):
        keys.create("a b", "read")
    with pytest.raises(ClientError, match="choose read, submit or admin"):
        keys.create("a", "root")


def test_a_bucket_lets_a_burst_pass_and_then_its_rate() -> None:
    limit = RateLimit(rate=2.0, burst=3)
    assert [limit.take("a", 0.0) for _ in range(4)] == [0.0, 0.0, 0.0, 0.5]
    assert limit.take("b", 0.0) == 0.0
    assert limit.take("a", 0.5) == 0.0
    assert limit.take("a", 0.5) > 0
    assert [limit.take("a", 100.0) for _ in range(4)] == [0.0, 0.0, 0.0, 0.5]


def test_buckets_do_not_grow_without_end() -> None:
    limit = RateLimit(rate=1.0, burst=1, most=10)
    for i in range(100):
        limit.take(str(i), 0.0)
    assert len(limit._buckets) == 10


def test_keys_are_made_listed_and_revoked_from_the_command_line(tmp_path: Path) -> None:
    def fredholm(*arguments: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "service.command", "key", *arguments, "--data", str(tmp_path / "data")]
        environment = os.environ | {"PYTHONPATH": str(ROOT)}
        return subprocess.run(command, capture_output=True, text=True, env=environment, timeout=60, cwd=ROOT)

    made = fredholm("create", "alice", "--role", "admin")
    text = made.stdout.strip()
    assert re.fullmatch(r"frd_[0-9a-f]{10}_[A-Za-z0-9_-]{43}", text), made.stderr
    listed = fredholm("list").stdout
    assert "alice" in listed
    assert "in use" in listed
    assert text not in listed
    assert fredholm("revoke", text.split("_")[1]).returncode == 0
    assert "revoked" in fredholm("list").stdout
    again = fredholm("revoke", text.split("_")[1])
    assert again.returncode == 2
    assert "no key" in again.stderr


def test_a_secret_that_a_killed_process_left_empty_is_made_anew(tmp_path: Path) -> None:
    path = tmp_path / "secret"
    path.touch()
    secret = read_secret(path)
    assert len(secret) == 32
    assert read_secret(path) == secret
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert [one.name for one in tmp_path.iterdir()] == ["secret"]


def test_all_who_need_a_secret_at_once_get_the_same(tmp_path: Path) -> None:
    with ThreadPoolExecutor(8) as pool:
        assert len(set(pool.map(lambda _: read_secret(tmp_path / "secret"), range(32)))) == 1
