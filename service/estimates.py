"""The files of jobs: saved estimates in the data folder, displays of running jobs in shared memory."""

from __future__ import annotations

import contextlib
import hashlib
import os
import secrets
import shutil
import threading
from collections import OrderedDict
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path

from service.accountant import Ledger, Quota
from service.damage import EstimateDamaged
from service.display import Display, display_bytes, display_of, read_display, write_display
from service.durable_files import digest_of
from service.quarantine import Quarantine
from service.room import job_bytes
from service.settings import ServiceSettings
from service.store import JobRecord, Kept

_SHARED_MEMORY = Path("/dev/shm")
_ENOUGH_SHARED_BYTES = 1 << 30  # containers often have 64 MiB: a few pictures fill that
# Of saved pictures that were just asked for: in files without a name, which the system may take from memory and which
# are gone with this process, however it ends.
_SHOWN_BYTES, _LEFT_ON_DISK_BYTES = 384 << 20, 2 << 30
_REMEMBERED = 10_000
# The newest, which may not be recorded yet, the recorded one, and the one before it for those who are just reading it.
_KEPT_ESTIMATES = 3


class EstimateFiles:
    """Knows where a job's files are, and reads and removes them."""

    def __init__(self, folder: Path, quarantine: Quarantine) -> None:
        self.folder = folder
        self.ledger = Ledger()
        self.sending = folder.parent / "sending"
        self._sound: dict[str, tuple[str | None, int, int, int]] = {}  # files as they were when last read
        self._quarantine = quarantine
        # Named after the data folder, so that a server finds and removes what a killed predecessor left, and
        # after this server, so that the predecessor's orphaned render process removes only its own.
        self._prefix = f"fredholm-{hashlib.sha256(str(folder.resolve()).encode()).hexdigest()[:12]}-"
        self.displays = _fast_folder(folder.parent) / f"{self._prefix}{secrets.token_hex(4)}"
        # The probe on the page asks for pixel after pixel of the same finished picture.
        self._shown: OrderedDict[tuple[str, int], Display] = OrderedDict()
        self._lock = threading.Lock()

    def prepare(self) -> None:
        """Make the folders and remove displays of an earlier server."""
        self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        shutil.rmtree(self.sending, ignore_errors=True)
        self.sending.mkdir(mode=0o700)
        for left in self.displays.parent.glob(f"{self._prefix}*"):
            shutil.rmtree(left, ignore_errors=True)
        self.displays.mkdir(mode=0o700)

    def path(self, checkpoint: str) -> Path:
        """A saved estimate."""
        return self.folder / checkpoint

    def display_path(self, job: JobRecord) -> Path:
        """Where the render process puts what a job shows.

        Each attempt has its own: an orphan may still write.
        """
        return self.displays / f"{job.id}-{job.attempt}.display"

    def shown(self, path: Path) -> Display | None:
        """What a running job shows, from shared memory; None before its first picture and after its end."""
        try:
            return read_display(path)
        except FileNotFoundError:
            return None

    def saved(self, kept: Kept) -> Display:
        """What a job shows by a saved estimate. Raises EstimateDamaged."""
        self.check(kept)
        key = (kept.name, kept.progress.frame_seq)
        with self._lock:
            if (known := self._shown.get(key)) is not None:
                self._shown.move_to_end(key)
                return known
        display = self._read(kept.name, kept.progress.frame_seq, kept.progress.seconds)
        mapped = self._mapped(display)
        with self._lock:
            self._shown[key] = mapped or display
            limit = 0 if mapped is None else _SHOWN_BYTES
            while len(self._shown) > 1 and sum(map(display_bytes, self._shown.values())) > limit:
                self._shown.popitem(last=False)
        return mapped or display

    def _mapped(self, display: Display) -> Display | None:
        """The same in a file without a name; None where the disk has no room to spare."""
        path = self.sending / f"{secrets.token_hex(8)}.display"
        try:
            if shutil.disk_usage(self.sending).free < _LEFT_ON_DISK_BYTES + display_bytes(display):
                return None
            write_display(display, path)
            return read_display(path)
        except OSError:
            return None
        finally:
            path.unlink(missing_ok=True)

    def check(self, kept: Kept) -> None:
        """Whether a file is what was saved, read again only if it has changed. Raises EstimateDamaged."""
        path = self.path(kept.name)
        try:
            found = path.stat()
            looks = (kept.digest, found.st_size, found.st_mtime_ns, found.st_ino)
            if self._sound.get(kept.name) == looks:
                return
            if kept.digest is not None and digest_of(path) != kept.digest:
                raise EstimateDamaged("its checksum differs")
            if kept.digest is None:  # saved by an older version: what it says of itself is all there is
                self._read(kept.name, kept.progress.frame_seq, kept.progress.seconds)
        except FileNotFoundError:
            raise EstimateDamaged("its file is missing") from None
        except OSError as error:
            raise EstimateDamaged(f"it cannot be read: {error.strerror}") from None
        while len(self._sound) >= _REMEMBERED:
            self._sound.pop(next(iter(self._sound)))
        self._sound[kept.name] = looks

    def _read(self, checkpoint: str, seq: int, seconds: float) -> Display:
        from renderer import Estimate

        try:
            return display_of(Estimate.read(self.path(checkpoint)), seq=seq, seconds=seconds)
        except MemoryError:
            raise
        except Exception as error:  # whatever bytes without a checksum lead to
            raise EstimateDamaged(f"it cannot be read ({type(error).__name__})") from error

    def hold(self, kept: Kept) -> Path:
        """A name of a sound estimate's file for one who sends it, which outlives the job's own. Raises EstimateDamaged.

        It is the caller's to remove.
        """
        self.check(kept)
        held = self.sending / f"{secrets.token_hex(8)}.exr"
        try:
            os.link(self.path(kept.name), held)
        except FileNotFoundError:
            raise EstimateDamaged("its file is missing") from None
        return held

    def put_away(self, name: str, why: str) -> None:
        """Take a damaged estimate from its job."""
        if self.path(name).exists():
            self._quarantine.take(self.path(name), why)

    def prune(self, job_id: str) -> None:
        """Remove all but the newest saved estimates of a job."""
        for path in sorted((self.folder / job_id).glob("[0-9]*.exr"))[:-_KEPT_ESTIMATES]:
            path.unlink(missing_ok=True)

    def keep_only(self, job_id: str, names: Collection[str]) -> None:
        """Remove all other saved estimates of a job that has left the renderer, and what was left half written."""
        for path in (self.folder / job_id).glob("*"):
            if f"{job_id}/{path.name}" not in names:
                path.unlink(missing_ok=True)
        self.ledger.resize(job_id, self._size(job_id))

    def reckon(self, clients: Mapping[str, str], unfinished: Iterable[JobRecord], settings: ServiceSettings) -> None:
        """Take stock of what there is, and let the quota follow from the disk. clients: of all jobs, by job."""
        for folder in self.folder.iterdir():
            self.ledger.note(folder.name, clients.get(folder.name, ""), self._size(folder.name))
        taken = self.ledger.taken()
        for job in unfinished:
            self.ledger.note(job.id, job.client_id, max(job_bytes(job.settings), self._size(job.id)))
        self.ledger.quota = Quota.of(settings, shutil.disk_usage(self.folder).free, taken)

    def _size(self, job_id: str) -> int:
        """Bytes of a job's files."""
        found = 0
        for path in (self.folder / job_id).glob("*"):
            with contextlib.suppress(OSError):
                found += path.stat().st_size
        return found

    def remove(self, job_id: str) -> None:
        """Remove all saved estimates of a job."""
        shutil.rmtree(self.folder / job_id, ignore_errors=True)
        self.ledger.forget(job_id)

    def sweep(self, checkpoints: Mapping[str, Collection[str] | None]) -> None:
        """Put away files that no job names: a crash between writing and recording leaves them.

        checkpoints: the saved estimates of each job, None for one whose files are to be left alone. What was begun and
        never finished, and what a recorded estimate has superseded, is removed.
        """
        for folder in [one for one in self.folder.iterdir() if one.is_dir()]:
            if folder.name not in checkpoints:
                self._quarantine.take(folder, "no job has this id")
                continue
            named = checkpoints[folder.name]
            if named is None:
                continue
            newest = max(named, default="")
            for path in folder.iterdir():
                name = f"{folder.name}/{path.name}"
                if name in named:
                    continue
                if path.name.startswith(".") or name < newest:
                    path.unlink(missing_ok=True)
                else:
                    self._quarantine.take(path, "newer than what is recorded of its job")

    def remove_displays(self) -> None:
        """Free the shared memory."""
        shutil.rmtree(self.displays, ignore_errors=True)


def _fast_folder(otherwise: Path) -> Path:
    """Shared memory where there is enough of it."""
    if _SHARED_MEMORY.is_dir() and shutil.disk_usage(_SHARED_MEMORY).free >= _ENOUGH_SHARED_BYTES:
        return _SHARED_MEMORY
    return otherwise
