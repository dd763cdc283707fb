"""Uploaded scenes."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

from fastapi import APIRouter, File, Query, Response, UploadFile

from renderer.scene.bundle import shown_name
from service.access import HeadFirst, Reader, SceneId, Submitter
from service.context import ServiceContext
from service.errors import not_found, refused
from service.messages import Scene
from service.store import SceneNotFound
from service.store.threads import reading, writing

router = APIRouter(prefix="/api/scenes", tags=["scenes"], route_class=HeadFirst)


@router.post("", status_code=201, responses={200: {"model": Scene}, 413: {}, 422: {}, 507: {}})
async def upload_scene(
    file: Annotated[
        UploadFile, File(description="a Mitsuba .xml, the same as .json, or a .zip with one and its files")
    ],
    service: ServiceContext,
    caller: Submitter,
    response: Response,
) -> Scene:
    """Upload a scene and learn what it requires. The same content again is the same scene, answered with 200."""
    name = file.filename or "scene.xml"
    scene, is_new = await service.uploads.take(file.file, name, caller.client_id)
    if caller.client_id:
        await writing(service.scenes.grant, scene.id, caller.client_id, shown_name(name))
        scene = replace(scene, name=shown_name(name))
    response.status_code = 201 if is_new else 200
    response.headers["Location"] = f"/api/scenes/{scene.id}"
    return Scene.of(scene, service.uploads.requirements(scene.id))


@router.get("", responses={422: {}})
async def list_scenes(
    service: ServiceContext,
    caller: Reader,
    limit: Annotated[int, Query(ge=1, le=1000)] = 100,
    before: Annotated[str | None, Query(description="id of a scene: only older ones", max_length=64)] = None,
) -> list[Scene]:
    """The newest uploaded scenes, newest first; with `before` the last one's id, those after it."""

    def read() -> list[Scene]:
        found = service.scenes.newest(caller.scope, limit, before)
        return [Scene.of(scene, service.uploads.requirements(scene.id)) for scene in found]

    try:
        return await reading(read)
    except SceneNotFound as missing:
        raise refused("before", f"{missing}; give the id of a scene in the list") from None


@router.delete("/{scene_id}", status_code=204, responses={404: {}, 409: {}, 422: {}})
async def delete_scene(scene_id: SceneId, service: ServiceContext, caller: Submitter) -> None:
    """Delete an uploaded scene that no job needs any more. Who uploaded the same content keeps it."""
    await service.uploads.remove(scene_id, caller.scope)


@router.get("/{scene_id}", responses={404: {}, 422: {}})
async def get_scene(scene_id: SceneId, service: ServiceContext, caller: Reader) -> Scene:
    """One uploaded scene."""
    scene = await reading(service.scenes.get, scene_id, caller.scope)
    if scene is None:
        raise not_found("scene", f"There is no uploaded scene {scene_id!r}.")
    return Scene.of(scene, service.uploads.requirements(scene.id))
