"""Jobs: submit, list, get, pause, resume, cancel, continue, delete."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from typing import Annotated

from fastapi import APIRouter, Header, Query, Response

from service.access import OwnJob, ReadableJob, Reader, Submitter, up_to_date
from service.context import Service, ServiceContext
from service.errors import refused
from service.messages import ContinueRequest, JobDetail, JobList, JobRequest
from service.states import State, Step, after
from service.store import JobNotFound, JobRecord, SceneNotFound
from service.submission import check_continuation, check_queue, new_job, request_digest

router = APIRouter(prefix="/api/jobs", tags=["jobs"])


def places_of(service: Service) -> dict[str, int]:
    """Places in the queue by job, 1 = next."""
    return {waiting.job_id: place for place, waiting in enumerate(service.jobs.queue(), start=1)}


async def detail_of(service: Service, job_id: str) -> JobDetail:
    """One job as it is now. Raises JobNotFound."""
    return await detail(service, await asyncio.to_thread(service.jobs.get, job_id))


async def detail(service: Service, job: JobRecord) -> JobDetail:
    """A job with its curve and its place in the queue."""
    place = None
    if job.state is State.QUEUED:
        place = (await asyncio.to_thread(places_of, service)).get(job.id)
    return _told(service, job, place)


def _told(service: Service, job: JobRecord, place: int | None) -> JobDetail:
    return JobDetail.of(
        up_to_date(service, job), queue_position=place, expected_start=service.runner.expected_start(place)
    )


@router.post("", status_code=201, responses={422: {}, 429: {}})
async def submit_job(
    request: JobRequest,
    service: ServiceContext,
    caller: Submitter,
    response: Response,
    idempotency_key: Annotated[
        str | None,
        Header(min_length=1, max_length=255, description="the same key again answers with the same job"),
    ] = None,
) -> JobDetail:
    """Queue a picture."""
    digest = request_digest(request) if idempotency_key else None

    def queue() -> tuple[JobRecord, bool, int | None]:
        """The job, whether it is new, and its place. All in one go: every visit to a thread costs."""
        job = service.jobs.submitted(caller.client_id, idempotency_key, digest)
        if job is not None:
            is_new = False
        else:
            new = new_job(request, caller, service.settings, service.scenes, service.jobs)
            new = replace(new, idempotency_key=idempotency_key, request_digest=digest)
            try:
                job, is_new = service.jobs.add(new)
            except SceneNotFound as gone:  # deleted since it was looked up
                raise refused("scene.id", f"{gone}; upload it first") from None
        return job, is_new, places_of(service).get(job.id) if job.state is State.QUEUED else None

    job, is_new, place = await asyncio.to_thread(queue)
    answer = _told(service, job, place)
    if is_new:
        await service.hub.tell_transitions()
        service.runner.wake(job.client_id)
    else:
        response.headers["Idempotency-Replayed"] = "true"
    response.headers["Location"] = f"/api/jobs/{job.id}"
    return answer


@router.get("", response_model=JobList, responses={422: {}})
async def list_jobs(
    service: ServiceContext,
    caller: Reader,
    limit: Annotated[int, Query(ge=1, le=1000)] = 100,
    state: Annotated[list[State], Query(description="only jobs in these states")] = [],  # noqa: B006 - FastAPI copies it
    before: Annotated[str | None, Query(description="id of a job: only older ones", max_length=64)] = None,
) -> Response:
    """The newest jobs, newest first, without their curves; with `before` the last one's id, those after it."""

    def read() -> tuple[list[JobRecord], dict[str, int]]:
        found = service.jobs.newest(limit, caller.scope, states=state, before=before)
        # Only a queue that shows has places to be told.
        return found, places_of(service) if any(job.state is State.QUEUED for job in found) else {}

    try:
        found, places = await asyncio.to_thread(read)
    except JobNotFound as missing:
        raise refused("before", f"{missing}; give the id of a job in the list") from None
    starts = service.runner.expected_starts(places.values())
    told: list[bytes] = []
    for job in found:
        place = places.get(job.id)
        start = None if place is None else starts[place]
        told.append(service.job_texts.text(job, up_to_date(service, job), place, start))
    return Response(b'{"jobs":[' + b",".join(told) + b"]}", media_type="application/json")


@router.get("/{job_id}", responses={404: {}, 422: {}})
async def get_job(job: ReadableJob, service: ServiceContext) -> JobDetail:
    """One job with its convergence curve."""
    return await detail(service, job)


@router.delete("/{job_id}", status_code=204, responses={404: {}, 409: {}, 422: {}})
async def delete_job(job: OwnJob, service: ServiceContext) -> Response:
    """Forget a job that does not run, with its pictures."""
    await service.runner.delete(job.id)
    return Response(status_code=204)


@router.post("/{job_id}/pause", responses={404: {}, 409: {}, 422: {}})
async def pause_job(job: OwnJob, service: ServiceContext) -> JobDetail:
    """Take a queued or running job from the renderer, with all that was rendered, until it is resumed."""
    await service.runner.pause(job.id)
    return await detail_of(service, job.id)


@router.post("/{job_id}/resume", responses={404: {}, 409: {}, 422: {}, 429: {}})
async def resume_job(job: OwnJob, service: ServiceContext) -> JobDetail:
    """Queue a paused job again; it goes on where it was."""
    after(job.state, Step.RESUME)
    await _check_room(service, job)
    await service.runner.move(job.id, Step.RESUME)
    return await detail_of(service, job.id)


@router.post("/{job_id}/cancel", responses={404: {}, 409: {}, 422: {}})
async def cancel_job(job: OwnJob, service: ServiceContext) -> JobDetail:
    """End a job; its picture so far is kept."""
    await service.runner.cancel(job.id)
    return await detail_of(service, job.id)


@router.post("/{job_id}/continue", responses={404: {}, 409: {}, 422: {}, 429: {}})
async def continue_job(job: OwnJob, request: ContinueRequest, service: ServiceContext) -> JobDetail:
    """Queue a succeeded or cancelled job again with a new target; no sample is rendered twice."""
    target = check_continuation(job, request, service.settings)
    await _check_room(service, job)
    changes = {"finished_at": None, "stopped_by": None, "crashes": 0}
    await service.runner.move(job.id, Step.CONTINUE, target=target, **changes)
    return await detail_of(service, job.id)


async def _check_room(service: Service, job: JobRecord) -> None:
    """Whether a job may be queued again. Raises ProblemError."""
    check_queue(await asyncio.to_thread(service.jobs.waiting), job.client_id, service.settings)
