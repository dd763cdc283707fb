"""Faults of every kind that a service meets, done to a real one while it renders and clients ask.

Each fault is over when its function returns; the campaign then waits until the service is ready again. What a kind
needs (a file system of its own, PostgreSQL, a C compiler) decides where it can happen.
"""

from __future__ import annotations

import contextlib
import io
import os
import random
import signal
import socket
import sqlite3
import struct
import subprocess
import sys
import threading
import time
import zipfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from uuid import uuid4

import httpx
from postgres import Postgres
from service_process import ENDED, PLAIN_SCENE, Server, is_alive, wait_for

from service.store import Database, JobStore

_BUSY = 2  # unended jobs
_TOLD_LATER = (413, 429, 503, 507)  # come again, or say what is in the way
_CLOCK = """
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/time.h>
#include <time.h>
static volatile long long *offset;
__attribute__((constructor)) static void begin(void) {
    const char *path = getenv("CHAOS_CLOCK");
    int file = path ? open(path, O_RDONLY) : -1;
    void *at = file < 0 ? MAP_FAILED : mmap(0, 8, PROT_READ, MAP_SHARED, file, 0);
    if (at != MAP_FAILED) offset = at;
}
int clock_gettime(clockid_t id, struct timespec *found) {
    static int (*real)(clockid_t, struct timespec *);
    if (!real) real = (int (*)(clockid_t, struct timespec *)) dlsym(RTLD_NEXT, "clock_gettime");
    int failed = real(id, found);
    if (!failed && offset && (id == CLOCK_REALTIME || id == CLOCK_REALTIME_COARSE)) found->tv_sec += *offset;
    return failed;
}
time_t time(time_t *found) {
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    if (found) *found = now.tv_sec;
    return now.tv_sec;
}
int gettimeofday(struct timeval *found, void *zone) {
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    found->tv_sec = now.tv_sec;
    found->tv_usec = now.tv_nsec / 1000;
    return 0;
}
"""


@dataclass(frozen=True, eq=False)  # told apart, and found, by identity
class Wanted:
    """A job, as its client asks for it. scene: of the gallery; None: one that was uploaded."""

    scene: str | None
    target: dict[str, Any]
    settings: dict[str, Any]


# Those that are there to be disturbed, and those that clients ask for meanwhile.
LONG = (
    Wanted("cornell-box", {"spp": 2048}, {"width": 32, "height": 32, "seed": 1}),
    Wanted(None, {"spp": 3072}, {"width": 32, "height": 32, "seed": 2}),
    Wanted("cornell-box", {"error": 0.01, "spp": 2048}, {"width": 32, "height": 24, "seed": 3}),
)
SHORT = (
    Wanted("cornell-box", {"spp": 128}, {"width": 16, "height": 16, "seed": 4}),
    Wanted(None, {"spp": 256}, {"width": 16, "height": 16, "seed": 5}),
)


