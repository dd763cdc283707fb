"""The picture of a job: frames for the page, one pixel, EXR and PNG."""

from __future__ import annotations

import asyncio
import re
import unicodedata
from typing import Annotated, Any, Literal

import numpy as np
from fastapi import APIRouter, Header, Query, Request, Response
from fastapi.responses import FileResponse

from service import frames
from service.access import ReadableJob, up_to_date
from service.context import Service, ServiceContext
from service.display import Display
from service.errors import ProblemError, not_found, refused
from service.messages import Pixel
from service.pixels import png_bytes, read_pixel
from service.store import JobRecord

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
    body = await _frame_body(service, job_id, display, reduce, has_maps, encoding)
    if encoding != "identity":
        headers["Content-Encoding"] = encoding
    return Response(body, media_type=frames.MEDIA_TYPE, headers=headers)


async def _frame_body(
    service: Service,
    job_id: str,
    display: Display,
    reduce: Literal[1, 2],
    has_maps: bool,
    encoding: frames.Encoding,
) -> bytes:
    """Encoded once for all who ask, and only when someone does."""
    key, seq = (job_id, reduce, has_maps, encoding), display.seq
    async with service.frames.making((*key, seq)):
        body = service.frames.get(key, seq)
        if body is None:
            body = await asyncio.to_thread(
                lambda: frames.compress(frames.encode_frame(display, reduce, has_maps=has_maps), encoding)
            )
            service.frames.put(key, body, seq)
    return body


@router.get("/pixel", responses={404: {}, 422: {}})
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


@router.get("/image.exr", response_class=FileResponse, responses={404: {}})
async def image_exr(job: ReadableJob, service: ServiceContext) -> FileResponse:
    """The newest saved estimate: picture, standard errors, counts and moments in one EXR."""
    job_id = job.id
    if job.checkpoint is None:
        # A young job has none yet: have one made rather than refuse.
        await service.runner.save_now(job_id)
        job = await _current(service, job_id)
    if job.checkpoint is None:
        raise _no_picture(job)
    path = service.files.path(job.checkpoint)
    if not path.is_file():
        raise _no_picture(job)
    return FileResponse(path, media_type="image/x-exr", filename=_file_name(job, "exr"))


@router.get("/image.png", response_class=Response, responses={200: {"content": {"image/png": {}}}, 404: {}, 422: {}})
async def image_png(
    job: ReadableJob,
    request: Request,
    service: ServiceContext,
    exposure: Annotated[float, Query(ge=-30, le=30, allow_inf_nan=False, description="stops")] = 0.0,
) -> Response:
    """The picture as sRGB, clipped: to look at, not to measure."""
    job_id = job.id
    display = await _display(service, job)
    tag = f'"{job_id}-{display.seq}-{exposure:g}"'
    headers = {"Cache-Control": "no-cache", "ETag": tag}
    if tag in request.headers.get("if-none-match", ""):
        return Response(status_code=304, headers=headers)
    headers["Content-Disposition"] = f'inline; filename="{_file_name(job, "png")}"'
    body = await asyncio.to_thread(png_bytes, np.asarray(display.radiance), exposure)
    return Response(body, media_type="image/png", headers=headers)


def _file_name(job: JobRecord, suffix: str) -> str:
    """What a browser calls a download: the scene's name, as far as ASCII has it, and the job."""
    name = job.scene_ref if job.scene_kind == "gallery" else job.name.removesuffix(".zip").removesuffix(".xml")
    plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode()
    stem = re.sub(r"[^A-Za-z0-9_-]+", "-", plain).strip("-")[:60] or "scene"
    return f"{stem}-{job.id[:8]}.{suffix}"


async def _current(service: Service, job_id: str) -> JobRecord:
    return up_to_date(service, await asyncio.to_thread(service.jobs.get, job_id))


async def _display(service: Service, job: JobRecord) -> Display:
    # Mapping a file of shared memory takes less than handing that to a thread, and most who ask ask for these.
    if (live := service.runner.live(job.id)) and (display := service.files.shown(live.display_path)):
        return display
    display = await _saved(service, job)
    if display is None:
        # The job may have ended between the two looks: its saved estimate is there now.
        job = await asyncio.to_thread(service.jobs.get, job.id)
        display = await _saved(service, job)
    if display is None:
        raise _no_picture(job)
    return display


async def _saved(service: Service, job: JobRecord) -> Display | None:
    """The saved picture, read once for all who ask at a time: a large one takes seconds and memory."""
    async with service.frames.making(("saved", job.checkpoint, job.progress.frame_seq)):
        return await asyncio.to_thread(service.files.saved, job.checkpoint, job.progress)


def _no_picture(job: JobRecord) -> ProblemError:
    return not_found("picture", f"The job is {job.state} and has no picture yet; ask again once it has a frame.")
