"""The render process's side: passes of its renders go to the cluster, and their results come back.

It speaks to the gate through a Unix socket, the only kind that it may open.
"""

from __future__ import annotations

import contextlib
import itertools
import socket
import threading
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from renderer import plan
from service.cluster.wire import FRAME, narrowed, pack, unpack
from service.engine.turn import Failure

if TYPE_CHECKING:
    from renderer import Scene, Settings

_STEP_SECONDS = 0.05
PASSES_OF_PLACE = 2  # one runs, and one waits beside it: no place waits for the network
_MOST_LAUNCHED = 1024


class PassFailed(Exception):
    """A pass could not be rendered anywhere. failure: why, as users are told."""

    def __init__(self, failure: Failure) -> None:
        self.failure = failure
        super().__init__(failure.detail)


@dataclass(frozen=True, slots=True)
class Source:
    """What workers load: a gallery name or `id/folder/file` of an uploaded scene, with values for its parameters."""

    scene: str
    is_gallery: bool
    parameters: dict[str, str]


class _Answer:
    """What a pass waits for. message: once it is there."""

    def __init__(self) -> None:
        self.is_there = threading.Event()
        self.message = b""

    def take(self, message: bytes) -> None:
        """Called by the thread that listens."""
        self.message = message
        self.is_there.set()


class RemotePass:
    """A pass on its way: implements `renderer.launcher.Launched`. seconds: that it took there, once it is done."""

    is_long = False

    def __init__(self, gate: GateConnection, number: int, answer: _Answer) -> None:
        self._gate, self._number, self._answer = gate, number, answer
        self.seconds = 0.0
        self._results: tuple[NDArray, NDArray, NDArray] | None = None

    def step(self) -> bool:
        """Waits a moment. Raises PassFailed, ConnectionError."""
        if self._results is not None:
            return True
        if not self._answer.is_there.wait(_STEP_SECONDS):
            self._gate.check()
            return False
        told, arrays = unpack(self._answer.message)
        if told["state"] != "done":
            raise PassFailed(Failure(**told["failure"]))
        self.seconds = float(told["seconds"])
        radiance = arrays["radiance"]
        if len(radiance) == 1:  # one value for all three channels
            radiance = np.repeat(radiance, 3, axis=0)
        invalid, segments = (arrays[name].astype(np.uint32) for name in ("invalid", "segments"))
        self._results = radiance, invalid, segments
        return True

    def results(self) -> tuple[NDArray, NDArray, NDArray]:
        """As of `Launched`."""
        assert self._results is not None
        return self._results

    def __del__(self) -> None:
        if not self._answer.is_there.is_set():
            self._gate.drop(self._number)


class GateConnection:
    """The connection of this process to the gate. made_with: versions and kind of device, that workers must share."""

    def __init__(self, address: str, made_with: str) -> None:
        self.places = 0
        self._numbers = itertools.count(1)
        self._waiting: dict[int, _Answer] = {}
        self._sending = threading.Lock()
        self._broken: str | None = None
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._socket.connect(address)
        self._send(pack({"do": "hello", "made_with": made_with}))
        threading.Thread(target=self._listen, name="gate", daemon=True).start()

    def submit(self, told: dict[str, Any], **arrays: NDArray[Any]) -> RemotePass:
        """Have a pass rendered."""
        number = next(self._numbers)
        answer = self._waiting[number] = _Answer()
        self._send(pack(told | {"do": "render", "number": number}, **arrays))
        return RemotePass(self, number, answer)

    def drop(self, number: int) -> None:
        """Nobody wants this pass any more."""
        if self._waiting.pop(number, None) is not None:
            with contextlib.suppress(OSError):
                self._send(pack({"do": "drop", "number": number}))

    def check(self) -> None:
        """Raises ConnectionError once nothing will come any more."""
        if self._broken is not None:
            raise ConnectionError(f"the service's gate to its cluster is gone: {self._broken}")

    def _send(self, message: bytes) -> None:
        with self._sending:
            self._socket.sendall(FRAME.pack(len(message)) + message)

    def _listen(self) -> None:
        try:
            while True:
                (size,) = FRAME.unpack(self._read(FRAME.size))
                message = self._read(size)
                told, _ = unpack(message)
                if "places" in told:
                    self.places = told["places"]
                elif (waiting := self._waiting.pop(told["number"], None)) is not None:
                    waiting.take(message)
        except (OSError, ValueError) as error:
            self._broken = str(error)

    def _read(self, size: int) -> bytes:
        buffer, at = bytearray(size), 0
        with memoryview(buffer) as view:
            while at < size:
                if (n := self._socket.recv_into(view[at:])) == 0:
                    raise ConnectionError("it closed")
                at += n
        return bytes(buffer)


_connections: dict[str, GateConnection] = {}


def connection(address: str, scene: Scene) -> GateConnection:
    """The one of this process, made at first use."""
    from renderer.backend import made_with

    if address not in _connections:
        _connections[address] = GateConnection(address, made_with(scene.variant))
    return _connections[address]


class RemoteLauncher:
    """Implements `renderer.launcher.Launcher` for one render: scene and settings, as they go to the workers."""

    def __init__(self, gate: GateConnection, source: Source, scene: Scene, settings: Settings) -> None:
        self._gate = gate
        self._job = {
            "scene": source.scene,
            "is_gallery": source.is_gallery,
            "parameters": source.parameters,
            "settings": settings.as_dict(),
            "digest": scene.digest,
            "guide": scene.kernel(settings).guide_digest if settings.guide == "on" else None,
        }
        self._is_seen = False  # whether a pass has come back: until then the picture is awaited

    @property
    def places(self) -> int:
        """Workers of the right kind."""
        return self._gate.places

    @property
    def most_launched(self) -> int:
        """As many as keep all of them busy."""
        return min(max(1, PASSES_OF_PLACE * self._gate.places), _MOST_LAUNCHED)

    def launch(self, work: plan.Pass) -> RemotePass:
        """Sends a pass off; the first one of a render goes before all others that wait."""
        told: dict[str, Any] = {"job": self._job, "is_look": work.is_look, "priority": 0 if self._is_seen else 1}
        arrays = {"pixels": work.pixels}
        for name, value in (("first", work.first), ("n_replicates", work.n_replicates)):
            if isinstance(value, int):
                told[name] = value
            else:
                arrays[name] = narrowed(value)
        return self._gate.submit(told, **arrays)

    def seconds_of(self, launched: Any) -> float:
        """As the worker measured it."""
        self._is_seen = True
        return launched.seconds
