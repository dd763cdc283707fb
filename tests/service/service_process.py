"""A real service as a process of its own, to be asked, killed and started again."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
import pytest

from service.clients import Keys
from service.store import Database
from service.store.keys import KeyStore

ROOT = Path(__file__).resolve().parents[2]
ENDED = ("succeeded", "failed", "cancelled")
SMALL = {"width": 64, "height": 64, "seed": 1}
LONG = {"seconds": 600}

PLAIN_SCENE = """<scene version="3.0.0">
  <sensor type="perspective"><float name="fov" value="40"/>
    <transform name="to_world"><lookat origin="0, 0, 5" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="32"/><integer name="height" value="24"/></film>
  </sensor>
  <emitter type="constant"><rgb name="radiance" value="0.5"/></emitter>
  <shape type="sphere"><bsdf type="diffuse"><rgb name="reflectance" value="0.4"/></bsdf></shape>
</scene>
"""


@dataclass
class Server:
    """One service process that can be started, asked, killed and started again on the same data."""

    data_dir: Path
    environment: dict[str, str] = field(default_factory=dict)
    port: int = 0
    process: subprocess.Popen[bytes] | None = None
    log_file: Path | None = None  # None: beside the data folder
    wrapper: list[str] = field(default_factory=list)  # command that runs the service's
    folder: Path = ROOT  # in which it is started

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    @property
    def log_path(self) -> Path:
        return self.log_file or self.data_dir.parent / f"{self.data_dir.name}.log"

    def start(self, *, wait_until: str = "/readyz", port: int | None = None) -> Server:
        self.launch(port)
        wait_for(lambda: self._answers(wait_until), 240, f"{wait_until} of the service")
        return self

    def launch(self, port: int | None = None) -> subprocess.Popen[bytes]:
        """Begin to start."""
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = port or free.getsockname()[1]
        code = (
            "import sys, pathlib; from service.serve import run;"
            f"run('127.0.0.1', {self.port}, pathlib.Path(sys.argv[1]), False)"
        )
        environment = os.environ | {"FREDHOLM_LOG_JSON": "1", "PYTHONPATH": str(ROOT)} | self.environment
        with self.log_path.open("ab") as log:
            self.process = subprocess.Popen(
                [*self.wrapper, sys.executable, "-c", code, str(self.data_dir)],
                cwd=self.folder,
                env=environment,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )
        return self.process

    def _answers(self, path: str) -> bool:
        assert self.process is not None
        assert self.process.poll() is None, self.log_path.read_text()
        with contextlib.suppress(httpx.TransportError):
            return httpx.get(self.url + path).status_code == 200
        return False

    def kill(self) -> None:
        """End the server as a power cut would."""
        assert self.process is not None
        self.process.kill()
        self.process.wait()
        assert_no_secret_in(self.log_path)

    def stop(self) -> float:
        """End the server as Ctrl-C does; seconds that it took."""
        assert self.process is not None
        began = time.perf_counter()
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
            self.process.wait(60)
        took = time.perf_counter() - began
        assert_no_secret_in(self.log_path)
        return took

    def log(self) -> list[dict[str, Any]]:
        """What was logged, line by line."""
        lines = self.log_path.read_text().splitlines()
        return [json.loads(line) for line in lines if line.startswith("{")]

    def render_pids(self, engine: str = "render") -> list[int]:
        """Pids of an engine's processes so far, newest last."""
        started = [line for line in self.log() if line.get("event") == "render process started"]
        return [line["pid"] for line in started if line.get("engine") == engine]

    def displays(self) -> list[Path]:
        """What the service has in shared memory."""
        data = hashlib.sha256(str((self.data_dir / "estimates").resolve()).encode()).hexdigest()[:12]
        return list(Path("/dev/shm").glob(f"fredholm-{data}-*"))

    def client(self) -> httpx.Client:
        return httpx.Client(base_url=self.url, timeout=30)

    def submit(self, target: dict[str, Any], settings: dict[str, Any] | None = None, **scene: str) -> dict[str, Any]:
        body = {"scene": scene or {"gallery": "cornell-box"}, "target": target, "settings": settings or SMALL}
        answer = httpx.post(f"{self.url}/api/jobs", json=body, timeout=30)
        assert answer.status_code == 201, answer.text
        return answer.json()

    def job(self, job_id: str) -> dict[str, Any]:
        return httpx.get(f"{self.url}/api/jobs/{job_id}", timeout=30).json()

    def wait(self, job_id: str, until: Callable[[dict[str, Any]], bool], seconds: float = 180) -> dict[str, Any]:
        """The job once `until` holds."""
        found: dict[str, Any] = {}

        def holds() -> bool:
            found.clear()
            found.update(self.job(job_id))
            return until(found)

        wait_for(holds, seconds, f"job {job_id}", lambda: f"{found}\n{self.log_path.read_text()[-3000:]}")
        return found

    def wait_ended(self, job_id: str, seconds: float = 180) -> dict[str, Any]:
        return self.wait(job_id, lambda job: job["state"] in ENDED, seconds)

    def cancel(self, job_id: str) -> httpx.Response:
        return httpx.post(f"{self.url}/api/jobs/{job_id}/cancel", timeout=30)


def made_keys(server: Server) -> dict[str, str]:
    """A key for each role, whose client has the role's name."""
    database = Database(f"sqlite:///{server.data_dir / 'fredholm.sqlite'}")
    keys = Keys(KeyStore(database), server.data_dir / "secret")
    made = {role: keys.create(role, role)[1] for role in ("read", "submit", "admin")}
    database.close()
    return made


def assert_no_secret_in(log: Path) -> None:
    """No service of the tests may write a key, in whatever it was interrupted."""
    told = log.read_text(errors="replace") if log.exists() else ""  # gone with the small disk that it lay on
    found = re.findall(r"frd_[0-9a-f]{10}_[A-Za-z0-9_-]{20,}", told)
    assert not found, f"{len(found)} keys in {log}"


def wait_for(holds: Callable[[], bool], seconds: float, what: str, told: Callable[[], str] = lambda: "") -> None:
    """Poll until `holds`; fail after `seconds` with what was seen last."""
    ends = time.monotonic() + seconds
    while not holds():
        if time.monotonic() > ends:
            pytest.fail(f"{what}: not within {seconds:g} s\n{told()}")
        time.sleep(0.05)


def is_alive(pid: int) -> bool:
    """Whether a process runs; one that only waits to be reaped does not."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    status = Path(f"/proc/{pid}/stat")
    return not status.exists() or status.read_text().rpartition(")")[2].split()[0] != "Z"
