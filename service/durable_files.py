"""What is said to be kept is on disk: files and their names synced, in that order, before anyone is told."""

from __future__ import annotations

import hashlib
import os
import shutil
from pathlib import Path


def sync_path(path: Path) -> None:
    """Have a file, or the names in a folder, on disk. Windows syncs no folders."""
    is_folder = path.is_dir()
    if is_folder and os.name == "nt":
        return
    descriptor = os.open(path, os.O_RDONLY if is_folder or os.name != "nt" else os.O_RDWR)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def sync_tree(folder: Path) -> None:
    """Have all files below a folder on disk, then their names."""
    for path, _, names in os.walk(folder, topdown=False):
        for name in names:
            sync_path(Path(path, name))
        sync_path(Path(path))


def digest_of(path: Path) -> str:
    """sha256 of a file's content. Raises OSError."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def move_into_place(source: Path, target: Path) -> None:
    """Rename what is written, as a whole and for good: its content first, then its new name."""
    sync_tree(source) if source.is_dir() else sync_path(source)
    if target.is_dir():
        shutil.rmtree(target)
    os.replace(source, target)
    sync_path(target.parent)
