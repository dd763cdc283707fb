"""Whether a file that a scene names lies where the scene's files may lie, and which file is meant by its name."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable
from pathlib import Path

from renderer.errors import SceneError

_LONGEST_NAME = 255  # bytes, on the usual file systems


def check_reference(named: str, root: Path, bases: Iterable[Path], where: str) -> None:
    """Refuses a name that leads out of `root`. bases: the folders that relative names may start from."""
    if is_outside(named, root, bases):
        raise SceneError(f"{where}: {named[:200]!r} is outside the upload; put the file beside the scene")


def is_outside(named: str, root: Path, bases: Iterable[Path]) -> bool:
    """Whether a name leads out of `root` from any of the folders that relative names may start from, on any system.

    Links are followed. A name that was made absolute may be inside.
    """
    if re.match(r"^([A-Za-z]:|\\\\|~)", named) or any(unicodedata.category(c)[0] == "C" for c in named):
        return True
    plain = named.replace("\\", "/")
    if any(len(part.encode(errors="replace")) > _LONGEST_NAME for part in plain.split("/")) or len(plain) > 1000:
        return True
    inside = root.resolve()
    try:
        return not all((start / plain).resolve().is_relative_to(inside) for start in bases)
    except (OSError, ValueError):
        return True  # too long, or a loop of links


def leads_out(text: str) -> bool:
    """Whether a text, whatever it is for, could be a path that leaves its folder: no such text has another use."""
    plain = text.replace("\\", "/")
    return plain.startswith(("/", "~")) or ".." in plain.split("/") or bool(re.match(r"^[A-Za-z]:/", plain))


def meant(named: str, folders: Iterable[Path]) -> str | None:
    r"""The name of the file that `named` means where no file has that very name, relative to one of the folders.

    Scenes that were made on other systems have textures\x.png, or Textures/X.PNG for textures/x.png. None where no
    file, or more than one, could be meant.
    """
    parts = [part for part in named.replace("\\", "/").split("/") if part not in ("", ".")]
    if not parts or named.startswith(("/", "\\")) or re.match(r"^[A-Za-z]:", named):
        return None
    for folder in folders:
        at = [Path()]
        for part in parts:
            at = [one / name for one in at for name in _alike(folder / one, part)]
        found = [one for one in at if (folder / one).is_file()]
        if len(found) == 1:
            return found[0].as_posix()
    return None


def _alike(folder: Path, name: str) -> list[str]:
    """Entries of a folder whose name differs in case alone; the one with this very name, if there is one."""
    if name == "..":
        return [name]
    try:
        names = [entry.name for entry in folder.iterdir()] if folder.is_dir() else []
    except OSError:
        return []
    return [name] if name in names else [one for one in names if one.casefold() == name.casefold()]