@dataclass
class Chaos:
    """A service, what was acknowledged by it, and the places where it can be hurt.

    disk, temporary: small file systems that the data folder and temporary files are on; None: not to be had here.
    clock: file with the seconds by which the service's clock is wrong.
    """

    server: Server
    rng: random.Random
    folder: Path
    disk: Path | None = None
    temporary: Path | None = None
    postgres: Postgres | None = None
    clock: Path | None = None
    jobs: dict[str, Wanted] = field(default_factory=dict)
    scenes: dict[str, str] = field(default_factory=dict)
    wrong: list[str] = field(default_factory=list)
    refused: int = 0
    unanswered: int = 0
    _pending: list[tuple[Wanted, str]] = field(default_factory=list)
    _plain: str = ""

    @property
    def can(self) -> set[str]:
        """What faults may need."""
        found = {"postgres" if self.postgres else "sqlite"}
        return found | ({"disk", "memory"} if self.disk else set()) | ({"clock"} if self.clock else set())

    @property
    def shared_memory(self) -> Path:
        """/dev/shm as the service sees it: its own, so that nobody else's is filled."""
        assert self.server.process is not None
        return Path(f"/proc/{self.server.process.pid}/root/dev/shm")

    def renders(self, engine: str = "render") -> list[int]:
        """Living processes of an engine."""
        return [pid for pid in self.server.render_pids(engine) if is_alive(pid)]

    # ------------------------------ Clients ------------------------------

    def _ask(self, method: str, path: str, **more: Any) -> httpx.Response | None:
        """One answer; None where there was none. What may not be answered is noted."""
        try:
            answer = httpx.request(method, self.server.url + path, timeout=20, **more)
        except httpx.TransportError:
            self.unanswered += 1
            return None
        if answer.status_code in _TOLD_LATER:
            self.refused += 1
            return None
        if answer.status_code >= 300:
            self.wrong.append(f"{method} {path}: {answer.status_code} {answer.text[:300]}")
            return None
        return answer

    def submit(self, choice: Sequence[Wanted] = SHORT) -> None:
        """Ask for a job, or again for one of which nobody knows whether it was taken."""
        wanted, key = self._pending.pop(0) if self._pending else (self.rng.choice(choice), uuid4().hex)
        scene = {"id": self._plain} if wanted.scene is None else {"gallery": wanted.scene}
        body = {"scene": scene, "target": wanted.target, "settings": wanted.settings}
        answer = self._ask("POST", "/api/jobs", json=body, headers={"Idempotency-Key": key})
        if answer is None:
            self._pending.append((wanted, key))
        else:
            self.jobs[answer.json()["id"]] = wanted

    def upload(self) -> None:
        """Send a scene that nobody has sent before."""
        content = PLAIN_SCENE.replace("0.4", f"0.{self.rng.randrange(10**9):09}")
        answer = self._ask("POST", "/api/scenes", files={"file": ("a.xml", content)})
        if answer is not None:
            self.scenes[answer.json()["id"]] = content

    def begin(self) -> None:
        """The scene that jobs of an uploaded one are of."""
        answer = httpx.post(f"{self.server.url}/api/scenes", files={"file": ("a.xml", PLAIN_SCENE)}, timeout=60)
        assert answer.status_code == 201, answer.text
        self._plain = answer.json()["id"]
        self.scenes[self._plain] = PLAIN_SCENE

    def unended(self) -> list[dict[str, Any]]:
        """Jobs that go on."""
        found = httpx.get(f"{self.server.url}/api/jobs?limit=100", timeout=30).json()["jobs"]
        return [job for job in found if job["state"] not in ENDED]

    def keep_busy(self) -> None:
        """Until there is something to lose: jobs, one of them with a picture."""

        def holds() -> bool:
            going = self.unended()
            if len(going) < _BUSY:
                self.submit(LONG)
            return any(job["state"] == "running" and job["frame_seq"] > 0 for job in going) and bool(self.renders())

        wait_for(holds, 120, "a running job", self.events)

    @contextlib.contextmanager
    def asking(self, jobs: int = 1, uploads: int = 1) -> Iterator[None]:
        """Clients that ask meanwhile, and take what they are answered."""
        over = threading.Event()

        def ask() -> None:
            before = (len(self.jobs), len(self.scenes))
            while not over.is_set():
                if len(self.jobs) - before[0] < jobs:
                    self.submit()
                if len(self.scenes) - before[1] < uploads:
                    self.upload()
                over.wait(0.1)

        thread = threading.Thread(target=ask)
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join()

    def wait_ready(self) -> None:
        """Start what has ended, and wait until all is well."""
        assert self.server.process is not None
        if self.server.process.poll() is not None:
            self.server.start(wait_until="/healthz")

        told = ""

        def is_ready() -> bool:
            nonlocal told
            with contextlib.suppress(httpx.TransportError):
                answer = httpx.get(f"{self.server.url}/readyz", timeout=10)
                told = answer.text
                return answer.status_code == 200
            return False

        wait_for(is_ready, 90, "readiness", lambda: f"{told}\n{self.events()}")

    def events(self) -> str:
        """The end of the log without requests."""
        lines = self.server.log_path.read_text().splitlines()
        return "\n".join([line for line in lines if '"event": "request"' not in line][-20:])


# ------------------------------ Kinds ------------------------------


def _kill(pids: list[int]) -> None:
    for pid in pids:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


def kill_service(at: Chaos) -> None:
    with at.asking():
        time.sleep(at.rng.uniform(0, 0.3))
        at.server.kill()
    at.server.start(wait_until="/healthz")


def kill_renderer(at: Chaos) -> None:
    with at.asking():
        _kill(at.renders()[-1:])


def kill_both(at: Chaos) -> None:
    with at.asking():
        time.sleep(at.rng.uniform(0, 0.3))
        _kill(at.renders()[-1:])
        at.server.kill()
    at.server.start(wait_until="/healthz")


def kill_inspectors(at: Chaos) -> None:
    with at.asking(uploads=3):
        time.sleep(at.rng.uniform(0, 0.5))
        _kill(at.renders("inspect"))


