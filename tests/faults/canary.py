"""Files outside a bundle that nobody may open: the kernel tells if anyone does."""

from __future__ import annotations

import ctypes
import os
import select
import struct
from pathlib import Path

from tests.faults.seeds import PARTS

_OPENED, _READ = 0x20, 0x01
# In every canary, in a way that what is read of it would show.
MARK, NUMBER = "xyzzycontent", "0.7318529"
# Files of every kind that a scene can name; each valid, so that reading it would succeed.
_KINDS: dict[str, bytes] = {
    "canary.obj": f"# {MARK}\nv {NUMBER} 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".encode(),
    "canary.xml": f'<scene version="3.0.0"><shape type="sphere" id="{MARK}"/></scene>'.encode(),
    "canary.spd": f"# {MARK}\n400 {NUMBER}\n700 {NUMBER}\n".encode(),
    "canary.txt": f"{NUMBER} 0 0 .1\n1 0 0 .1\n2 0 0 .1\n3 0 0 .1\n".encode(),
    "canary.ply": PARTS["m.ply"],
    "canary.png": PARTS["t.png"],
    "canary.vol": PARTS["v.vol"],
    "data/ior/canary.eta.spd": f"400 {NUMBER}\n700 {NUMBER}\n".encode(),
    "data/ior/canary.k.spd": f"400 {NUMBER}\n700 {NUMBER}\n".encode(),
}


def place_canaries(folder: Path) -> list[Path]:
    """One file of each kind, below a folder."""
    found = []
    for name, content in _KINDS.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
        found.append(path)
    return found


def names_of(folder: Path, seen_from: Path) -> list[str]:
    """How a scene could ask for the canaries of a folder."""
    ways = []
    for name in _KINDS:
        ways += [name, str(folder / name), os.path.relpath(folder / name, seen_from), f"~/{name}", f"./{name}"]
    return [*ways, "canary", str(folder / "data" / "ior" / "canary"), "canary.eta.spd", "data/ior/canary"]


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
