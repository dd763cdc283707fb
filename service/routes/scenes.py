"""Uploaded scenes."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from typing import Annotated

from fastapi import APIRouter, File, Response, UploadFile

from renderer.scene.bundle import shown_name
from service.access import Reader, SceneId, Submitter
from service.context import ServiceContext
from service.errors import not_found
from service.messages import Scene

router = APIRouter(prefix="/api/scenes", tags=["scenes"])


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
    scene, is_new = await service.uploads.take(file.file, name)
    if caller.client_id:
        await asyncio.to_thread(service.scenes.grant, scene.id, caller.client_id, shown_name(name))
        scene = replace(scene, name=shown_name(name))
    response.status_code = 201 if is_new else 200
    response.headers["Location"] = f"/api/scenes/{scene.id}"
    return Scene.of(scene, service.uploads.requirements(scene.id))


@router.get("")
def list_scenes(service: ServiceContext, caller: Reader) -> list[Scene]:
    """Uploaded scenes, newest first."""
    return [Scene.of(scene, service.uploads.requirements(scene.id)) for scene in service.scenes.newest(caller.scope)]


@router.delete("/{scene_id}", status_code=204, responses={404: {}, 409: {}, 422: {}})
async def delete_scene(scene_id: SceneId, service: ServiceContext, caller: Submitter) -> None:
    """Delete an uploaded scene that no job needs any more. Who uploaded the same content keeps it."""
    await service.uploads.remove(scene_id, caller.scope)


@router.get("/{scene_id}", responses={404: {}, 422: {}})
def get_scene(scene_id: SceneId, service: ServiceContext, caller: Reader) -> Scene:
    """One uploaded scene."""
    scene = service.scenes.get(scene_id, caller.scope)
    if scene is None:
        raise not_found("scene", f"There is no uploaded scene {scene_id!r}.")
    return Scene.of(scene, service.uploads.requirements(scene.id))
