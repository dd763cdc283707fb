"""How much memory this machine has, or the container that it is: what limits follow from."""

from __future__ import annotations

import os
from pathlib import Path

# Where control groups say how much their processes may take together and have taken; version 2, then version 1.
_GROUPS = (
    ("memory.max", "memory.current", "inactive_file"),
    ("memory/memory.limit_in_bytes", "memory/memory.usage_in_bytes", "total_inactive_file"),
)
_UNKNOWN_BYTES = 4 << 30  # where the system does not say
_NO_LIMIT = 1 << 60  # larger ones are how version 1 says that there is none


class Machine:
    """The memory of this machine. groups, meminfo: where Linux tells of it."""

    def __init__(self, groups: Path = Path("/sys/fs/cgroup"), meminfo: Path = Path("/proc/meminfo")) -> None:
        self._groups = groups
        self._meminfo = meminfo

    def memory(self) -> int:
        """Bytes that all processes here may take together."""
        physical = self._told("MemTotal") or _physical()
        limits = [limit for limit, _ in self._limits()]
        return min([physical, *limits])

    def available(self) -> int:
        """Bytes that are free now, or are soon where they are asked for."""
        told = self._told("MemAvailable")
        free = [limit - used for limit, used in self._limits()]
        return max(0, min([_UNKNOWN_BYTES if told is None else told, *free]))

    def _limits(self) -> list[tuple[int, int]]:
        """Of each control group: its limit, and what is taken and cannot be given back at once."""
        found: list[tuple[int, int]] = []
        for limit, used, idle in _GROUPS:
            try:
                most = int((self._groups / limit).read_text())  # "max" is none
                taken = int((self._groups / used).read_text())
                stat = (self._groups / limit).with_name("memory.stat").read_text().split()
                taken -= int(stat[stat.index(idle) + 1]) if idle in stat else 0
            except (OSError, ValueError):
                continue
            if most < _NO_LIMIT:
                found.append((most, taken))
        return found

    def _told(self, name: str) -> int | None:
        try:
            lines = dict(line.split(":", 1) for line in self._meminfo.read_text().splitlines())
            return int(lines[name].split()[0]) * 1024
        except (OSError, ValueError, KeyError, IndexError):
            return None


def _physical() -> int:
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return _UNKNOWN_BYTES
