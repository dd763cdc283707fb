"""The Learn view: the rendering equation at one pixel of a scene, and what its picture costs, as the renderer tells."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, Path, Query, Response

from service import frames
from service.access import Reader
from service.asking import ask, own_page
from service.clients import Caller
from service.context import Service, ServiceContext
from service.engine import learning, learning_paths, learning_trade
from service.errors import not_found, refused
from service.lesson_scenes import find
from service.messages import (
    Bounces,
    FirstVertex,
    KernelTrade,
    LightPaths,
    LightPoints,
    RunningMoments,
    Technique,
    Trade,
)

router = APIRouter(prefix="/api/learn/{scene}", tags=["learn"], dependencies=[Depends(own_page)])

_MAX_REPLICATES = 64
_MAX_SAMPLES = 1 << 16
_MAX_STEPS = 10_000

Scene = Annotated[str, Path(description="name of a gallery scene, or id of an uploaded one", max_length=64)]
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
    return FirstVertex.model_validate(await _ask(service, caller, scene, learning.vertex, (x, y), n))


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
    body = await _ask(service, caller, scene, learning.incident, (x, y), replicates, weighted)
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
    body = await _ask(service, caller, scene, learning.kernel, (x, y))
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
    return Bounces.model_validate(await _ask(service, caller, scene, learning.bounces, (x, y), first, count))


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
    return LightPaths.model_validate(await _ask(service, caller, scene, learning_paths.paths, (x, y), first))


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
    return LightPoints.model_validate(await _ask(service, caller, scene, learning_paths.light_points, (x, y), n))


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
    moments = await _ask(service, caller, scene, learning.samples, (x, y), technique, first, count, max_depth)
    return [RunningMoments.model_validate(step) for step in moments]


@router.get("/picture.png", response_class=Response, responses={200: {"content": {"image/png": {}}}, 404: {}, 429: {}})
async def small_picture(scene: Scene, service: ServiceContext, caller: Reader) -> Response:
    """A small picture of the scene, rendered now, to choose a pixel in."""
    return Response(await _ask(service, caller, scene, learning.picture, None), media_type="image/png")


@router.get("/trade", responses={404: {}, 422: {}, 429: {}})
async def error_against_time(
    scene: Scene,
    service: ServiceContext,
    caller: Reader,
    group: Annotated[Literal["technique", "sampling", "depth"], Query(description="what is compared")] = "technique",
    seconds: Annotated[float, Query(ge=0.1, le=learning_trade.MOST_SECONDS, description="for each setting")] = 2.0,
    step: Annotated[int, Query(ge=0, lt=_MAX_STEPS, description="0, 1, 2, … until is_done")] = 0,
) -> Trade:
    """One more turn of measuring what settings cost, beside the jobs: all that is known by then, with intervals."""
    return Trade.model_validate(await _ask(service, caller, scene, learning_trade.trade, None, group, seconds, step))


@router.get("/kernels", responses={404: {}, 422: {}, 429: {}})
async def lean_and_full(
    scene: Scene,
    service: ServiceContext,
    caller: Reader,
    step: Annotated[int, Query(ge=0, lt=_MAX_STEPS, description="0, 1, 2, … until is_done")] = 0,
) -> KernelTrade:
    """One more turn of measuring what the scene's lean kernel saves against the full one."""
    return KernelTrade.model_validate(await _ask(service, caller, scene, learning_trade.kernels, None, step))


async def _ask(
    service: Service,
    caller: Caller,
    name: str,
    call: Callable[..., Any],
    at: tuple[int, int] | None,
    *arguments: object,
) -> Any:
    """What a call answers about a pixel of a scene, or about a scene."""
    scene = await find(service, caller, name)
    about: object = scene.source
    if at is not None:
        for axis, value, side, length in (("x", at[0], "width", scene.width), ("y", at[1], "height", scene.height)):
            if value >= length:
                raise refused(axis, f"{value} is outside the picture, whose {side} is {length}")
        about = learning.Pixel(scene.source, *at)
    return await ask(service, caller, call, about, *arguments, about=scene.id if scene.is_uploaded else None)
