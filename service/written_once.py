"""Small files that are written once, by whoever needs them first, and read by all: a secret, a name."""

from __future__ import annotations

import contextlib
import os
import secrets
from pathlib import Path

from service.durable_files import sync_path


def written_once(path: Path, fresh: str) -> str:
    """The text of a file; `fresh`, if it is not there yet. Readable by its user alone.

    It appears whole or not at all, whenever a process is killed; an empty one is what an earlier version left so.
    """
    with contextlib.suppress(FileNotFoundError):
        if text := path.read_text().strip():
            return text
        path.unlink(missing_ok=True)
    temporary = path.with_name(f".{path.name}-{secrets.token_hex(4)}")
    try:
        descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(descriptor, "w") as file:
            file.write(fresh)
            file.flush()
            os.fsync(file.fileno())
        with contextlib.suppress(FileExistsError):  # another process was first
            os.link(temporary, path)
        sync_path(path.parent)
    finally:
        temporary.unlink(missing_ok=True)
    return path.read_text().strip()
