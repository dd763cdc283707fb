"""Files outside a bundle that nobody may open: the kernel tells if anyone does."""

from __future__ import annotations

import ctypes
import os
import select
import struct
from pathlib import Path

_OPENED, _READ = 0x20, 0x01


class Canary:
    """Watches files (Linux inotify): `touched` names those that were opened or read since the last look."""

    def __init__(self, paths: list[Path]) -> None:
        libc = ctypes.CDLL(None, use_errno=True)
        self._handle = libc.inotify_init()
        self._names = {}
        for path in paths:
            watch = libc.inotify_add_watch(self._handle, os.fsencode(path), _OPENED | _READ)
            if watch < 0:
                raise OSError(ctypes.get_errno(), f"cannot watch {path}")
            self._names[watch] = str(path)

    def touched(self) -> list[str]:
        """Names of the files that were opened or read."""
        found = []
        while select.select([self._handle], [], [], 0)[0]:
            events = os.read(self._handle, 4096)
            at = 0
            while at < len(events):
                watch, _, _, length = struct.unpack_from("iIII", events, at)
                found.append(self._names[watch])
                at += 16 + length
        return found

    def close(self) -> None:
        """Stop watching."""
        os.close(self._handle)
