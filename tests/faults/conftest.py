"""A service of its own for hostile inputs, with small limits and canaries beside its data."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.faults.canary import Canary
from tests.faults.seeds import OBJ
from tests.service.service_process import Server

LIMITS = {
    "FREDHOLM_MAX_BODY_BYTES": str(16 << 20),
    "FREDHOLM_MAX_BUNDLE_FILES": "50",
    "FREDHOLM_MAX_BUNDLE_BYTES": str(64 << 20),
    "FREDHOLM_MAX_SCENE_BYTES": str(256 << 20),
    "FREDHOLM_WARM_UP": "0",
}


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
