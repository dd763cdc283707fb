"""The picture of a job: frames for the page, one pixel, EXR and PNG."""

from __future__ import annotations

import asyncio
import re
import unicodedata
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
import structlog
from fastapi import APIRouter, Header, Query, Request, Response
from fastapi.responses import FileResponse
from starlette.types import Receive, Scope, Send

from renderer.image.picture import ToneMap
from service import frames
from service.access import ReadableJob, up_to_date
from service.context import Service, ServiceContext
from service.damage import first_sound
from service.display import Display
from service.errors import ProblemError, disk_full, not_found, refused
from service.messages import Pixel
from service.picture_room import ENCODE_BYTES, PNG_BYTES, READ_BYTES, SharedBody
from service.pixels import png_bytes, read_pixel
from service.store import JobRecord, Kept
from service.store.threads import reading, writing

T = TypeVar("T")
log = structlog.get_logger("service.pictures")
router = APIRouter(prefix="/api/jobs/{job_id}", tags=["pictures"])

_FRAME_ANSWERS: dict[int | str, dict[str, Any]] = {
    200: {
        "description": (frames.__doc__ or "") + "\nThe header is a FrameHeader.",
        "content": {frames.MEDIA_TYPE: {"schema": {"type": "string", "format": "binary"}}},
        "headers": {
            "X-Frame-Seq": {
                "schema": {"type": "integer"},
                "description": "sequence number, as in the frame's header",
            },
            "ETag": {"schema": {"type": "string"}},
        },
    },
    204: {"description": "Nothing newer than `after`."},
    304: {"description": "The frame of If-None-Match is the newest."},
    404: {},
    410: {"description": "The saved picture is damaged."},
}


@router.get("/frames/latest", response_class=Response, responses=_FRAME_ANSWERS)
async def latest_frame(
    job: ReadableJob,
    service: ServiceContext,
    after: Annotated[int, Query(ge=0, description="sequence number of the newest frame at hand")] = 0,
    scale: Annotated[Literal["1", "2"], Query(description="2: half the width and height")] = "1",
    maps: Annotated[Literal["0", "1"], Query(description="1: with the channel N, replicates and trust")] = "0",
    accept_encoding: Annotated[str, Header()] = "",
    if_none_match: Annotated[str, Header()] = "",
) -> Response:
    """The newest frame, if it is newer than `after`."""
    job_id = job.id
    if job.progress.frame_seq <= after:
        return Response(status_code=204, headers={"X-Frame-Seq": str(job.progress.frame_seq)})
    encoding = frames.choose_encoding(accept_encoding)
    reduce: Literal[1, 2] = 2 if scale == "2" else 1
    has_maps = maps == "1"

    def tag_of(seq: int) -> str:
        return f'"{job_id}-{seq}-{reduce}-{maps}-{encoding}"'

    tag = tag_of(job.progress.frame_seq)
    headers = {"Cache-Control": "no-cache", "Vary": "Accept-Encoding", "ETag": tag}
    headers["X-Frame-Seq"] = str(job.progress.frame_seq)
    if tag in if_none_match:
        return Response(status_code=304, headers=headers)
    display = await _display(service, job)
    headers |= {"X-Frame-Seq": str(display.seq), "ETag": tag_of(display.seq)}
    body = await _frame_body(service, job, display, reduce, has_maps, encoding)
    if encoding != "identity":
        headers["Content-Encoding"] = encoding
    return SharedBody(body, media_type=frames.MEDIA_TYPE, headers=headers)


async def _frame_body(
    service: Service,
    job: JobRecord,
    display: Display,
    reduce: Literal[1, 2],
    has_maps: bool,
    encoding: frames.Encoding,
) -> bytes:
    """Encoded once for all who ask, and only when someone does."""
    key, seq = (job.id, reduce, has_maps, encoding), display.seq
    async with service.frames.making((*key, seq)):
        body = service.frames.get(key, seq)
        if body is None:
            async with service.picture_room.taking(ENCODE_BYTES * display.width * display.height, job.client_id):
                body = await asyncio.to_thread(
                    lambda: frames.compress(frames.encode_frame(display, reduce, has_maps=has_maps), encoding)
                )
            service.frames.put(key, body, seq)
    return body


@router.get("/pixel", responses={404: {}, 410: {}, 422: {}})
async def pixel(
    job: ReadableJob,
    service: ServiceContext,
    x: Annotated[int, Query(ge=0, description="column")],
    y: Annotated[int, Query(ge=0, description="row, 0 at the top")],
) -> Pixel:
    """One pixel with its error bars."""
    for name, value, side in (("x", x, "width"), ("y", y, "height")):
        if value >= job.settings[side]:
            raise refused(name, f"{value} is outside the picture, whose {side} is {job.settings[side]}")
    return read_pixel(await _display(service, job), x, y)


