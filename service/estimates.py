"""The files of jobs: saved estimates in the data folder, displays of running jobs in shared memory."""

from __future__ import annotations

import hashlib
import secrets
import shutil
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path

from service.display import Display, display_of, read_display
from service.store import JobRecord, Progress

_SHARED_MEMORY = Path("/dev/shm")
_ENOUGH_SHARED_BYTES = 1 << 30  # containers often have 64 MiB: a few pictures fill that
_CACHED_DISPLAYS = 4
# The newest, which may not be recorded yet, the recorded one, and the one before it for those who are just reading it.
_KEPT_ESTIMATES = 3


class EstimateFiles:
    """Knows where a job's files are, and reads and removes them."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        # Named after the data folder, so that a server finds and removes what a killed predecessor left, and
        # after this server, so that the predecessor's orphaned render process removes only its own.
        self._prefix = f"fredholm-{hashlib.sha256(str(folder.resolve()).encode()).hexdigest()[:12]}-"
        self.displays = _fast_folder(folder.parent) / f"{self._prefix}{secrets.token_hex(4)}"
        # The probe on the page asks for pixel after pixel of the same finished picture.
        self._saved = lru_cache(maxsize=_CACHED_DISPLAYS)(self._read)

    def prepare(self) -> None:
        """Make the folders and remove displays of an earlier server."""
        self.folder.mkdir(parents=True, exist_ok=True)
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

    def saved(self, checkpoint: str | None, progress: Progress) -> Display | None:
        """What a job shows by its saved estimate; None without its file."""
        # A newer one may have taken its place meanwhile.
        if checkpoint is None or not self.path(checkpoint).is_file():
            return None
        return self._saved(checkpoint, progress.frame_seq, progress.seconds)

    def _read(self, checkpoint: str, seq: int, seconds: float) -> Display:
        from renderer import Estimate

        return display_of(Estimate.read(self.path(checkpoint)), seq=seq, seconds=seconds)

    def prune(self, job_id: str) -> None:
        """Remove all but the newest saved estimates of a job."""
        for path in sorted((self.folder / job_id).glob("[0-9]*.exr"))[:-_KEPT_ESTIMATES]:
            path.unlink(missing_ok=True)

    def keep_only(self, job_id: str, checkpoint: str | None) -> None:
        """Remove all saved estimates of a job that has ended but one, and what a killed process left half written."""
        for path in (self.folder / job_id).glob("*"):
            if f"{job_id}/{path.name}" != checkpoint:
                path.unlink(missing_ok=True)

    def remove(self, job_id: str) -> None:
        """Remove all saved estimates of a job."""
        shutil.rmtree(self.folder / job_id, ignore_errors=True)

    def sweep(self, checkpoints: Mapping[str, str | None]) -> None:
        """Remove files that no job names: a crash between writing and recording leaves them."""
        for path in self.folder.glob("*/*"):
            if path.is_file() and checkpoints.get(path.parent.name) != f"{path.parent.name}/{path.name}":
                path.unlink(missing_ok=True)
        for folder in self.folder.iterdir():
            if folder.is_dir() and folder.name not in checkpoints:
                shutil.rmtree(folder, ignore_errors=True)

    def remove_displays(self) -> None:
        """Free the shared memory."""
        shutil.rmtree(self.displays, ignore_errors=True)


def _fast_folder(otherwise: Path) -> Path:
    """Shared memory where there is enough of it."""
    if _SHARED_MEMORY.is_dir() and shutil.disk_usage(_SHARED_MEMORY).free >= _ENOUGH_SHARED_BYTES:
        return _SHARED_MEMORY
    return otherwise
