"""How much disk there is, and what is to be said where it or memory is not enough. Bytes in, sentences out."""

from __future__ import annotations

import errno
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from renderer.settings import STOKES

# Of an estimate, per pixel: exact moments, which are not compressed, and the picture, which may not shrink either.
_PIXEL_BYTES, _CHANNEL_BYTES, _HEAD_BYTES = 160, 12, 1 << 16
STOKES_CHANNELS = 20  # that S0 to S3 count for, with standard errors and moments


def estimate_bytes(width: int, height: int, channels: int = 0) -> int:
    """What a saved estimate takes on disk, at most."""
    return _HEAD_BYTES + width * height * (_PIXEL_BYTES + channels * _CHANNEL_BYTES)


def channels_in(settings: Mapping[str, Any]) -> int:
    """How many channels beside radiance a job has room to find for. settings: resolved ones."""
    return sum(STOKES_CHANNELS if name == STOKES else 1 for name in settings.get("channels", ()))


def job_bytes(settings: Mapping[str, Any]) -> int:
    """What the estimate of a job takes on disk, at most. settings: resolved ones."""
    return estimate_bytes(settings["width"], settings["height"], channels_in(settings))


def is_full(error: BaseException) -> bool:
    """Whether an error of the system, or of a database, says that a disk or a quota is full."""
    if isinstance(error, OSError):
        return error.errno in (errno.ENOSPC, errno.EDQUOT)
    cause = getattr(error, "orig", None)
    return getattr(cause, "sqlstate", "") == "53100" or "disk is full" in str(cause or "")


def say_bytes(n: float) -> str:
    """In the unit that fits: 300 MB."""
    for unit, size in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if n >= size:
            return f"{n / size:.3g} {unit}"
    return f"{n:.0f} bytes"


@dataclass(frozen=True, slots=True)
class Shortage:
    """So many bytes are needed, and so many are free. what: of which kind."""

    needed: int
    free: int
    what: Literal["disk", "memory"] = "disk"

    def __str__(self) -> str:
        return f"{say_bytes(self.needed)} of {self.what} are needed, and {say_bytes(self.free)} are free"

    @property
    def waits_for(self) -> str:
        """What a job says while it waits."""
        return f"waits for {say_bytes(self.needed)} of {self.what}; {say_bytes(self.free)} are free"


class Disk:
    """The disk under a folder. reserve: bytes that stay free, so that the database can go on."""

    def __init__(self, folder: Path, reserve: int) -> None:
        self._folder = folder
        self._reserve = reserve

    def free(self) -> int:
        """Bytes that are free. Raises OSError."""
        return shutil.disk_usage(self._folder).free

    def shortage(self, size: int) -> Shortage | None:
        """What is missing to write `size` bytes; None if nothing is."""
        needed, free = size + self._reserve, self.free()
        return Shortage(needed, free) if free < needed else None
