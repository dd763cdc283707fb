"""A service of its own for hostile inputs, with small limits and canaries beside its data."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from service.clients import Keys
from service.store import Database
from service.store.keys import KeyStore
from tests.faults.canary import Canary, names_of, place_canaries
from tests.faults.seeds import OBJ
from tests.service.service_process import Server

CLIENTS = 3  # as many as there are processes that check scenes
LIMITS = {
    "FREDHOLM_MAX_BODY_BYTES": str(16 << 20),
    "FREDHOLM_MAX_BUNDLE_FILES": "50",
    "FREDHOLM_MAX_BUNDLE_BYTES": str(64 << 20),
    "FREDHOLM_MAX_SCENE_BYTES": str(256 << 20),
    "FREDHOLM_WARM_UP": "0",
}


@dataclass(frozen=True)
class Place:
    """The attacked service, keys of its clients, where canaries lie, and the names by which scenes ask for them."""

    server: Server
    keys: list[str]
    canaries: list[Path]
    names: list[str]


def _own_folders(server: Server) -> list[Path]:
    """Where the service and the processes that check scenes work, and keep what is theirs."""
    inspectors = [folder for folder in (server.data_dir / "inspection").iterdir() if folder.is_dir()]
    return [server.data_dir, *(folder / name for folder in inspectors for name in ("empty", "home"))]


@pytest.fixture(scope="session")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    """A service with canaries in its working folder, its home, its folder of temporary files, and all of its own."""
    folder = tmp_path_factory.mktemp("victim")
    outside = [folder / name for name in ("started", "home", "temporary", "above")]
    for one in outside:
        one.mkdir()
    environment = LIMITS | {"HOME": str(outside[1]), "TMPDIR": str(outside[2]), "FREDHOLM_API_KEYS": "on"}
    environment |= {"FREDHOLM_REQUESTS_PER_SECOND": "10000", "FREDHOLM_REQUESTS_BURST": "100000"}
    server = Server(folder / "above" / "data", environment, folder=outside[0]).start(wait_until="/healthz")
    folders = [*outside, *_own_folders(server)]
    canaries = [path for one in folders for path in place_canaries(one)]
    seen_from = server.data_dir / "inspection" / "0" / "incoming" / ".upload-x" / "a"
    names = sorted({name for one in folders for name in names_of(one, seen_from)})
    yield Place(server, made_keys(server, CLIENTS), canaries, names)
    server.stop()


def made_keys(server: Server, count: int) -> list[str]:
    """Keys of clients of their own: each has its scenes checked beside the others'."""
    database = Database(f"sqlite:///{server.data_dir / 'fredholm.sqlite'}")
    keys = Keys(KeyStore(database), server.data_dir / "secret")
    made = [keys.create(f"client{i}", "submit")[1] for i in range(count)]
    database.close()
    return made


@pytest.fixture(scope="session")
def victim(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """The service that is attacked."""
    running = Server(tmp_path_factory.mktemp("victim") / "data", dict(LIMITS)).start()
    yield running
    running.stop()


@pytest.fixture(scope="session")
def canaries(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Readable, valid files outside every bundle: reading one would succeed."""
    folder = tmp_path_factory.mktemp("canary")
    (folder / "canary.obj").write_bytes(OBJ)
    (folder / "canary.xml").write_text('<scene version="3.0.0"><shape type="sphere"/></scene>')
    (folder / "canary.spd").write_text("400 0.5\n700 0.5\n")
    return sorted(folder.iterdir())


@pytest.fixture
def canary(canaries: list[Path]) -> Iterator[Canary]:
    """Watches the canaries."""
    watching = Canary(canaries)
    yield watching
    watching.close()
