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
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, BinaryIO

import structlog

from renderer.scene.bundle import Bundle, BundleError, Limits, digest_of, shown_name, unpack
from service.durable_files import move_into_place
from service.engine import inspection
from service.engine.inspectors import Inspector, Inspectors, TooManyWaiting
from service.engine.local import Lost
from service.engine.turn import SceneFacts
from service.errors import ProblemError, disk_full, refused
from service.messages import FieldError
from service.quarantine import Quarantine
from service.room import Disk, is_full
from service.settings import MEBIBYTE, ServiceSettings
from service.shown import MOST_ENTRIES, shown
from service.store import SceneDamaged, SceneNotFound, SceneRecord, SceneStillNeeded, SceneStore
from service.store.records import iso, loaded_as, now
from service.store.threads import at_leisure, reading, writing

_REQUIREMENTS = "requirements.json"  # beside the folder of what was uploaded
_UNFINISHED = ".upload-"
_REMEMBERED = 1000  # scenes with values for their parameters, that were found fine
_OWN = " the service"  # asks for what its own scenes require; no client has such a name


class Uploads:
    """The uploaded scenes and the processes that check them. scene_bytes: of memory, that one may take."""

    def __init__(
        self,
        settings: ServiceSettings,
        store: SceneStore,
        quarantine: Quarantine,
        disk: Disk,
        scene_bytes: int | None = None,
    ) -> None:
        self._settings = settings
        self._store = store
        self._quarantine = quarantine
        self._disk = disk
        self._scene_bytes = scene_bytes or settings.max_scene_bytes
        self._inspectors = Inspectors(settings.inspection_dir)
        self._built_in: dict[str, dict[str, Any]] = {}
        self._with_parameters: dict[str, dict[str, Any]] = {}
        self._keeping = asyncio.Lock()
        self._stored_bytes = 0
        # Files of scenes, as they were when verified.
        self._whole: dict[str, tuple[tuple[str, int, int, int], ...]] = {}
        self._log = structlog.get_logger("service.uploads")

    def prepare(self) -> None:
        """Make the folder of scenes, remove what a killed server left half done and put away what no row names.

        Synchronous.
        """
        self._settings.scenes_dir.mkdir(mode=0o700, parents=True, exist_ok=True)
        self._inspectors.prepare()
        known = self._store.ids()
        for folder in list(self._settings.scenes_dir.iterdir()):
            if folder.name.startswith(_UNFINISHED):
                shutil.rmtree(folder, ignore_errors=True)
            elif folder.name not in known:
                self._quarantine.take(folder, "no uploaded scene has this id")
        self._stored_bytes = _size_of(self._settings.scenes_dir)

    async def take(self, source: BinaryIO, file_name: str, client: str) -> tuple[SceneRecord, bool]:
        """The stored scene, and whether it is new to the client. Raises ProblemError."""
        try:
            # Unpacked, each may be large, and unpacking keeps a thread busy that others wait for.
            async with self._inspectors.turn(client) as inspector:
                self._check_disk(0)
                return await self._take(source, file_name, client, inspector)
        except TooManyWaiting:
            detail = "Your other uploads are still being checked, one after the other; send this one again later."
            raise ProblemError(429, "too-many", "Too many uploads", detail, headers={"Retry-After": "10"}) from None
        except OSError as error:
            if is_full(error):
                raise disk_full(self._disk.shortage(_size_of_upload(source)), "store the scene") from None
            raise

    async def _take(
        self, source: BinaryIO, file_name: str, client: str, inspector: Inspector
    ) -> tuple[SceneRecord, bool]:
        folder = Path(await asyncio.to_thread(tempfile.mkdtemp, prefix=_UNFINISHED, dir=inspector.incoming))
        try:
            inner = _folder_name(file_name)
            bundle = await asyncio.to_thread(self._unpack, source, file_name, folder / inner)
            scene_id = bundle.digest[:16]
            known = await self._known(scene_id)
            is_own = known is not None and (not client or await reading(self._store.get, scene_id, client))
            if known is not None and is_own and await asyncio.to_thread(self.is_whole, known):
                return known, False
            # What only others have is checked like anything new: neither answer nor time tells that they have it.
            size = await asyncio.to_thread(_size_of, folder)
            if not is_own and self._stored_bytes + size > self._settings.max_stored_bytes:
                raise _no_room(size, self._stored_bytes, self._settings.max_stored_bytes)
            what = (str(folder / inner), bundle.scene, self._scene_bytes)
            facts = await self._inspect(inspector, inspection.inspect_upload, *what)
            if facts.failure is not None:
                detail = facts.failure.detail.replace(folder.name, bundle.name)
                if facts.failure.trace:
                    self._log.error("scene check failed", scene=bundle.name, trace=facts.failure.trace)
                raise scene_refused(facts.failure.title, shown(detail))
            scene = SceneRecord(
                id=scene_id,
                name=bundle.name,
                path=f"{scene_id}/{inner}/{bundle.scene}",
                width=facts.width,
                height=facts.height,
                digest=facts.digest,
                warnings=shown(facts.warnings),
                created_at=now(),
            )
            (folder / _REQUIREMENTS).write_text(json.dumps(_told(facts.requirements) | {"name": bundle.name}))
            async with self._keeping:
                kept, is_new = await self._keep(folder, scene, size)
            return kept, is_new or (not is_own and bool(client))
        finally:
            await asyncio.to_thread(shutil.rmtree, folder, ignore_errors=True)

    async def _keep(self, folder: Path, scene: SceneRecord, size: int) -> tuple[SceneRecord, bool]:
        """Put an inspected scene in its place, then record it: what is acknowledged outlives a power cut."""
        target = self._settings.scenes_dir / scene.id
        known = await self._known(scene.id)
        if known is not None:
            if await asyncio.to_thread(self.is_whole, known):
                return known, False
            # The row names a folder of its own choice: another name of the upload led to it.
            (folder / Path(scene.path).parts[1]).rename(folder / Path(known.path).parts[1])
        if target.exists():
            why = "its content was damaged, and came again" if known else "no uploaded scene has this id"
            await asyncio.to_thread(self._quarantine.take, target, why)
        await asyncio.to_thread(move_into_place, folder, target)
        if known is not None:
            self._log.warning("damaged scene healed by the same upload", scene=scene.id)
            return known, False
        await writing(self._store.add, scene)
        self._stored_bytes += size
        self._log.info("scene uploaded", scene=scene.id, name=scene.name)
        return scene, True

    def is_whole(self, scene: SceneRecord) -> bool:
        """Whether all that was uploaded is there, bit for bit; read again only where a file has changed.

        Synchronous.
        """
        folder = self._settings.scenes_dir / scene.id
        try:
            looks = _looks_of(folder)
            if self._whole.get(scene.id) == looks:
                return True
            content = self._settings.scenes_dir.joinpath(*Path(scene.path).parts[:2])
            if digest_of(content)[: len(scene.id)] != scene.id:
                return False
            if (folder / _REQUIREMENTS).exists():  # older versions kept none
                json.loads((folder / _REQUIREMENTS).read_text())
        except (OSError, ValueError):
            return False
        self._whole[scene.id] = looks
        return True

    def check_whole(self, scene: SceneRecord) -> None:
        """Before a scene is used. Raises SceneDamaged. Synchronous."""
        if not self.is_whole(scene):
            self._log.error("the files of a scene are damaged", scene=scene.id)
            raise SceneDamaged(scene.id)

    def _check_disk(self, size: int) -> None:
        if shortage := self._disk.shortage(size):
            raise disk_full(shortage, "store the scene")

    async def _known(self, scene_id: str) -> SceneRecord | None:
        """The scene if it is kept already, which from now on counts as last used now."""
        if known := await reading(self._store.get, scene_id):
            with contextlib.suppress(OSError):
                await asyncio.to_thread(os.utime, self._settings.scenes_dir / scene_id)
        return known

    async def remove(self, scene_id: str, client_id: str | None) -> None:
        """Delete a scene, or the client's upload of it. Raises SceneNotFound, SceneStillNeeded."""
        folder = self._settings.scenes_dir / scene_id
        async with self._keeping:
            if not await writing(self._store.remove, scene_id, client_id):
                return
            # A server that is killed here leaves a folder that the next one removes.
            self._stored_bytes -= await asyncio.to_thread(_size_of, folder)
            await asyncio.to_thread(shutil.rmtree, folder, ignore_errors=True)
        self._log.info("scene deleted", scene=scene_id)

    async def forget_before(self, at: str) -> int:
        """Delete scenes that no job needs and nobody has uploaded since; how many."""
        forgotten = 0
        for scene_id in await at_leisure(self._store.unneeded_before, at):
            with contextlib.suppress(OSError, SceneNotFound, SceneStillNeeded):
                used = (self._settings.scenes_dir / scene_id).stat().st_mtime
                if iso(datetime.fromtimestamp(used, UTC)) < at:
                    await self.remove(scene_id, None)
                    forgotten += 1
        return forgotten

    def requirements(self, scene_id: str) -> dict[str, Any] | None:
        """What an uploaded scene requires, as told when it was taken in; None for scenes of older versions."""
        try:
            kept = json.loads((self._settings.scenes_dir / scene_id / _REQUIREMENTS).read_text())
        except (OSError, ValueError):
            return None
        # Older versions kept them at any length.
        return with_listed_sensors(shown(kept | {"sensor_choices": []}), kept.get("sensor_choices", []))

    def sensors(self, scene_id: str) -> list[dict[str, Any]]:
        """All sensors of an uploaded scene, also those that are not listed; none for scenes of older versions."""
        try:
            kept = json.loads((self._settings.scenes_dir / scene_id / _REQUIREMENTS).read_text())
        except (OSError, ValueError):
            return []
        return kept.get("sensor_choices", [])

    async def with_parameters(self, scene: SceneRecord, parameters: Mapping[str, str], client: str) -> dict[str, Any]:
        """What an uploaded scene requires with values for its parameters: it is checked with them as it was when it
        came, for they may name any file and any size. Raises ProblemError.
        """
        key = loaded_as(scene.id, parameters)
        if (known := self._with_parameters.get(key)) is not None:
            return known
        try:
            async with self._inspectors.turn(client) as inspector:
                facts = await self._inspect_again(inspector, scene, parameters)
        except TooManyWaiting:
            detail = "Other scenes of yours are still being checked, one after the other; ask again later."
            raise ProblemError(429, "too-many", "Too many checks", detail, headers={"Retry-After": "10"}) from None
        except OSError as error:
            if is_full(error):
                raise disk_full(self._disk.shortage(_size_of(self._settings.scenes_dir / scene.id)), "check") from None
            raise
        if facts.failure is not None:
            if facts.failure.trace:
                self._log.error("scene check failed", scene=scene.name, trace=facts.failure.trace)
            raise refused("settings.parameters", shown(facts.failure.detail))
        while len(self._with_parameters) >= _REMEMBERED:
            self._with_parameters.pop(next(iter(self._with_parameters)))
        self._with_parameters[key] = found = _told(facts.requirements)
        return found

    async def _inspect_again(
        self, inspector: Inspector, scene: SceneRecord, parameters: Mapping[str, str]
    ) -> SceneFacts:
        """The facts about a stored scene with parameters; its files are put where the inspector sees them."""
        folder = Path(await asyncio.to_thread(tempfile.mkdtemp, prefix=_UNFINISHED, dir=inspector.incoming))
        _, inner, name = scene.path.split("/", 2)
        try:
            await asyncio.to_thread(self.check_whole, scene)
            source = self._settings.scenes_dir / scene.id / inner
            await asyncio.to_thread(shutil.copytree, source, folder / inner, copy_function=_linked)
            what = (str(folder / inner), name, self._scene_bytes, dict(parameters))
            return await self._inspect(inspector, inspection.inspect_upload, *what)
        finally:
            await asyncio.to_thread(shutil.rmtree, folder, ignore_errors=True)

    def scene_bytes(self, kind: str, reference: str) -> int:
        """What a scene takes in memory, as told when it was taken in; 0 of those of the gallery, which are small."""
        told = self.requirements(reference) if kind == "upload" else None
        return int((told or {}).get("memory_bytes") or 0)

    def is_polarised(self, kind: str, reference: str, told: Mapping[str, Any] | None = None) -> bool:
        """Whether a scene asks for polarised light; none of the gallery does. told: what it requires, where known."""
        if told is None:
            told = self.requirements(reference) if kind == "upload" else None
        return (told or {}).get("polarised_by") is not None

    async def built_in_requirements(self, name: str) -> dict[str, Any]:
        """What a scene of the gallery requires. Raises ProblemError."""
        if name not in self._built_in:
            async with self._inspectors.turn(_OWN) as inspector:
                facts = await self._inspect(inspector, inspection.inspect_built_in, name)
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

    async def _inspect(self, inspector: Inspector, call: Callable[..., SceneFacts], *arguments: object) -> SceneFacts:
        seconds = self._settings.upload_deadline_seconds
        may_repeat = True
        while True:
            try:
                return await inspector.run(call, *arguments, seconds=seconds, bytes_=self._scene_bytes)
            except Lost as lost:
                if lost.was_killed and may_repeat:  # hardly by the scene's fault
                    may_repeat = False
                    continue
                raise scene_refused(
                    "The scene could not be loaded",
                    f"While it was loaded, {lost}: the scene may be damaged or too large for this machine.",
                ) from None

    def close(self) -> None:
        """End the processes."""
        self._inspectors.close()


