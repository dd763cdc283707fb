"""A service of its own process, for whoever looks at the page: tests, the screenshot, the timings."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "service" / "static" / "index.html"
START_SECONDS = 240
# WebGL2 runs on the processor through SwiftShader, so no graphics device is needed.
CHROMIUM_ARGUMENTS = [
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
    "--disable-quic",
]
_CODE = "import sys, pathlib as p; from service.serve import run; run(None, int(sys.argv[1]), p.Path(sys.argv[2]))"


@dataclass
class Service:
    """A service: `start`, `stop`, `kill`, and `start` again on the same port with the same data."""

    folder: Path
    environment: dict[str, str] = field(default_factory=dict)
    port: int = 0
    process: subprocess.Popen[bytes] | None = None

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def start(self) -> None:
        """Returns once jobs start at once."""
        if self.port == 0:
            with socket.socket() as free:
                free.bind(("127.0.0.1", 0))
                self.port = free.getsockname()[1]
        environment = os.environ | {"PYTHONPATH": str(ROOT)} | self.environment
        log = self.folder / "log.txt"
        with log.open("ab") as output:
            self.process = subprocess.Popen(
                [sys.executable, "-c", _CODE, str(self.port), str(self.folder / "data")],
                cwd=ROOT,
                env=environment,
                stdout=output,
                stderr=output,
            )
        ends = time.monotonic() + START_SECONDS
        while time.monotonic() < ends:
            assert self.process.poll() is None, log.read_text()
            with contextlib.suppress(httpx.TransportError):
                if httpx.get(f"{self.url}/readyz", timeout=5).status_code == 200:
                    return
            time.sleep(0.1)
        raise AssertionError(f"the service was not ready within {START_SECONDS} s\n{log.read_text()}")

    def stop(self) -> None:
        """As Ctrl-C does."""
        if self.process is None:
            return
        self.process.send_signal(signal.SIGINT)
        try:
            self.process.wait(60)
        except subprocess.TimeoutExpired:
            self.kill()

    def kill(self) -> None:
        """As a power cut does."""
        if self.process is not None:
            self.process.kill()
            self.process.wait()

    def submit(self, target: dict[str, Any], scene: str = "cornell-box", **settings: Any) -> str:
        """Id of a new job."""
        body = {"scene": {"gallery": scene}, "target": target, "settings": settings}
        answer = httpx.post(f"{self.url}/api/jobs", json=body, timeout=30)
        assert answer.status_code == 201, answer.text
        return answer.json()["id"]

    def jobs(self) -> list[dict[str, Any]]:
        """The newest first."""
        return httpx.get(f"{self.url}/api/jobs", timeout=30).json()["jobs"]

    def job(self, job_id: str) -> dict[str, Any]:
        return httpx.get(f"{self.url}/api/jobs/{job_id}", timeout=30).json()

    def delete(self, job_id: str) -> None:
        assert httpx.delete(f"{self.url}/api/jobs/{job_id}", timeout=30).is_success

    def cancel(self, job_id: str) -> None:
        assert httpx.post(f"{self.url}/api/jobs/{job_id}/cancel", timeout=30).is_success

    def wait_ended(self, job_id: str, seconds: float = 180) -> dict[str, Any]:
        ends = time.monotonic() + seconds
        while (job := self.job(job_id))["state"] not in ("succeeded", "failed", "cancelled"):
            assert time.monotonic() < ends, f"job {job_id} did not end within {seconds:g} s: {job}"
            time.sleep(0.1)
        return job


@contextlib.contextmanager
def serve(folder: Path, **environment: str) -> Iterator[Service]:
    """A running service with an empty data folder."""
    running = Service(folder, environment)
    try:
        running.start()
        yield running
    finally:
        running.stop()
