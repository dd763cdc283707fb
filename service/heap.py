"""The C library's heap: what is freed goes back to the system."""

from __future__ import annotations

import contextlib
import ctypes
import sys

_TRIM_THRESHOLD, _MMAP_THRESHOLD, _ARENA_MAX = -1, -3, -8  # glibc's malloc.h


def give_back_large_blocks() -> None:
    """Blocks of a mebibyte and more are mapped, and unmapped when they are freed.

    glibc raises that size with what is freed, to 32 MiB: pictures then lie in heaps of many threads, which keep twice
    what is in use. Elsewhere nothing is done.
    """
    if sys.platform != "linux":
        return
    with contextlib.suppress(OSError, AttributeError):  # another C library
        libc = ctypes.CDLL(None)
        libc.mallopt(_MMAP_THRESHOLD, 1 << 20)
        libc.mallopt(_TRIM_THRESHOLD, 4 << 20)
        libc.mallopt(_ARENA_MAX, 4)