def terminate_in_flight(at: Chaos) -> None:
    assert at.server.process is not None
    with at.asking(jobs=3, uploads=3):
        time.sleep(at.rng.uniform(0, 0.4))
        at.server.process.send_signal(signal.SIGTERM)
        at.server.process.wait(60)
    at.server.start(wait_until="/healthz")


@contextlib.contextmanager
def filled(folder: Path, leave: int = 0) -> Iterator[None]:
    """A file system that is full until the end of the block."""
    filler = folder / "filler"
    room = os.statvfs(folder)
    with contextlib.suppress(OSError), filler.open("wb") as file:
        left = room.f_bavail * room.f_frsize - leave
        while left > 0:
            left -= file.write(bytes(min(left, 1 << 20)))
    try:
        yield
    finally:
        filler.unlink()


def full_disk(at: Chaos) -> None:
    assert at.disk is not None
    with filled(at.disk, at.rng.choice((0, 4096, 100_000, 1_000_000))), at.asking():
        time.sleep(at.rng.uniform(0.5, 2))


def killed_on_a_full_disk(at: Chaos) -> None:
    assert at.disk is not None
    with filled(at.disk):
        time.sleep(at.rng.uniform(0, 1))
        at.server.kill()
        # It starts, or says in a sentence what it lacks.
        at.server.launch()
        time.sleep(at.rng.uniform(0.5, 3))
    assert at.server.process is not None
    at.server.kill()
    at.server.start(wait_until="/healthz")


def full_shared_memory(at: Chaos) -> None:
    with filled(at.shared_memory), at.asking():
        time.sleep(at.rng.uniform(0.5, 2))


def renderer_begins_on_full_shared_memory(at: Chaos) -> None:
    known = len(at.server.render_pids())
    with filled(at.shared_memory), at.asking():
        _kill(at.renders()[-1:])
        wait_for(lambda: len(at.server.render_pids()) > known, 60, "a new render process")
        time.sleep(at.rng.uniform(0, 3))


def service_begins_on_full_shared_memory(at: Chaos) -> None:
    at.server.kill()
    at.server.environment["CHAOS_SHM_FILLER"] = "1"
    try:
        at.server.start(wait_until="/healthz")
        with at.asking():
            time.sleep(at.rng.uniform(1, 3))
        (at.shared_memory / "filler").unlink()
    finally:
        del at.server.environment["CHAOS_SHM_FILLER"]


def cleaned_shared_memory(at: Chaos) -> None:
    """As cleaners of temporary files do."""
    with at.asking():
        for path in at.shared_memory.rglob("*"):
            with contextlib.suppress(OSError):
                path.unlink()
        time.sleep(0.3)


def full_temporary_folder(at: Chaos) -> None:
    """In the middle of the body of an upload, which is kept there."""
    assert at.temporary is not None
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr("scene.xml", PLAIN_SCENE)
        archive.writestr("ballast.bin", at.rng.randbytes(6 << 20))
    answers: list[int] = []

    def send() -> None:
        with contextlib.suppress(httpx.TransportError):
            files = {"file": ("a.zip", packed.getvalue())}
            answers.append(httpx.post(f"{at.server.url}/api/scenes", files=files, timeout=60).status_code)

    with filled(at.temporary, at.rng.choice((0, 1 << 20, 3 << 20))), at.asking():
        send()
    if not set(answers) <= {201, 200, *_TOLD_LATER}:
        at.wrong.append(f"an upload without room for temporary files: {answers}")


def held_sqlite(at: Chaos) -> None:
    path = at.server.data_dir / "fredholm.sqlite"
    with contextlib.closing(sqlite3.connect(path, isolation_level=None, timeout=10)) as other:
        with contextlib.suppress(sqlite3.OperationalError):
            other.execute("BEGIN IMMEDIATE")
        with at.asking():
            time.sleep(at.rng.uniform(0.5, 4))
        other.rollback()


def deleted_database(at: Chaos) -> None:
    """Its operator puts back what the service could save."""
    path = at.server.data_dir / "fredholm.sqlite"
    rescued = path.with_name(f"{path.name}.rescued")
    for one in at.server.data_dir.glob("fredholm.sqlite*"):
        one.unlink()
    with at.asking():
        wait_for(rescued.exists, 30, "a copy of the deleted database", at.events)
        time.sleep(at.rng.uniform(0, 1))
    at.server.stop()
    rescued.rename(path)
    at.server.start(wait_until="/healthz")


