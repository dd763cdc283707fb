"""Turns go to whoever has waited longest, and whoever gives up stands in nobody's way."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import pytest

from service.store import Database
from service.store.turns import Turns


def test_whoever_has_waited_longest_is_next() -> None:
    turns, order = Turns(), list[str]()
    assert turns.acquire(1.0)

    def wait(name: str) -> None:
        assert turns.acquire(30.0)
        order.append(name)
        turns.release()

    threads = [threading.Thread(target=wait, args=(name,)) for name in "abc"]
    for n, thread in enumerate(threads, 1):
        thread.start()
        while len(turns._waiting) < n:
            time.sleep(0.001)
    turns.release()
    assert turns.acquire(30.0), "asked again at once"
    assert order == ["a", "b", "c"], "those who waited came first"
    turns.release()
    for thread in threads:
        thread.join(30)


def test_whoever_gives_up_is_passed_over() -> None:
    turns = Turns()
    assert turns.acquire(1.0)
    assert not turns.acquire(0.01)
    turns.release()
    assert turns.acquire(0.01)
    turns.release()


def test_writers_of_sqlite_have_their_turns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """SQLite itself gives the lock to whoever asks when it is free, and those who wait look again now and then only."""
    monkeypatch.setattr("service.store.database._WRITE_SECONDS", 30.0)
    database, order = Database(f"sqlite:///{tmp_path}/a.sqlite"), list[str]()

    def write(name: str) -> None:
        with database.write():
            order.append(name)

    threads = [threading.Thread(target=write, args=(name,)) for name in "abc"]
    with database.write():
        for thread in threads:
            thread.start()
            time.sleep(0.1)
    with database.write():
        assert order == ["a", "b", "c"]
    for thread in threads:
        thread.join(30)
    database.close()
