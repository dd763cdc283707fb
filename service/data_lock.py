"""One service per data folder: two would each take up the other's running jobs."""

from __future__ import annotations

from pathlib import Path
from typing import IO

try:
    import fcntl
except ImportError:  # Windows: no lock there
    fcntl = None


class DataFolderInUse(Exception):
    """Another service uses this data folder."""


class DataLock:
    """A lock on a folder that ends with the process that holds it, however that ends."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._file: IO[str] | None = None

    def take(self) -> None:
        """Raises DataFolderInUse."""
        file = (self._folder / "lock").open("w")
        if fcntl is not None:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                file.close()
                raise DataFolderInUse(
                    f"another Fredholm service uses {self._folder}; stop it, or choose another folder with --data"
                ) from None
        self._file = file

    def release(self) -> None:
        """Let others have the folder."""
        if self._file is not None:
            self._file.close()
            self._file = None