def _told(requirements: dict[str, Any]) -> dict[str, Any]:
    """What is kept of a scene's requirements: long texts and lists cut, but all of its sensors, any of which a job may
    ask for.
    """
    sensors = [shown(sensor) for sensor in requirements.get("sensor_choices", [])]
    return shown({**requirements, "sensor_choices": []}) | {"sensor_choices": sensors}


def with_listed_sensors(requirements: dict[str, Any], sensors: list[dict[str, Any]]) -> dict[str, Any]:
    """Requirements as they are answered: as many sensors as a list holds, and a note where there are more."""
    listed = [shown(sensor) for sensor in sensors[:MOST_ENTRIES]]
    notes = list(requirements.get("notes", []))
    if len(sensors) > len(listed):
        notes.append(
            f"{len(sensors)} sensors, the first {len(listed)} of which are listed: ask for another by its name or its "
            f"number, 0 to {len(sensors) - 1}"
        )
    return requirements | {"sensor_choices": listed, "notes": notes}


def _linked(source: str, target: str) -> None:
    """The same file in another folder, where the system can; else a copy."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copyfile(source, target)


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


def _size_of_upload(source: BinaryIO) -> int:
    return source.seek(0, os.SEEK_END)


def _say_bytes(n: int) -> str:
    return f"{n / MEBIBYTE:.3g} MiB" if n >= MEBIBYTE / 100 else f"{n} bytes"


def _size_of(folder: Path) -> int:
    """Bytes of all files below a folder."""
    return sum(path.lstat().st_size for path in folder.rglob("*") if path.is_file())


def _looks_of(folder: Path) -> tuple[tuple[str, int, int, int], ...]:
    """Names, sizes, times and inodes of all files below a folder: they change where the content does."""
    found = ((str(path), path.lstat()) for path in sorted(folder.rglob("*")) if path.is_file())
    return tuple((name, stat.st_size, stat.st_mtime_ns, stat.st_ino) for name, stat in found)
