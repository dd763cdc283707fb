"""Files that nothing names any more, kept for some days before they are removed.

What the database does not know may be what it ought to know: a copy of it from yesterday was put back, say.
"""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
import time
from pathlib import Path

import structlog

_DAY_SECONDS = 86400.0


class Quarantine:
    """A folder beside those that it is fed from, one folder in it for each thing that was put away."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._log = structlog.get_logger("service.quarantine")

    def take(self, path: Path, why: str) -> None:
        """Put a file or folder away, under its own path in a folder named by the moment."""
        name = "-".join((time.strftime("%Y%m%dT%H%M%SZ", time.gmtime()), secrets.token_hex(4)))
        kept = Path(*path.parts[len(self.folder.parent.parts) :])  # estimates/JOB/NAME.exr, scenes/ID
        target = self.folder / name / kept
        try:
            target.parent.mkdir(mode=0o700, parents=True)
            os.replace(path, target)
            # Its days begin now, whenever its files were written.
            os.utime(self.folder / name)
        except OSError as error:
            self._log.error("cannot be put into quarantine, and stays", what=str(kept), cause=error.strerror)
        else:
            self._log.warning("put into quarantine", what=str(kept), why=why, where=str(target))

    def forget_older(self, days: float) -> int:
        """Remove what has been here for longer; how many things."""
        forgotten = 0
        with contextlib.suppress(FileNotFoundError):
            for folder in list(self.folder.iterdir()):
                if folder.stat().st_mtime < time.time() - days * _DAY_SECONDS:
                    shutil.rmtree(folder, ignore_errors=True)
                    forgotten += 1
        return forgotten