def foreign_database(at: Chaos) -> None:
    """Started once with the address of another one, which is refused."""
    own = at.server.environment.get("FREDHOLM_DATABASE_URL")
    at.server.kill()
    at.server.environment["FREDHOLM_DATABASE_URL"] = f"sqlite:///{at.folder / f'other-{uuid4().hex}.sqlite'}"
    try:
        if at.server.launch().wait(60) == 0:
            at.wrong.append("a service started with another database")
    finally:
        del at.server.environment["FREDHOLM_DATABASE_URL"]
        if own is not None:
            at.server.environment["FREDHOLM_DATABASE_URL"] = own
    at.server.start(wait_until="/healthz")


def stopped_postgres(at: Chaos) -> None:
    assert at.postgres is not None
    at.postgres.halt()
    with at.asking():
        time.sleep(at.rng.uniform(0.2, 2))
    at.postgres.resume()


def frozen_postgres(at: Chaos) -> None:
    assert at.postgres is not None
    with at.postgres.frozen(), at.asking():
        time.sleep(at.rng.uniform(0.5, 4))


def goes_on(at: Chaos, job_id: str) -> bool:
    """Whether a job has not ended, told by the database of a service that does not run."""
    default = f"sqlite:///{at.server.data_dir / 'fredholm.sqlite'}"
    database = Database(at.server.environment.get("FREDHOLM_DATABASE_URL", default))
    try:
        return JobStore(database).get(job_id).state.value not in ENDED
    finally:
        database.close()


def flipped_bytes(at: Chaos) -> None:
    """In the newest estimate of a job that goes on: the one before it stands in."""

    def saved() -> list[Path]:
        found = [sorted((at.server.data_dir / "estimates" / job["id"]).glob("[0-9]*.exr")) for job in at.unended()]
        return max(found, key=len, default=[])

    with contextlib.suppress(OSError):
        ends = time.monotonic() + 5
        while len(saved()) < 2 and time.monotonic() < ends:
            time.sleep(0.05)
        found = saved()
        at.server.kill()
        # A short job may have ended in that moment: nothing stands in for what is saved of it.
        for path in found[-1:] if found and goes_on(at, found[-1].parent.name) else []:
            content = bytearray(path.read_bytes())
            for _ in range(2000):
                content[at.rng.randrange(len(content))] ^= at.rng.randrange(1, 256)
            path.write_bytes(content)
    if at.server.process is not None and at.server.process.poll() is None:
        at.server.kill()
    at.server.start(wait_until="/healthz")


def slow_clients(at: Chaos) -> None:
    """Heads and bodies that trickle, and readers that take nothing."""
    body = b"Content-Type: multipart/form-data; boundary=x\r\nContent-Length: 9000000\r\n\r\n--x"
    heads = (
        b"GET /api/jobs HTTP/1.1\r\nHost: localhost\r\nX-",
        b"POST /api/scenes HTTP/1.1\r\nHost: localhost\r\n" + body,
        b"GET /api/events HTTP/1.1\r\nHost: localhost\r\n\r\n",
        *[b"GET /api/jobs/%s/frames/latest HTTP/1.1\r\nHost: localhost\r\n\r\n" % job.encode() for job in at.jobs][-2:],
    )
    with contextlib.ExitStack() as ends, at.asking():
        for i in range(60):
            with contextlib.suppress(OSError):
                connection = socket.create_connection(("127.0.0.1", at.server.port), timeout=5)
                ends.callback(connection.close)
                connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
                connection.sendall(heads[i % len(heads)])
        time.sleep(at.rng.uniform(0.5, 2))


def torn_requests(at: Chaos) -> None:
    """Clients that are gone in the middle of what they say."""
    whole = httpx.Request("POST", f"{at.server.url}/api/scenes", files={"file": ("a.xml", PLAIN_SCENE)})
    content = whole.read()
    head = "POST /api/scenes HTTP/1.1\r\n" + "".join(f"{name}: {value}\r\n" for name, value in whole.headers.items())
    with at.asking():
        for _ in range(10):
            with contextlib.suppress(OSError):
                with socket.create_connection(("127.0.0.1", at.server.port), timeout=5) as connection:
                    sent = head.encode() + b"\r\n" + content
                    connection.sendall(sent[: at.rng.randrange(len(sent))])
                    # Cut, not closed: the other side meets a reset.
                    connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))


def jumped_clock(at: Chaos) -> None:
    assert at.clock is not None
    with at.asking():
        at.clock.write_bytes(struct.pack("q", at.rng.choice((-86400, -3600, -30, 30, 3600, 86400))))
        time.sleep(at.rng.uniform(0.5, 2))
        if at.rng.random() < 0.5:
            at.clock.write_bytes(struct.pack("q", 0))
            time.sleep(0.5)


