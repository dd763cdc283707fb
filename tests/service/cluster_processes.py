"""A cluster of real processes on this machine: a scheduler and workers, to be joined, killed and started again."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

from service_process import ROOT, is_alive, wait_for


@dataclass
class Process:
    """One command of ours. log: what it says."""

    arguments: list[str]
    log: Path
    environment: dict[str, str] = field(default_factory=dict)
    running: subprocess.Popen[bytes] | None = None

    def start(self) -> Process:
        with self.log.open("ab") as log:
            self.running = subprocess.Popen(
                [sys.executable, "-m", "service.command", *self.arguments],
                env=os.environ | {"PYTHONPATH": str(ROOT)} | self.environment,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )
        return self

    @property
    def pid(self) -> int:
        assert self.running is not None
        return self.running.pid

    def said(self) -> str:
        return self.log.read_text() if self.log.exists() else ""

    def wait_for(self, text: str, times: int = 1) -> None:
        def holds() -> bool:
            assert self.running is not None
            assert self.running.poll() is None, self.said()
            return self.said().count(text) >= times

        wait_for(holds, 240, f"{text!r} of {self.arguments}", self.said)

    def kill(self) -> None:
        assert self.running is not None
        self.running.kill()
        self.running.wait()

    def stop(self) -> int:
        """As Ctrl-C does; its exit code."""
        assert self.running is not None
        if self.running.poll() is None:
            self.running.send_signal(signal.SIGINT)
        return self.running.wait(60)


class Cluster:
    """A scheduler on a port of its own, and workers by name."""

    def __init__(self, folder: Path, certificates: Path | None = None) -> None:
        self.folder, self.certificates = folder, certificates
        folder.mkdir(exist_ok=True)
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self._secured = [] if certificates is None else ["--certificates", str(certificates)]
        arguments = ["cluster", "scheduler", "--port", str(self.port), *self._secured]
        self.scheduler = Process(arguments, folder / "scheduler.log")
        self.workers: dict[str, Process] = {}

    @property
    def address(self) -> str:
        return f"{'tls' if self.certificates else 'tcp'}://127.0.0.1:{self.port}"

    def start(self, *workers: str) -> Cluster:
        self.scheduler.start()
        for name in workers:
            self.add(name)
        self.scheduler.wait_for("The scheduler is at")
        for name in workers:
            self.workers[name].wait_for(f"The worker {name} is at")
        return self

    def add(self, name: str) -> Process:
        arguments = ["worker", self.address, "--name", name, "--threads", "1", *self._secured]
        arguments += ["--folder", str(self.folder)]
        self.workers[name] = Process(arguments, self.folder / f"{name}.log").start()
        return self.workers[name]

    def render_pids(self, name: str) -> list[int]:
        """Render processes that a worker has had, newest last."""
        plain = re.sub(r"\x1b\[[0-9;]*m", "", self.workers[name].said())
        return [int(pid) for pid in re.findall(r"render process started.*?pid=(\d+)", plain)]

    def stop(self) -> None:
        for process in (*self.workers.values(), self.scheduler):
            if process.running is not None:
                process.running.terminate()
        for process in (*self.workers.values(), self.scheduler):
            if process.running is not None:
                try:
                    process.running.wait(20)
                except subprocess.TimeoutExpired:
                    process.kill()
        left = [pid for name in self.workers for pid in self.render_pids(name)]
        wait_for(lambda: not any(map(is_alive, left)), 60, "the render processes of the workers end")
