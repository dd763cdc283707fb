"""A little shared memory, kept for the moment at which there is none: a process cannot start without some."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import IO, TypeVar

from service.room import is_full

T = TypeVar("T")
SHARED_MEMORY = Path("/dev/shm")
# Of the semaphores of some processes; each takes a page.
_BYTES = 256 << 10


class Reserve:
    """Bytes in a file without a name, so that nobody else's files take them. folder: where shared memory is."""

    def __init__(self, folder: Path = SHARED_MEMORY) -> None:
        self._folder = folder
        self._held: IO[bytes] | None = None

    def hold(self) -> None:
        """Take the bytes, if there are any to be had."""
        if self._held is not None or not hasattr(os, "posix_fallocate"):
            return
        with contextlib.suppress(OSError):
            file = tempfile.TemporaryFile(dir=self._folder, buffering=0)  # noqa: SIM115 (held until it is needed)
            try:
                os.posix_fallocate(file.fileno(), 0, _BYTES)
            except OSError:
                file.close()
                raise
            self._held = file

    def release(self) -> bool:
        """Give the bytes back; whether there were any."""
        if self._held is None:
            return False
        self._held.close()
        self._held = None
        return True

    def spending(self, make: Callable[[], T]) -> T:
        """What a call makes that needs shared memory: where that is full, with what was kept for it."""
        self.hold()
        try:
            return make()
        except OSError as error:
            if not is_full(error) or not self.release():
                raise
            return make()
        finally:
            self.hold()


RESERVE = Reserve()  # of this process: all engines start theirs from one thread
