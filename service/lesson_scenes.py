"""Which scenes have a lesson: those of the gallery, and uploaded ones that the renderer can take beside its jobs."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass

from renderer.errors import SceneError
from renderer.scene import gallery
from service.clients import Caller
from service.context import Service
from service.errors import ProblemError, not_found, refused
from service.store.threads import reading

MOST_BYTES = 256 << 20  # of an uploaded scene: a lesson keeps it beside those of the jobs
MOST_LOSSES = 2  # render processes that a scene's lesson may end
_MEDIA = "has participating media, and a lesson shows the light at a surface in empty space; take another scene"


@dataclass(frozen=True, slots=True)
class LessonScene:
    """A scene that a lesson is about. source: what the renderer is to load."""

    id: str
    name: str
    source: str
    width: int
    height: int
    is_uploaded: bool


async def find(service: Service, caller: Caller, name: str) -> LessonScene:
    """A scene by its name in the gallery or its id among the caller's own. Raises ProblemError."""
    try:
        found = gallery.find(name)
    except SceneError as error:
        if (own := await _uploaded(service, caller, name)) is None:
            raise not_found("scene", f"{error}, and no uploaded scene has this id.") from None
        return own
    if found.has_media:
        raise refused("scene", f"{found.name} {_MEDIA}")
    return LessonScene(found.name, found.name, found.name, found.width, found.height, False)


async def _uploaded(service: Service, caller: Caller, scene_id: str) -> LessonScene | None:
    scene = await reading(service.scenes.get, scene_id, caller.scope)
    if scene is None:
        return None
    told = await asyncio.to_thread(service.uploads.requirements, scene_id)
    if told is None:
        raise refused("scene", f"{scene.name} was taken in by an older version; upload it again")
    if told["media"]:
        raise refused("scene", f"{scene.name} {_MEDIA}")
    if (size := int(told["memory_bytes"])) > MOST_BYTES:
        why = f"takes {size >> 20} MiB in memory; a lesson takes scenes up to {MOST_BYTES >> 20} MiB: render it instead"
        raise refused("scene", f"{scene.name} {why}")
    if service.lesson_losses[scene_id] >= MOST_LOSSES:
        detail = f"Lessons about {scene.name} have ended the renderer {MOST_LOSSES} times; take another scene."
        raise ProblemError(422, "no-lesson", "This scene has no lesson", detail)
    await asyncio.to_thread(service.uploads.check_whole, scene)
    source = str(service.settings.scenes_dir / scene.path)
    return LessonScene(scene.id, scene.name, source, scene.width, scene.height, True)
