"""Built-in scenes."""

from __future__ import annotations

from fastapi import APIRouter
from fastapi.responses import FileResponse

from renderer.errors import SceneError
from renderer.scene import gallery
from service.access import Reader
from service.context import ServiceContext
from service.errors import not_found
from service.messages import GalleryScene, Requirements

router = APIRouter(prefix="/api/gallery", tags=["gallery"])


@router.get("")
def list_gallery(caller: Reader) -> list[GalleryScene]:
    """The built-in scenes, easiest to read first."""
    return [
        GalleryScene(
            name=scene.name,
            title=scene.title,
            teaches=scene.teaches,
            width=scene.width,
            height=scene.height,
            thumbnail=f"api/gallery/{scene.name}/thumbnail.png",
            has_lesson=not scene.has_media,
        )
        for scene in gallery.list_scenes()
    ]


@router.get("/{name}/requirements", responses={404: {}})
async def requirements(name: str, service: ServiceContext, caller: Reader) -> Requirements:
    """What a built-in scene requires."""
    try:
        gallery.find(name)
    except SceneError as error:
        raise not_found("scene", f"{error}.") from None
    return Requirements.model_validate(await service.uploads.built_in_requirements(name))


@router.get("/{name}/thumbnail.png", response_class=FileResponse, responses={404: {}})
def thumbnail(name: str, caller: Reader) -> FileResponse:
    """A small picture of a built-in scene."""
    try:
        path = gallery.find(name).thumbnail
    except SceneError as error:
        raise not_found("scene", f"{error}.") from None
    if not path.is_file():
        raise not_found("thumbnail", f"The scene {name} has no thumbnail.")
    return FileResponse(path, media_type="image/png", headers={"Cache-Control": "max-age=3600"})
