"""The Learn view: what an estimator sees and does at one pixel of a gallery scene, as the renderer itself tells."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, TypeVar

from fastapi import APIRouter, Path, Query, Response

from renderer.errors import SceneError
from renderer.scene import gallery
from service import frames
from service.access import NEEDS_READER
from service.context import Service, ServiceContext
from service.engine import learning
from service.engine.interface import Lost
from service.engine.turn import Failure
from service.errors import ProblemError, not_found, refused
from service.messages import FirstVertex, RunningMoments, Technique
from service.runner import Busy

router = APIRouter(prefix="/api/learn/{scene}", tags=["learn"], dependencies=[NEEDS_READER])

T = TypeVar("T")
_DEADLINE_SECONDS = 60.0
_MAX_REPLICATES = 64
_MAX_SAMPLES = 1 << 16

Scene = Annotated[str, Path(description="name of a gallery scene")]
Column = Annotated[int, Query(ge=0, description="column, at the scene's own size")]
Row = Annotated[int, Query(ge=0, description="row, 0 at the top")]


@router.get("", responses={404: {}, 422: {}, 429: {}})
async def first_vertex(
    scene: Scene,
    service: ServiceContext,
    x: Column,
    y: Row,
    n: Annotated[int, Query(ge=1, le=4096, description="directions of each technique")] = 256,
) -> FirstVertex:
    """The surface that a pixel sees, and where each technique sends its samples from there."""
    return FirstVertex.model_validate(await _ask(service, learning.vertex, _pixel(scene, x, y), n))


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
    x: Column,
    y: Row,
    replicates: Annotated[int, Query(ge=2, le=_MAX_REPLICATES, description="of 4 samples, per direction")] = 8,
    weighted: Annotated[bool, Query(description="times f·cosθ: what is integrated")] = False,
) -> Response:
    """The radiance that arrives at the first vertex, as a frame: φ to the right, θ from the normal downwards."""
    body = await _ask(service, learning.incident, _pixel(scene, x, y), replicates, weighted)
    if body is None:
        raise not_found("surface", f"Pixel ({x}, {y}) of {scene} sees no surface.")
    return Response(body, media_type=frames.MEDIA_TYPE, headers={"Cache-Control": "no-cache"})


@router.get("/samples", responses={404: {}, 422: {}, 429: {}})
async def running_estimate(
    scene: Scene,
    service: ServiceContext,
    x: Column,
    y: Row,
    technique: Technique = "mis",
    first: Annotated[int, Query(ge=0, le=1 << 24, description="number of the first sample")] = 0,
    count: Annotated[int, Query(ge=1, le=_MAX_SAMPLES)] = 4096,
) -> list[RunningMoments]:
    """Moments of ever more samples of the pixel's luminance by one technique; parts merge in order."""
    moments = await _ask(service, learning.samples, _pixel(scene, x, y), technique, first, count)
    return [RunningMoments.model_validate(step) for step in moments]


def _pixel(scene: str, x: int, y: int) -> learning.Pixel:
    try:
        found = gallery.find(scene)
    except SceneError as error:
        raise not_found("scene", f"{error}.") from None
    for name, value, side, length in (("x", x, "width", found.width), ("y", y, "height", found.height)):
        if value >= length:
            raise refused(name, f"{value} is outside the picture, whose {side} is {length}")
    return learning.Pixel(found.name, x, y)


async def _ask(service: Service, call: Callable[..., T | Failure], *arguments: object) -> T:
    try:
        answer = await service.runner.ask(_DEADLINE_SECONDS, call, *arguments)
    except Busy:
        service.metrics.refusals.labels("questions").inc()
        detail = "Too many ask the renderer now; ask again in a moment."
        raise ProblemError(429, "too-many", "The renderer is busy", detail, headers={"Retry-After": "2"}) from None
    except Lost as lost:
        raise ProblemError(503, "renderer-lost", "The renderer was lost", f"{lost}; ask again.") from None
    if isinstance(answer, Failure):
        if answer.is_unexpected:
            service.runner.renew_renderer()
        raise ProblemError(500, "lesson-failed", answer.title, answer.detail)
    return answer
