"""Takes in a stranger's scene: unpack, have it loaded in a process of its own, keep it by its content.

That process is apart from the one that renders: a scene that crashes it costs nobody a sample.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import re
import shutil
import tempfile
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, BinaryIO

import structlog

from renderer.scene.bundle import Bundle, BundleError, Limits, shown_name, unpack
from service.engine import inspection
from service.engine.local import LocalEngine, Lost
from service.engine.turn import SceneFacts
from service.errors import ProblemError
from service.messages import FieldError
from service.settings import MEBIBYTE, ServiceSettings
from service.store import SceneNotFound, SceneRecord, SceneStillNeeded, SceneStore
from service.store.records import iso, now

_REQUIREMENTS = "requirements.json"  # beside the folder of what was uploaded
_IDLE_SECONDS = 60.0
_AT_ONCE = 2
_LOADING_SECONDS = 30.0  # to start a process and import the renderer, on a busy machine


class Uploads:
    """The uploaded scenes and the process that checks them."""

    def __init__(self, settings: ServiceSettings, store: SceneStore) -> None:
        self._settings = settings
        self._store = store
        self._engine = LocalEngine("inspect")
        self._idle: asyncio.TimerHandle | None = None
        self._busy = 0
        self._built_in: dict[str, dict[str, Any]] = {}
        self._keeping = asyncio.Lock()
        self._stored_bytes = 0
        # Unpacked, each may be large, and unpacking keeps a thread busy that others wait for.
        self._at_once = asyncio.Semaphore(_AT_ONCE)
        self._log = structlog.get_logger("service.uploads")

    def prepare(self) -> None:
        """Make the folder of scenes and remove what a killed server left half done. Synchronous."""
        self._settings.scenes_dir.mkdir(parents=True, exist_ok=True)
        known = self._store.ids()
        for folder in self._settings.scenes_dir.iterdir():
            if folder.name not in known:
                shutil.rmtree(folder, ignore_errors=True)
        self._stored_bytes = _size_of(self._settings.scenes_dir)

    async def take(self, source: BinaryIO, file_name: str) -> tuple[SceneRecord, bool]:
        """The stored scene, and whether it is new. Raises ProblemError."""
        async with self._at_once:
            return await self._take(source, file_name)

    async def _take(self, source: BinaryIO, file_name: str) -> tuple[SceneRecord, bool]:
        folder = Path(await asyncio.to_thread(tempfile.mkdtemp, prefix=".upload-", dir=self._settings.scenes_dir))
        try:
            inner = _folder_name(file_name)
            bundle = await asyncio.to_thread(self._unpack, source, file_name, folder / inner)
            scene_id = bundle.digest[:16]
            if known := await self._known(scene_id):
                return known, False
            size = await asyncio.to_thread(_size_of, folder)
            if self._stored_bytes + size > self._settings.max_stored_bytes:
                raise _no_room(size, self._stored_bytes, self._settings.max_stored_bytes)
            path = folder / inner / bundle.scene
            facts = await self._inspect(inspection.inspect_upload, str(path), self._settings.max_scene_bytes)
            if facts.failure is not None:
                # Messages of the renderer name the file; the folder it lies in is nobody's business.
                detail = facts.failure.detail.replace(f"{path.parent}{os.sep}", "")
                detail = detail.replace(f"{folder}{os.sep}", "").replace(folder.name, bundle.name)
                if facts.failure.trace:
                    self._log.error("scene check failed", scene=bundle.name, trace=facts.failure.trace)
                raise scene_refused(facts.failure.title, detail)
            scene = SceneRecord(
                id=scene_id,
                name=bundle.name,
                path=f"{scene_id}/{inner}/{bundle.scene}",
                width=facts.width,
                height=facts.height,
                digest=facts.digest,
                warnings=facts.warnings,
                created_at=now(),
            )
            (folder / _REQUIREMENTS).write_text(json.dumps(facts.requirements | {"name": bundle.name}))
            async with self._keeping:
                if known := await self._known(scene_id):
                    return known, False
                await asyncio.to_thread(_keep, folder, self._settings.scenes_dir / scene_id)
                await asyncio.to_thread(self._store.add, scene)
                self._stored_bytes += size
            self._log.info("scene uploaded", scene=scene_id, name=scene.name)
            return scene, True
        finally:
            await asyncio.to_thread(shutil.rmtree, folder, ignore_errors=True)

    async def _known(self, scene_id: str) -> SceneRecord | None:
        """The scene if it is kept already, which from now on counts as last used now."""
        if known := await asyncio.to_thread(self._store.get, scene_id):
            with contextlib.suppress(OSError):
                await asyncio.to_thread(os.utime, self._settings.scenes_dir / scene_id)
        return known

    async def remove(self, scene_id: str, client_id: str | None) -> None:
        """Delete a scene, or the client's upload of it. Raises SceneNotFound, SceneStillNeeded."""
        folder = self._settings.scenes_dir / scene_id
        async with self._keeping:
            if not await asyncio.to_thread(self._store.remove, scene_id, client_id):
                return
            # A server that is killed here leaves a folder that the next one removes.
            self._stored_bytes -= await asyncio.to_thread(_size_of, folder)
            await asyncio.to_thread(shutil.rmtree, folder, ignore_errors=True)
        self._log.info("scene deleted", scene=scene_id)

    async def forget_before(self, at: str) -> int:
        """Delete scenes that no job needs and nobody has uploaded since; how many."""
        forgotten = 0
        for scene_id in await asyncio.to_thread(self._store.unneeded_before, at):
            with contextlib.suppress(OSError, SceneNotFound, SceneStillNeeded):
                used = (self._settings.scenes_dir / scene_id).stat().st_mtime
                if iso(datetime.fromtimestamp(used, UTC)) < at:
                    await self.remove(scene_id, None)
                    forgotten += 1
        return forgotten

    def requirements(self, scene_id: str) -> dict[str, Any] | None:
        """What an uploaded scene requires, as told when it was taken in; None for scenes of older versions."""
        try:
            return json.loads((self._settings.scenes_dir / scene_id / _REQUIREMENTS).read_text())
        except (OSError, ValueError):
            return None

    async def built_in_requirements(self, name: str) -> dict[str, Any]:
        """What a scene of the gallery requires. Raises ProblemError."""
        if name not in self._built_in:
            facts = await self._inspect(inspection.inspect_built_in, name, self._settings.max_scene_bytes)
            if facts.failure is not None:
                raise ProblemError(500, "scene-failed", facts.failure.title, facts.failure.detail)
            self._built_in[name] = facts.requirements
        return self._built_in[name]

    def _unpack(self, source: BinaryIO, file_name: str, folder: Path) -> Bundle:
        limits = Limits(
            self._settings.max_bundle_files, self._settings.max_bundle_bytes, self._settings.max_bundle_ratio
        )
        folder.mkdir()
        try:
            return unpack(source, file_name, folder, limits)
        except BundleError as error:
            raise scene_refused("The upload cannot be unpacked", f"{error}.") from None

    async def _inspect(self, call: Callable[[str, int], SceneFacts], source: str, memory_bytes: int) -> SceneFacts:
        if self._idle is not None:
            self._idle.cancel()
        self._busy += 1
        seconds = self._settings.upload_deadline_seconds
        try:
            if self._engine.pid is None:
                await self._engine.submit(inspection.prepare, memory_bytes, deadline=_LOADING_SECONDS)
            facts = await self._engine.submit(call, source, memory_bytes, deadline=seconds)
            if facts.failure is not None and facts.failure.is_unexpected:
                self._engine.close()  # the next scene is checked in a fresh process
            return facts
        except Lost as lost:
            raise scene_refused(
                "The scene could not be loaded",
                f"While it was loaded, {lost}: the scene may be damaged or too large for this machine.",
            ) from None
        finally:
            self._busy -= 1
            if self._busy == 0:
                self._idle = asyncio.get_running_loop().call_later(_IDLE_SECONDS, self._close_if_idle)

    def _close_if_idle(self) -> None:
        if self._busy == 0:
            self._engine.close()

    def close(self) -> None:
        """End the process."""
        if self._idle is not None:
            self._idle.cancel()
        self._engine.close()


