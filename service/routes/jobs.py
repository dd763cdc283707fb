"""Jobs: submit, list, get, pause, resume, cancel, continue, delete."""

from __future__ import annotations

import asyncio
import json
from dataclasses import replace
from typing import Annotated

from fastapi import APIRouter, Header, Query, Response
from pydantic import ValidationError

from service.access import HeadFirst, OwnJob, ReadableJob, Reader, Submitter, up_to_date
from service.context import Service, ServiceContext
from service.errors import refused
from service.messages import ContinueRequest, JobDetail, JobList, JobRequest, UnreadableRow
from service.room import job_bytes
from service.states import State, Step, after
from service.store import JobNotFound, JobRecord, NewJob, RowUnreadable, SceneNotFound, SceneRecord
from service.store.threads import reading, writing
from service.submission import (
    check_continuation,
    check_disk,
    check_memory,
    new_job,
    queue_limits,
    request_digest,
    texts_of,
)

router = APIRouter(prefix="/api/jobs", tags=["jobs"], route_class=HeadFirst)


def places_of(service: Service) -> dict[str, int]:
    """Places in the queue by job, 1 = next."""
    return {waiting.job_id: place for place, waiting in enumerate(service.jobs.queue(), start=1)}


async def detail_of(service: Service, job_id: str) -> JobDetail:
    """One job as it is now. Raises JobNotFound."""
    return await detail(service, await reading(service.jobs.get, job_id))


async def detail(service: Service, job: JobRecord) -> JobDetail:
    """A job with its curve and its place in the queue."""
    place = None
    if job.state is State.QUEUED:
        place = (await reading(places_of, service)).get(job.id)
    return _told(service, job, place)


def _told(service: Service, job: JobRecord, place: int | None) -> JobDetail:
    try:
        return JobDetail.of(
            up_to_date(service, job),
            queue_position=place,
            expected_start=service.runner.expected_start(place),
            waits_for=service.runner.waits_for(job),
        )
    except ValidationError as error:
        raise _unreadable(job, error) from error


def _unreadable(job: JobRecord, error: ValidationError) -> RowUnreadable:
    first = error.errors()[0]
    return RowUnreadable("job", job.id, f"{'.'.join(map(str, first['loc']))}: {first['msg']}")


@router.post("", status_code=201, responses={410: {}, 422: {}, 429: {}, 507: {}})
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
    limits = queue_limits(service.settings)

    def look() -> tuple[JobRecord | None, SceneRecord | None]:
        """The job that was queued with this key before, and the scene, if it is an uploaded one."""
        job = service.jobs.submitted(caller.client_id, idempotency_key, digest)
        if job is None:
            # Said at once where it is plain; what counts is how it stands when the job is queued.
            limits.check(service.jobs.waiting(), caller.client_id)
        return job, service.scenes.get(request.scene.id, caller.scope) if job is None and request.scene.id else None

    def queue(new: NewJob) -> tuple[JobRecord, bool, int | None]:
        """The job, whether it is new, and its place. All in one go: every visit to a thread costs."""
        with service.files.ledger.reserved(new.client_id, job_bytes(new.settings)) as keep:
            try:
                job, is_new = service.jobs.add(new, limits)
            except SceneNotFound as gone:  # deleted since it was looked up
                raise refused("scene.id", f"{gone}; upload it first") from None
            if is_new:
                keep(job.id)
        return job, is_new, places_of(service).get(job.id) if job.state is State.QUEUED else None

    job, uploaded = await reading(look)
    if job is not None:
        is_new = False
        place = (await reading(places_of, service)).get(job.id) if job.state is State.QUEUED else None
    else:
        # A large scene takes long to be verified: no transaction and no deadline waits for that.
        rules = (service.settings, service.uploads, service.disk, service.accountant)
        told = None
        if uploaded is not None and (parameters := texts_of(request)):
            told = await service.uploads.with_parameters(uploaded, parameters, caller.client_id)
        new = await asyncio.to_thread(new_job, request, caller, uploaded, *rules, told)
        new = replace(new, idempotency_key=idempotency_key, request_digest=digest)
        job, is_new, place = await writing(queue, new)
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

    def read() -> tuple[list[JobRecord], int, dict[str, int]]:
        found = service.jobs.newest(limit, caller.scope, states=state, before=before)
        is_whole = before is None and len(found) < limit
        total = len(found) if is_whole else service.jobs.count(caller.scope, state)
        # Only a queue that shows has places to be told.
        return found, total, places_of(service) if any(job.state is State.QUEUED for job in found) else {}

    try:
        found, total, places = await reading(read)
    except JobNotFound as missing:
        raise refused("before", f"{missing}; give the id of a job in the list") from None
    starts = service.runner.expected_starts(places.values())
    told: list[bytes] = []
    for job in found:
        place = places.get(job.id)
        start = None if place is None else starts[place]
        try:
            held = service.runner.waits_for(job)
            told.append(service.job_texts.text(job, up_to_date(service, job), place, start, held))
        except ValidationError as error:
            service.jobs.note_unreadable(_unreadable(job, error))
    body = b'{"jobs":[' + b",".join(told) + b'],"total":' + str(total).encode()
    if caller.scope is None and (bad := service.jobs.unreadable()):
        rows = [UnreadableRow(id=job_id, reason=reason).model_dump() for job_id, reason in bad.items()]
        body += b',"unreadable":' + json.dumps(rows).encode()
    return Response(body + b"}", media_type="application/json")


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
    await service.runner.move(job.id, Step.RESUME, limits=queue_limits(service.settings))
    return await detail_of(service, job.id)


@router.post("/{job_id}/cancel", responses={404: {}, 409: {}, 422: {}})
async def cancel_job(job: OwnJob, service: ServiceContext) -> JobDetail:
    """End a job; its picture so far is kept."""
    await service.runner.cancel(job.id)
    return await detail_of(service, job.id)


@router.post("/{job_id}/continue", responses={404: {}, 409: {}, 422: {}, 429: {}, 507: {}})
async def continue_job(job: OwnJob, request: ContinueRequest, service: ServiceContext) -> JobDetail:
    """Queue a job that has ended again with a new target; no sample is rendered twice."""
    target = check_continuation(job, request, service.settings)
    await asyncio.to_thread(check_disk, job.settings, service.disk)
    await asyncio.to_thread(check_memory, service.need_of(job), service.accountant)
    changes = {"finished_at": None, "stopped_by": None, "cause": None, "crashes": 0}
    limits = queue_limits(service.settings)
    with service.files.ledger.reserved(job.client_id, job_bytes(job.settings), job.id) as keep:
        await service.runner.move(job.id, Step.CONTINUE, limits=limits, target=target, **changes)
        keep(job.id)
    return await detail_of(service, job.id)