class HeldFile(FileResponse):
    """A file under a name of its own: the job may end, and its file go, while it is sent."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        try:
            await super().__call__(scope, receive, send)
        finally:
            Path(self.path).unlink(missing_ok=True)


@router.get("/image.exr", response_class=FileResponse, responses={404: {}, 410: {}, 422: {}, 507: {}})
async def image_exr(
    job: ReadableJob,
    service: ServiceContext,
    half: Annotated[Literal["0", "1"], Query(description="1: radiance in half precision")] = "0",
) -> FileResponse:
    """The picture: radiance, standard errors, counts and channels as a small EXR, without moments."""
    held = await _held_estimate(job, service)
    picture = held.with_name(f"picture-{held.name}")
    size = READ_BYTES * job.settings["width"] * job.settings["height"]
    try:
        async with service.picture_room.taking(size, job.client_id):
            await asyncio.to_thread(_write_picture, held, picture, job.id, half == "1")
    except OSError:
        picture.unlink(missing_ok=True)
        raise disk_full(None, "write the picture") from None
    finally:
        held.unlink(missing_ok=True)
    return HeldFile(picture, media_type="image/x-exr", filename=file_name(job, "exr"))


def _write_picture(source: Path, target: Path, job_id: str, half: bool) -> None:
    from renderer import Estimate

    Estimate.read(source).write_picture(target, {"job": job_id}, half=half)


@router.get("/checkpoint.exr", response_class=FileResponse, responses={404: {}, 410: {}})
async def checkpoint_exr(job: ReadableJob, service: ServiceContext) -> FileResponse:
    """The newest saved estimate, with the moments that `fredholm render --resume`, merge and replay need."""
    held = await _held_estimate(job, service)
    return HeldFile(held, media_type="image/x-exr", filename=file_name(job, "checkpoint.exr"))


async def _held_estimate(job: JobRecord, service: Service) -> Path:
    """A file of the newest sound estimate, which is the caller's to remove. Raises ProblemError."""
    if job.checkpoint is None:
        # A young job has none yet: have one made rather than refuse.
        await service.runner.save_now(job.id)
        job = await _current(service, job.id)
    held = await _sound(service, job, service.files.hold)
    if held is None:
        raise _no_picture(job)
    return held


@router.get(
    "/image.png", response_class=Response, responses={200: {"content": {"image/png": {}}}, 404: {}, 410: {}, 422: {}}
)
async def image_png(
    job: ReadableJob,
    request: Request,
    service: ServiceContext,
    exposure: Annotated[float, Query(ge=-30, le=30, allow_inf_nan=False, description="stops")] = 0.0,
    tone: Annotated[ToneMap, Query(description="srgb: clipped at white, without any other change")] = "srgb",
) -> Response:
    """The picture as sRGB: to look at, not to measure."""
    job_id = job.id
    display = await _display(service, job)
    tag = f'"{job_id}-{display.seq}-{exposure:g}-{tone}"'
    headers = {"Cache-Control": "no-cache", "ETag": tag}
    if tag in request.headers.get("if-none-match", ""):
        return Response(status_code=304, headers=headers)
    headers["Content-Disposition"] = f'inline; filename="{file_name(job, "png")}"'
    saved = None if job.checkpoint is None else service.files.path(job.checkpoint)

    def encoded() -> bytes:
        from renderer.image.exr import read_alpha

        radiance = np.asarray(display.radiance)
        alpha = None if saved is None else read_alpha(saved)
        has_alpha = alpha is not None and alpha.shape == radiance.shape[:2]
        return png_bytes(radiance, exposure, tone, alpha if has_alpha else None)

    async with service.picture_room.taking(PNG_BYTES * display.width * display.height, job.client_id):
        body = await asyncio.to_thread(encoded)
    return SharedBody(body, media_type="image/png", headers=headers)


def file_name(job: JobRecord, suffix: str) -> str:
    """What a browser calls a download: the scene's name, as far as ASCII has it, and the job."""
    name = job.scene_ref if job.scene_kind == "gallery" else job.name.removesuffix(".zip").removesuffix(".xml")
    plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode()
    stem = re.sub(r"[^A-Za-z0-9_-]+", "-", plain).strip("-")[:60] or "scene"
    return f"{stem}-{job.id[:8]}.{suffix}"


async def _current(service: Service, job_id: str) -> JobRecord:
    return up_to_date(service, await reading(service.jobs.get, job_id))


async def _display(service: Service, job: JobRecord) -> Display:
    # Mapping a file of shared memory takes less than handing that to a thread, and most who ask ask for these.
    if (live := service.runner.live(job.id)) and (display := service.files.shown(live.display_path)):
        return display
    display = await _saved(service, job)
    if display is None:
        # The job may have ended between the two looks: its saved estimate is there now.
        display = await _saved(service, await reading(service.jobs.get, job.id))
    if display is None:
        raise _no_picture(job)
    return display


async def _saved(service: Service, job: JobRecord) -> Display | None:
    """The saved picture, read once for all who ask at a time."""
    size = READ_BYTES * job.settings["width"] * job.settings["height"]
    async with service.frames.making(("saved", job.id)), service.picture_room.taking(size, job.client_id):
        return await _sound(service, job, service.files.saved)


async def _sound(service: Service, job: JobRecord, read: Callable[[Kept], T]) -> T | None:
    """What the newest sound estimate leads to; None where none was saved yet. Raises ProblemError: all are lost."""
    while True:
        found = await asyncio.to_thread(first_sound, job.kept, read)
        if not found.losses:
            return found.value
        current = await _current(service, job.id)
        if current.checkpoint == job.checkpoint:
            break
        job = current  # what was read has been superseded meanwhile, and is no loss
    log.error("saved estimates are damaged", job=job.id, losses=found.losses)
    if service.runner.live(job.id) is None:  # else the renderer will come by it, and say so
        await writing(service.jobs.note_loss, job, found.losses, found.kept)
        await service.hub.tell_transitions()
    if found.kept is None:
        detail = f"{' '.join(found.losses)} Continue the job or submit it again to have it rendered anew."
        raise ProblemError(410, "estimate-damaged", "The saved picture is damaged", detail)
    return found.value


def _no_picture(job: JobRecord) -> ProblemError:
    return not_found("picture", f"The job is {job.state} and has no picture yet; ask again once it has a frame.")
