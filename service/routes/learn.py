"""The Learn view: the rendering equation at one pixel of a gallery scene, as the renderer itself tells."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Depends, Path, Query, Response

from renderer.errors import SceneError
from renderer.scene import gallery
from service import frames
from service.access import Reader
from service.asking import ask, own_page
from service.context import ServiceContext
from service.engine import learning, learning_paths
from service.errors import not_found, refused
from service.messages import Bounces, FirstVertex, LightPaths, LightPoints, RunningMoments, Technique

router = APIRouter(prefix="/api/learn/{scene}", tags=["learn"], dependencies=[Depends(own_page)])

_MAX_REPLICATES = 64
_MAX_SAMPLES = 1 << 16

Scene = Annotated[str, Path(description="name of a gallery scene")]
Column = Annotated[int, Query(ge=0, description="column, at the scene's own size")]
Row = Annotated[int, Query(ge=0, description="row, 0 at the top")]


@router.get("", responses={404: {}, 422: {}, 429: {}})
async def first_vertex(
    scene: Scene,
    service: ServiceContext,
    caller: Reader,
    x: Column,
    y: Row,
    n: Annotated[int, Query(ge=1, le=4096, description="directions of each technique")] = 256,
) -> FirstVertex:
    """The surface that a pixel sees, and where each technique sends its samples from there."""
    return FirstVertex.model_validate(await ask(service, caller, learning.vertex, _pixel(scene, x, y), n))


@router.get(
    "/incident",
    response_class=Response,
    responses={
        200: {"content": {frames.MEDIA_TYPE: {"schema": {"type": "string", "format": "binary"}}}},
        404: {},
        429: {},
    },
)
async def incident_radiance(
    scene: Scene,
    service: ServiceContext,
    caller: Reader,
    x: Column,
    y: Row,
    replicates: Annotated[int, Query(ge=2, le=_MAX_REPLICATES, description="of 4 samples, per direction")] = 8,
    weighted: Annotated[bool, Query(description="times f·cosθ: what is integrated")] = False,
) -> Response:
    """The radiance that arrives at the first vertex, as a frame: φ to the right, θ from the normal downwards."""
    body = await ask(service, caller, learning.incident, _pixel(scene, x, y), replicates, weighted)
    if body is None:
        raise not_found("surface", f"Pixel ({x}, {y}) of {scene} sees no surface.")
    return Response(body, media_type=frames.MEDIA_TYPE, headers={"Cache-Control": "no-cache"})


@router.get(
    "/kernel",
    response_class=Response,
    responses={
        200: {"content": {frames.MEDIA_TYPE: {"schema": {"type": "string", "format": "binary"}}}},
        404: {},
        429: {},
    },
)
async def equation_kernel(scene: Scene, service: ServiceContext, caller: Reader, x: Column, y: Row) -> Response:
    """f·cosθ towards the camera for each direction, on the map of `/incident`: the kernel of the integral equation."""
    body = await ask(service, caller, learning.kernel, _pixel(scene, x, y))
    if body is None:
        raise not_found("surface", f"Pixel ({x}, {y}) of {scene} sees no surface.")
    return Response(body, media_type=frames.MEDIA_TYPE, headers={"Cache-Control": "no-cache"})


@router.get("/bounces", responses={404: {}, 422: {}, 429: {}})
async def bounces(
    scene: Scene,
    service: ServiceContext,
    caller: Reader,
    x: Column,
    y: Row,
    first: Annotated[int, Query(ge=0, le=1 << 24, description="number of the first sample")] = 0,
    count: Annotated[int, Query(ge=1, le=_MAX_SAMPLES)] = 4096,
) -> Bounces:
    """The pixel's luminance by the number of reflections, from the same samples: the terms sum to the pixel."""
    return Bounces.model_validate(await ask(service, caller, learning.bounces, _pixel(scene, x, y), first, count))


@router.get("/paths", responses={404: {}, 422: {}, 429: {}})
async def light_paths(
    scene: Scene,
    service: ServiceContext,
    caller: Reader,
    x: Column,
    y: Row,
    first: Annotated[int, Query(ge=0, le=1 << 24, description="number of the first path")] = 0,
) -> LightPaths:
    """Sixteen paths from the pixel's centre, vertex by vertex: the ray-casting operator at work."""
    return LightPaths.model_validate(await ask(service, caller, learning_paths.paths, _pixel(scene, x, y), first))


@router.get("/light-points", responses={404: {}, 422: {}, 429: {}})
async def light_points(
    scene: Scene,
    service: ServiceContext,
    caller: Reader,
    x: Column,
    y: Row,
    n: Annotated[int, Query(ge=1, le=1024, description="points")] = 64,
) -> LightPoints:
    """Points on the lights as technique `emitter` draws them, with V, G and each other factor of the area form."""
    return LightPoints.model_validate(await ask(service, caller, learning_paths.light_points, _pixel(scene, x, y), n))


@router.get("/samples", responses={404: {}, 422: {}, 429: {}})
async def running_estimate(
    scene: Scene,
    service: ServiceContext,
    caller: Reader,
    x: Column,
    y: Row,
    technique: Technique = "mis",
    first: Annotated[int, Query(ge=0, le=1 << 24, description="number of the first sample")] = 0,
    count: Annotated[int, Query(ge=1, le=_MAX_SAMPLES)] = 4096,
    max_depth: Annotated[int | None, Query(ge=1, le=1000, description="2: no more than one reflection")] = None,
) -> list[RunningMoments]:
    """Moments of ever more samples of the pixel's luminance by one technique; parts merge in order."""
    moments = await ask(service, caller, learning.samples, _pixel(scene, x, y), technique, first, count, max_depth)
    return [RunningMoments.model_validate(step) for step in moments]


def _pixel(scene: str, x: int, y: int) -> learning.Pixel:
    try:
        found = gallery.find(scene)
    except SceneError as error:
        raise not_found("scene", f"{error}.") from None
    if found.has_media:
        why = "has participating media, and a lesson shows the light at a surface in empty space; take another scene"
        raise refused("scene", f"{found.name} {why}")
    for name, value, side, length in (("x", x, "width", found.width), ("y", y, "height", found.height)):
        if value >= length:
            raise refused(name, f"{value} is outside the picture, whose {side} is {length}")
    return learning.Pixel(found.name, x, y)
