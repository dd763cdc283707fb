"""Uploaded scenes."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, File, Response, UploadFile

from service.context import ServiceContext
from service.errors import not_found
from service.messages import Scene

router = APIRouter(prefix="/api/scenes", tags=["scenes"])


@router.post("", status_code=201, responses={200: {"model": Scene}, 413: {}, 422: {}})
async def upload_scene(
    file: Annotated[
        UploadFile, File(description="a Mitsuba .xml, the same as .json, or a .zip with one and its files")
    ],
    service: ServiceContext,
    response: Response,
) -> Scene:
    """Upload a scene and learn what it requires. The same content again is the same scene, answered with 200."""
    scene, is_new = await service.uploads.take(file.file, file.filename or "scene.xml")
    response.status_code = 201 if is_new else 200
    response.headers["Location"] = f"/api/scenes/{scene.id}"
    return Scene.of(scene, service.uploads.requirements(scene.id))


@router.get("")
def list_scenes(service: ServiceContext) -> list[Scene]:
    """Uploaded scenes, newest first."""
    return [Scene.of(scene, service.uploads.requirements(scene.id)) for scene in service.scenes.newest()]


@router.get("/{scene_id}", responses={404: {}})
def get_scene(scene_id: str, service: ServiceContext) -> Scene:
    """One uploaded scene."""
    scene = service.scenes.get(scene_id)
    if scene is None:
        raise not_found("scene", f"There is no uploaded scene {scene_id!r}.")
    return Scene.of(scene, service.uploads.requirements(scene.id))