def _folder_name(file_name: str) -> str:
    """A plain name for the folder of an upload: the renderer calls a scene.xml after its folder."""
    return re.sub(r"[^A-Za-z0-9_-]+", "-", shown_name(file_name))[:40].strip("-") or "scene"


def scene_refused(title: str, detail: str) -> ProblemError:
    """422 for an uploaded scene."""
    return ProblemError(422, "scene-refused", title, detail, [FieldError(field="file", message=detail)])


def _no_room(size: int, stored: int, limit: int) -> ProblemError:
    """507: with this scene, too much would be stored."""
    detail = (
        f"The scene takes {_say_bytes(size)}, and {_say_bytes(stored)} of the {_say_bytes(limit)} for uploaded scenes "
        "are taken; delete scenes that are not needed (DELETE /api/scenes/ID), or raise FREDHOLM_MAX_STORED_BYTES."
    )
    return ProblemError(507, "no-room", "There is no room for the scene", detail)


def _say_bytes(n: int) -> str:
    return f"{n / MEBIBYTE:.3g} MiB" if n >= MEBIBYTE / 100 else f"{n} bytes"


def _size_of(folder: Path) -> int:
    """Bytes of all files below a folder."""
    return sum(path.lstat().st_size for path in folder.rglob("*") if path.is_file())


def _keep(folder: Path, target: Path) -> None:
    """Move an unpacked scene to its place.

    What lies there from a crash before it was recorded is replaced.
    """
    shutil.rmtree(target, ignore_errors=True)
    os.replace(folder, target)
