"""Whether a file that a scene names lies in the scene's own folder."""

from __future__ import annotations

import re
import unicodedata
from pathlib import Path

from renderer.errors import SceneError

_LONGEST_NAME = 255  # bytes, on the usual file systems


def check_reference(named: str, folder: Path, base: Path, where: str) -> None:
    """Refuses a name that leads out of `folder`. base: the folder that relative names start from."""
    if is_outside(named, folder, base):
        raise SceneError(f"{where}: {named[:200]!r} is outside the upload; put the file beside the scene")


def is_outside(named: str, folder: Path, base: Path) -> bool:
    """Whether a name leads out of the folder, on any system; links are followed. One made absolute may be inside."""
    if re.match(r"^([A-Za-z]:|\\\\|~)", named) or any(unicodedata.category(c)[0] == "C" for c in named):
        return True
    plain = named.replace("\\", "/")
    if any(len(part.encode(errors="replace")) > _LONGEST_NAME for part in plain.split("/")) or len(plain) > 1000:
        return True
    root = folder.resolve()
    try:
        return not all((start / plain).resolve().is_relative_to(root) for start in (base, folder))
    except (OSError, ValueError):
        return True  # too long, or a loop of links


def leads_out(text: str) -> bool:
    """Whether a text, whatever it is for, could be a path that leaves its folder: no such text has another use."""
    plain = text.replace("\\", "/")
    return plain.startswith(("/", "~")) or ".." in plain.split("/") or bool(re.match(r"^[A-Za-z]:/", plain))
