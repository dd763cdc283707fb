"""Scenes on their way to workers: packed by the service, kept by workers, by the id that is a digest of their content.

A folder is packed as tar, which is read again with Python's filter for data: no links out, absolute paths or devices.
"""

from __future__ import annotations

import os
import re
import shutil
import tarfile
import tempfile
from pathlib import Path
from typing import IO

from renderer.scene.bundle import digest_of  # the id of an uploaded scene begins with it

PART_BYTES = 8 << 20
DEFAULT_CACHE_BYTES = 20 << 30
_ID = re.compile(r"[0-9a-f]{16,64}")


class SceneRefused(ValueError):
    """A scene that is not what its id says, or has no such id."""


def id_of(scene: str) -> str:
    """The id in `id/folder/file`. Raises SceneRefused for what is none, or leaves its folder."""
    parts = Path(scene).parts
    if len(parts) < 3 or not _ID.fullmatch(parts[0]) or ".." in parts:
        raise SceneRefused(f"{scene!r} is no uploaded scene")
    return parts[0]


def packed(scenes_dir: Path, scene: str) -> IO[bytes]:
    """The files of an uploaded scene `id/folder/file`, as tar; to be closed. Raises SceneRefused."""
    id_of(scene)
    folder = scenes_dir.joinpath(*Path(scene).parts[:2])
    if not folder.is_dir():
        raise SceneRefused(f"the files of the scene {scene!r} are not there")
    file = tempfile.TemporaryFile()  # noqa: SIM115 (the caller closes it)
    with tarfile.open(fileobj=file, mode="w") as tar:
        tar.add(folder, folder.name)
    file.seek(0)
    return file


class SceneCache:
    """The scenes that a worker keeps, up to so many bytes; those that were not used for longest go first."""

    def __init__(self, folder: Path, most_bytes: int = DEFAULT_CACHE_BYTES) -> None:
        self._scenes, self._incoming, self._most = folder / "scenes", folder / "incoming", most_bytes
        shutil.rmtree(self._incoming, ignore_errors=True)
        for one in (self._scenes, self._incoming):
            one.mkdir(mode=0o700, parents=True, exist_ok=True)

    def path(self, scene: str) -> Path | None:
        """Where a scene's file lies; None while it is not here."""
        path = self._scenes / id_of(scene) / Path(*Path(scene).parts[1:])
        if not path.is_file():
            return None
        os.utime(self._scenes / id_of(scene))
        return path

    def take(self, scene: str, at: int, part: bytes, is_last: bool) -> None:
        """A part of a packed scene that begins at byte `at`; with the last one it is unpacked and kept.

        Raises SceneRefused where its content is not what its id says.
        """
        tar = self._incoming / f"{id_of(scene)}.tar"
        with tar.open("r+b" if at else "wb") as file:
            file.seek(at)
            file.truncate()
            file.write(part)
        if is_last:
            self._unpack(scene, tar)

    def _unpack(self, scene: str, tar: Path) -> None:
        scene_id, inner = id_of(scene), Path(scene).parts[1]
        folder = Path(tempfile.mkdtemp(dir=self._incoming))
        try:
            with tarfile.open(tar) as packed:
                packed.extractall(folder, filter="data")
            if not (folder / inner).is_dir() or digest_of(folder / inner)[: len(scene_id)] != scene_id:
                raise SceneRefused(f"what came as the scene {scene_id} is something else")
            shutil.rmtree(self._scenes / scene_id, ignore_errors=True)
            folder.rename(self._scenes / scene_id)
        finally:
            tar.unlink(missing_ok=True)
            shutil.rmtree(folder, ignore_errors=True)
        self._shrink(scene_id)

    def _shrink(self, kept: str) -> None:
        sizes = {one: _size_of(one) for one in self._scenes.iterdir() if one.name != kept}
        taken = sum(sizes.values()) + _size_of(self._scenes / kept)
        for folder in sorted(sizes, key=lambda one: one.stat().st_mtime):
            if taken <= self._most:
                return
            shutil.rmtree(folder, ignore_errors=True)
            taken -= sizes[folder]


def _size_of(folder: Path) -> int:
    return sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())
