"""Facts about the gate between a render process and the cluster: whom it counts, what it says, whom it refuses."""

from __future__ import annotations

import asyncio
import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("distributed", reason="the extra cluster is not installed")

import distributed

from service.cluster.gate import Gate, tag_of
from service.cluster.remote import GateConnection
from service.cluster.security import ClusterError
from service.cluster.wire import FRAME, pack

QUIET: dict[str, Any] = {"dashboard": False, "dashboard_address": "127.0.0.1:0"}


async def until(holds: Callable[[], object], told: Callable[[], object] = lambda: "") -> None:
    ends = time.monotonic() + 60
    while not holds():
        assert time.monotonic() < ends, told()
        await asyncio.sleep(0.05)


def worker(address: str, tag: str, name: str, folder: Path) -> Any:
    how = {"nthreads": 1, "memory_limit": 0, "resources": {tag: 1}, "local_directory": str(folder), "host": "127.0.0.1"}
    return distributed.Worker(address, name=name, **QUIET, **how)


def test_workers_of_another_kind_are_not_used_and_that_is_said(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with distributed.Scheduler(host="127.0.0.1", port=0, **QUIET) as scheduler:
            gate = Gate(scheduler.address, None, tmp_path / "gate", tmp_path, 3)
            await asyncio.to_thread(gate.start)
            try:
                await until(lambda: gate.missing() == "no worker has joined the cluster", gate.missing)
                here = await asyncio.to_thread(GateConnection, str(tmp_path / "gate"), "version 2")
                async with worker(scheduler.address, tag_of("version 1"), "old", tmp_path):
                    await until(lambda: "have other versions" in str(gate.missing()), gate.missing)
                    assert here.places == 0
                    async with worker(scheduler.address, tag_of("version 2"), "new", tmp_path):
                        await until(lambda: here.places == 1, gate.workers)
                        assert gate.missing() is None
                        assert {one.name: gate.is_usable(one) for one in gate.workers()} == {"old": False, "new": True}
                    await until(lambda: here.places == 0, gate.workers)
            finally:
                await asyncio.to_thread(gate.stop)

    asyncio.run(scenario())


def test_without_a_scheduler_passes_wait_and_a_gate_that_ends_is_noticed(tmp_path: Path) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        nobody = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    gate = Gate(nobody, None, tmp_path / "gate", tmp_path, 3)
    gate.start()
    try:
        assert str(gate.missing()) == f"the cluster's scheduler at {nobody} does not answer"
        here = GateConnection(str(tmp_path / "gate"), "version 1")
        waiting = here.submit({"job": {}, "priority": 0}, pixels=np.zeros(3, np.uint32))
        assert not waiting.step()
        assert not waiting.step()
    finally:
        gate.stop()
    waited = (waiting.step() for _ in range(200))
    with pytest.raises(ConnectionError, match="gate to its cluster is gone"):
        list(waited)


@pytest.mark.parametrize(
    "message",
    [b"no message", pack({"do": "harm"}), pack({}), pack({"do": "hello"}), pack({"do": "render", "number": "x"})],
    ids=["bytes", "verb", "nothing", "no kind", "no number"],
)
def test_what_is_no_message_ends_its_connection_and_no_other(tmp_path: Path, message: bytes) -> None:
    gate = Gate("tcp://127.0.0.1:1", None, tmp_path / "gate", tmp_path, 3)
    gate.start()
    try:
        here = GateConnection(str(tmp_path / "gate"), "version 1")
        with socket.socket(socket.AF_UNIX) as stranger:
            stranger.settimeout(20)
            stranger.connect(str(tmp_path / "gate"))
            stranger.sendall(FRAME.pack(len(message)) + message)
            assert stranger.recv(1) == b""
        here.submit({"job": {}, "priority": 0}).step()
        here.check()
    finally:
        gate.stop()


def test_a_path_too_long_for_a_socket_is_refused_with_the_way_out(tmp_path: Path) -> None:
    with pytest.raises(ClusterError, match="too long for a socket; choose a data folder with a shorter path"):
        Gate("tcp://127.0.0.1:1", None, tmp_path / ("x" * 120), tmp_path, 3)
