"""A real service for the tests: its own process, its own render process, a free port, a fresh data folder."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from postgres import MISSING, Postgres, is_installed
from service_process import Server

_SHARED_MEMORY = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None


@pytest.fixture(scope="session")
def postgres() -> Iterator[Postgres]:
    """A PostgreSQL server of the tests' own."""
    if not is_installed():
        pytest.skip(MISSING)
    running = Postgres().start()
    yield running
    running.stop()


@pytest.fixture(params=["sqlite", "postgresql"])
def database_url(request: pytest.FixtureRequest) -> Iterator[str]:
    """URL of a fresh database: what is tested with it holds on both kinds."""
    if request.param == "postgresql":
        yield request.getfixturevalue("postgres").new_database()
        return
    # Nothing here must survive a power cut, so nothing waits for the disk where there is shared memory.
    with tempfile.TemporaryDirectory(prefix="fredholm-test-", dir=_SHARED_MEMORY) as folder:
        yield f"sqlite:///{folder}/test.sqlite"


@pytest.fixture(scope="session")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """A warm service that most tests share: leave no job running."""
    environment = {
        "FREDHOLM_MAX_BODY_BYTES": str(1 << 20),
        "FREDHOLM_MAX_BUNDLE_FILES": "20",
        "FREDHOLM_MAX_BUNDLE_BYTES": str(8 << 20),
        "FREDHOLM_CHECKPOINT_SECONDS": "0.5",
        "FREDHOLM_PING_SECONDS": "2",
    }
    running = Server(tmp_path_factory.mktemp("service") / "data", environment).start()
    yield running
    running.stop()


@pytest.fixture
def client(server: Server) -> Iterator[httpx.Client]:
    """HTTP to the shared service."""
    with server.client() as http:
        yield http


@pytest.fixture(scope="session")
def finished(server: Server) -> dict[str, Any]:
    """A finished small job of the shared service."""
    return server.wait_ended(server.submit({"spp": 128})["id"])


@pytest.fixture
def own_server(tmp_path: Path) -> Iterator[Server]:
    """A service of the test's own, not yet started: to be killed."""
    mine = Server(tmp_path / "data", {"FREDHOLM_CHECKPOINT_SECONDS": "0.3", "FREDHOLM_WARM_UP": "0"})
    yield mine
    if mine.process is not None and mine.process.poll() is None:
        mine.kill()
