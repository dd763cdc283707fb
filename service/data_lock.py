"""One service per data folder: two would each take up the other's running jobs."""

from __future__ import annotations

import os
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows: no lock there
    fcntl = None


class DataFolderInUse(Exception):
    """Another service uses this data folder."""


class DataLock:
    """A lock on a folder that ends with the process that holds it, however that ends.

    On the folder itself: a file in it may be deleted, and the next one would be another file. Where a file system
    locks no folders, and for services of older versions, a file in it is locked too.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._held: list[int] = []

    def take(self) -> None:
        """Raises DataFolderInUse."""
        if fcntl is None:
            return
        self._held = [os.open(self._folder, os.O_RDONLY), os.open(self._folder / "lock", os.O_RDWR | os.O_CREAT, 0o600)]
        for descriptor in self._held:
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                self.release()
                raise DataFolderInUse(
                    f"another Fredholm service uses {self._folder}; stop it, or choose another folder with --data"
                ) from None
            except OSError:
                if descriptor is not self._held[0]:
                    raise

    def release(self) -> None:
        """Let others have the folder."""
        for descriptor in self._held:
            os.close(descriptor)
        self._held = []
