"""The short form of `make crowd`: a hostile client of each kind, and an honest one who is served. Nothing is timed."""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path

import pytest
from service_process import ROOT


def test_an_honest_client_is_served_among_hostile_ones(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", [str(ROOT), *sys.path])
    from tests.crowd.__main__ import AIMS, measure, started

    server, keys = started(tmp_path, {"FREDHOLM_WARM_UP": "0", "FREDHOLM_MAX_UNKNOWN_CONNECTIONS": "64"})
    try:
        _, seen = asyncio.run(measure(server, keys, 5.0, 64, previews=1))
    finally:
        server.stop()
    assert seen.failures == []
    assert seen.previews, "no first picture came"
    assert len(seen.answers) > 1
    assert {"silent connections", "many jobs"} <= seen.hostile.keys(), "the crowd was there"
    assert seen.memory["service"] < AIMS["service"]
    assert 0 < seen.memory["render"] < seen.budget
    assert "Traceback" not in server.log_path.read_text()
