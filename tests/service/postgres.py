"""A PostgreSQL of the tests' own, where its programs are installed."""

from __future__ import annotations

import contextlib
import glob
import os
import shutil
import signal
import socket
import subprocess
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from uuid import uuid4

MISSING = "PostgreSQL is not installed: apt-get install postgresql brings it, the tests start their own server"


def program(name: str) -> str | None:
    """Where a program of PostgreSQL is: Debian keeps them off the PATH."""
    found = sorted(glob.glob(f"/usr/lib/postgresql/*/bin/{name}"))
    return shutil.which(name) or (found[-1] if found else None)


def is_installed() -> bool:
    """Whether a server can be started."""
    return all(program(name) for name in ("initdb", "pg_ctl", "psql"))


@dataclass
class Postgres:
    """A server in a temporary folder. It refuses to run as root, so root lends it to the user postgres."""

    folder: Path = field(default_factory=lambda: Path(tempfile.mkdtemp(prefix="fredholm-pg-", dir="/tmp")))
    port: int = 0

    def start(self) -> Postgres:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        if os.geteuid() == 0:
            shutil.chown(self.folder, "postgres", "postgres")
        self._run("initdb", "-A", "trust", "-U", "postgres", "-D", str(self.folder / "data"), "-E", "UTF8", "--no-sync")
        return self.resume()

    def resume(self) -> Postgres:
        """Serve what is there."""
        # Nothing here must survive a power cut, so nothing waits for the disk.
        options = f"-p {self.port} -k {self.folder} -c listen_addresses=127.0.0.1 -c fsync=off -c max_connections=200"
        log = str(self.folder / "log")
        self._run("pg_ctl", "-D", str(self.folder / "data"), "-l", log, "-o", options, "-w", "start")
        return self

    def halt(self) -> None:
        """End the server, as a crash would; its data stays."""
        self._run("pg_ctl", "-D", str(self.folder / "data"), "-m", "immediate", "-w", "stop")

    @contextlib.contextmanager
    def frozen(self) -> Iterator[None]:
        """Hangs, with all of its processes, until the end of the block: connections stay open, nothing is answered."""
        first = int((self.folder / "data" / "postmaster.pid").read_text().split()[0])
        pids = [first, *_children(first)]
        for pid in pids:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGSTOP)
        try:
            yield
        finally:
            for pid in pids:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGCONT)

    def stop(self) -> None:
        self.halt()
        shutil.rmtree(self.folder, ignore_errors=True)

    def new_database(self) -> str:
        """URL of a fresh database."""
        name = f"t{uuid4().hex[:12]}"
        address = f"postgresql://postgres@127.0.0.1:{self.port}"
        self._run("psql", "-q", "-c", f"CREATE DATABASE {name}", f"{address}/postgres")
        return f"{address}/{name}"

    def _run(self, name: str, *arguments: str) -> None:
        found = program(name)
        assert found is not None
        user = "postgres" if os.geteuid() == 0 else None
        done = subprocess.run(
            [found, *arguments],
            user=user,
            cwd=self.folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE if name != "pg_ctl" else subprocess.DEVNULL,
            stderr=subprocess.STDOUT if name != "pg_ctl" else subprocess.DEVNULL,
            env=os.environ | {"LC_ALL": "C"},
            timeout=60,
        )
        assert done.returncode == 0, f"{name}: {done.stdout!r}"


def _children(parent: int) -> list[int]:
    found = []
    for status in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            if int(status.read_text().rpartition(")")[2].split()[1]) == parent:
                found.append(int(status.parent.name))
    return found
