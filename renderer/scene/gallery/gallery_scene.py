"""The record of one built-in scene: what it is called, what it teaches, how big it is and how to make it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

_THUMBNAILS = Path(__file__).parent / "thumbnails"


@dataclass(frozen=True, slots=True)
class GalleryScene:
    """One built-in scene.

    name: stable identifier in lower case with hyphens ("cornell-box"), used in URLs and commands.
    title: for people. teaches: one sentence on what a user sees in its error map.
    width, height: natural film size in pixels. build: makes a fresh Mitsuba dictionary, and
    starts the backend if nothing has yet. has_media: whether it has participating media, of which lessons know nothing.
    """

    name: str
    title: str
    teaches: str
    width: int
    height: int
    build: Callable[[], dict[str, Any]]
    has_media: bool = False

    @property
    def thumbnail(self) -> Path:
        """PNG, 256 pixels wide, shipped in the package; `make_thumbnails` writes it."""
        return _THUMBNAILS / f"{self.name}.png"
