"""Series: pictures of one scene that are queued together, all sensors or values of parameters, with one archive."""

from __future__ import annotations

import asyncio
import contextlib
import json
import zipfile
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Header, Response
from fastapi import Path as PathParameter
from fastapi.responses import FileResponse

from service.access import HeadFirst, Reader, Submitter, up_to_date
from service.context import Service, ServiceContext
from service.damage import first_sound
from service.errors import ProblemError, disk_full, not_found, refused
from service.messages import Job, Series, SeriesRequest
from service.picture_room import READ_BYTES
from service.room import job_bytes
from service.routes.frames import HeldFile, file_name
from service.routes.jobs import places_of
from service.states import ENDED, IllegalStep, State
from service.store import JobRecord, NewJob, SceneNotFound, SceneRecord
from service.store.threads import reading, writing
from service.submission import members_of, queue_limits, request_digest

router = APIRouter(prefix="/api/series", tags=["series"], route_class=HeadFirst)


async def _readable(
    series_id: Annotated[str, PathParameter(pattern="^[0-9a-f]{1,64}$")], service: ServiceContext, caller: Reader
) -> list[JobRecord]:
    """The jobs of a series that the caller may see. Raises ProblemError."""
    if found := await reading(service.jobs.series, series_id, caller.scope):
        return found
    raise not_found("series", f"There is no series {series_id!r}.")


OwnSeries = Annotated[list[JobRecord], Depends(_readable)]


async def _told(service: Service, some: Sequence[JobRecord]) -> Series:
    places = await reading(places_of, service)
    now = [up_to_date(service, job) for job in some]
    return Series(
        id=some[0].series or "",
        jobs=[
            Job.of(
                job,
                queue_position=places.get(job.id),
                expected_start=service.runner.expected_start(places.get(job.id)),
                waits_for=service.runner.waits_for(job),
            )
            for job in now
        ],
        done=sum(job.state is State.SUCCEEDED for job in now),
        ended=sum(job.state in ENDED for job in now),
    )


@router.post("", status_code=201, responses={410: {}, 422: {}, 429: {}, 507: {}})
async def submit_series(
    request: SeriesRequest,
    service: ServiceContext,
    caller: Submitter,
    response: Response,
    idempotency_key: Annotated[
        str | None,
        Header(min_length=1, max_length=255, description="the same key again answers with the same series"),
    ] = None,
) -> Series:
    """Queue a picture for each sensor, for each set of values, or for each of both: all or none."""
    digest = request_digest(request) if idempotency_key else None
    limits = queue_limits(service.settings)

    def look() -> tuple[list[JobRecord], SceneRecord | None]:
        found = service.jobs.submitted(caller.client_id, idempotency_key, digest)
        if found is not None:
            return service.jobs.series(found.series or ""), None
        limits.check(service.jobs.waiting(), caller.client_id)
        return [], service.scenes.get(request.scene.id, caller.scope) if request.scene.id else None

    def queue(some: list[NewJob]) -> tuple[list[JobRecord], bool]:
        with ExitStack() as stack:
            ledger = service.files.ledger
            keeps = [stack.enter_context(ledger.reserved(new.client_id, job_bytes(new.settings))) for new in some]
            try:
                made, is_new = service.jobs.add_series(some, limits)
            except SceneNotFound as gone:  # deleted since it was looked up
                raise refused("scene.id", f"{gone}; upload it first") from None
            for keep, job in zip(keeps, made, strict=True) if is_new else ():
                keep(job.id)
            return made, is_new

    made, uploaded = await reading(look)
    is_new = False
    if not made:
        some = await members_of(service, request, caller, uploaded)
        some[0] = replace(some[0], idempotency_key=idempotency_key, request_digest=digest)
        made, is_new = await writing(queue, some)
    if is_new:
        await service.hub.tell_transitions()
        service.runner.wake(caller.client_id)
    else:
        response.headers["Idempotency-Replayed"] = "true"
    answer = await _told(service, made)
    response.headers["Location"] = f"/api/series/{answer.id}"
    return answer


@router.get("/{series_id}", responses={404: {}, 422: {}})
async def get_series(jobs: OwnSeries, service: ServiceContext) -> Series:
    """The jobs of a series."""
    return await _told(service, jobs)


@router.post("/{series_id}/cancel", responses={404: {}, 422: {}})
async def cancel_series(caller: Submitter, jobs: OwnSeries, service: ServiceContext) -> Series:
    """End all jobs of a series that have not ended; their pictures so far are kept."""
    for job in jobs:
        with contextlib.suppress(IllegalStep):
            await service.runner.cancel(job.id)
    return await _told(service, await reading(service.jobs.series, jobs[0].series or "", caller.scope))


@router.get("/{series_id}/images.zip", response_class=FileResponse, responses={404: {}, 410: {}, 422: {}, 507: {}})
async def series_zip(jobs: OwnSeries, service: ServiceContext) -> FileResponse:
    """The pictures of all jobs of a series that have one so far, as EXR, with `series.json`: what each is, its error,
    and its readings where it has few pixels.
    """
    shown = [job for job in jobs if job.checkpoint is not None]
    if not shown:
        raise not_found("picture", "No job of this series has a picture yet; ask again later.")
    held: list[tuple[JobRecord, Path]] = []
    archive = service.files.sending / f"series-{jobs[0].series}-{id(held):x}.zip"
    try:
        for job in shown:
            found = await asyncio.to_thread(first_sound, job.kept, service.files.hold)
            if found.value is not None:
                held.append((job, found.value))
        if not held:
            raise ProblemError(410, "estimate-damaged", "The saved pictures are damaged", "Submit the series again.")
        largest = max(job.settings["width"] * job.settings["height"] for job, _ in held)
        async with service.picture_room.taking(READ_BYTES * largest, held[0][0].client_id):
            await asyncio.to_thread(_write_zip, held, archive)
    except OSError:
        archive.unlink(missing_ok=True)
        raise disk_full(None, "write the archive") from None
    finally:
        for _, path in held:
            path.unlink(missing_ok=True)
    return HeldFile(archive, media_type="application/zip", filename=file_name(jobs[0], "series.zip"))


def _write_zip(held: Sequence[tuple[JobRecord, Path]], target: Path) -> None:
    """One picture after the other; EXRs are compressed already."""
    from renderer import Estimate
    from renderer.estimate.readings import readings

    told: list[dict[str, Any]] = []
    picture = target.with_suffix(".exr")
    try:
        with zipfile.ZipFile(target, "w", zipfile.ZIP_STORED) as archive:
            for place, (job, path) in enumerate(held):
                estimate = Estimate.read(path)
                estimate.write_picture(picture, {"job": job.id})
                name = f"{place:04d}-{file_name(job, 'exr')}"
                archive.write(picture, name)
                told.append(_line(job) | {"file": name, "readings": readings(estimate)})
            archive.writestr("series.json", json.dumps(told, indent=1))
    finally:
        picture.unlink(missing_ok=True)


def _line(job: JobRecord) -> dict[str, Any]:
    progress, settings = job.progress, job.settings
    return {
        "job": job.id,
        "name": job.name,
        "state": job.state,
        "sensor": settings.get("sensor"),
        "parameters": settings.get("parameters", {}),
        "error": progress.error,
        "error_upper": progress.error_upper,
        "spp": progress.spp,
        "seconds": progress.seconds,
    }