# By kind: what is done, and what it needs.
FAULTS: dict[str, tuple[Callable[[Chaos], None], str | None]] = {
    "kill -9 of the service": (kill_service, None),
    "kill -9 of the renderer": (kill_renderer, None),
    "kill -9 of both": (kill_both, None),
    "kill -9 of inspectors": (kill_inspectors, None),
    "SIGTERM in flight": (terminate_in_flight, None),
    "full disk": (full_disk, "disk"),
    "kill -9 and start on a full disk": (killed_on_a_full_disk, "disk"),
    "full /dev/shm": (full_shared_memory, "memory"),
    "full /dev/shm as the renderer begins": (renderer_begins_on_full_shared_memory, "memory"),
    "full /dev/shm as the service begins": (service_begins_on_full_shared_memory, "memory"),
    "emptied /dev/shm": (cleaned_shared_memory, "memory"),
    "full temporary folder in an upload": (full_temporary_folder, "disk"),
    "held SQLite lock": (held_sqlite, "sqlite"),
    "deleted database": (deleted_database, "sqlite"),
    "foreign database": (foreign_database, None),
    "PostgreSQL stopped and started": (stopped_postgres, "postgres"),
    "PostgreSQL under SIGSTOP": (frozen_postgres, "postgres"),
    "flipped bytes in an estimate": (flipped_bytes, None),
    "slow clients": (slow_clients, None),
    "torn requests": (torn_requests, None),
    "clock jumps": (jumped_clock, "clock"),
}


# ------------------------------ The place ------------------------------


def build_clock(folder: Path) -> Path | None:
    """A library that shifts the clock of who loads it; None without a C compiler."""
    (folder / "clock.c").write_text(_CLOCK)
    library = folder / "clock.so"
    with contextlib.suppress(OSError):
        command = ["cc", "-shared", "-fPIC", "-O1", "-o", str(library), str(folder / "clock.c"), "-ldl"]
        if subprocess.run(command, capture_output=True, timeout=60).returncode == 0:
            return library
    return None


def mount(folder: Path, megabytes: int) -> bool:
    """A small file system; whether there is one."""
    folder.mkdir()
    if sys.platform != "linux" or os.geteuid() != 0:
        return False
    command = ["mount", "-t", "tmpfs", "-o", f"size={megabytes}m", "tmpfs", str(folder)]
    return subprocess.run(command, capture_output=True).returncode == 0


# Its own /dev/shm, full from the start if that is asked for.
OWN_SHARED_MEMORY = (
    "mount --make-rprivate / && mount -t tmpfs -o size=24m tmpfs /dev/shm || exit 9; "
    '[ -z "$CHAOS_SHM_FILLER" ] || dd if=/dev/zero of=/dev/shm/filler bs=64k 2>/dev/null; exec "$@"'
)


@contextlib.contextmanager
def place(folder: Path, rng: random.Random, database_url: str | None, postgres: Postgres | None) -> Iterator[Chaos]:
    """A service where all can happen that this system allows. Everything is undone at the end."""
    environment = {
        "FREDHOLM_CRASH_LIMIT": "1000",
        "FREDHOLM_CHECKPOINT_SECONDS": "0.2",
        "FREDHOLM_HEARTBEAT_SECONDS": "1",
        "FREDHOLM_WARM_UP": "0",
        "FREDHOLM_DISK_RESERVE_BYTES": "1000000",
        "FREDHOLM_BODY_SILENCE_SECONDS": "5",
    } | ({"FREDHOLM_DATABASE_URL": database_url} if database_url else {})
    with contextlib.ExitStack() as ends:
        disk, temporary, clock = folder / "disk", folder / "temporary", folder / "clock"
        small = [mount(disk, 800), mount(temporary, 8)]
        for there, one in zip(small, (disk, temporary), strict=True):
            if there:
                ends.callback(subprocess.run, ["umount", "-l", str(one)])
        clock.write_bytes(bytes(8))
        library = build_clock(folder)
        if library is not None:
            environment |= {"LD_PRELOAD": str(library), "CHAOS_CLOCK": str(clock)}
        server = Server((disk if all(small) else folder) / "data", environment | {"TMPDIR": str(temporary)})
        server.log_file = folder / "service.log"
        if all(small):
            server.wrapper = ["unshare", "-m", "sh", "-c", OWN_SHARED_MEMORY, "sh"]
        chaos = Chaos(
            server, rng, folder, disk if all(small) else None, temporary, postgres, clock if library else None
        )
        ends.callback(lambda: server.kill() if server.process is not None and server.process.poll() is None else None)
        server.start(wait_until="/healthz")
        chaos.begin()
        yield chaos
