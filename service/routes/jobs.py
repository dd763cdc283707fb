"""Jobs: submit, list, get, cancel."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from typing import Annotated

from fastapi import APIRouter, Query, Response

from service.context import Service, ServiceContext
from service.messages import Job, JobDetail, JobList, JobRequest
from service.store import JobRecord
from service.submission import new_job

router = APIRouter(prefix="/api/jobs", tags=["jobs"])


def up_to_date(service: Service, job: JobRecord) -> JobRecord:
    """The stored job with what its running renderer has told since."""
    live = service.runner.live(job.id)
    if live is None or live.record.attempt < job.attempt:
        return job
    return replace(job, progress=live.progress, curve=tuple(live.curve), warnings=live.record.warnings)


def detail_of(service: Service, job_id: str) -> JobDetail:
    """One job as it is now. Raises JobNotFound."""
    job = up_to_date(service, service.jobs.get(job_id))
    queue = service.jobs.queue()
    return JobDetail.of(job, queue_position=queue.index(job_id) + 1 if job_id in queue else None)


@router.post("", status_code=201, responses={422: {}, 429: {}})
async def submit_job(request: JobRequest, service: ServiceContext, response: Response) -> JobDetail:
    """Queue a picture."""
    new = await asyncio.to_thread(new_job, request, service.settings, service.scenes, service.jobs)
    job = await asyncio.to_thread(service.jobs.add, new)
    answer = await asyncio.to_thread(detail_of, service, job.id)
    await service.hub.tell_transitions()
    service.runner.wake()
    response.headers["Location"] = f"/api/jobs/{job.id}"
    return answer


@router.get("")
def list_jobs(service: ServiceContext, limit: Annotated[int, Query(ge=1, le=1000)] = 100) -> JobList:
    """The newest jobs, newest first, without their curves."""
    places = {job_id: place for place, job_id in enumerate(service.jobs.queue(), start=1)}
    jobs = [up_to_date(service, job) for job in service.jobs.newest(limit)]
    return JobList(jobs=[Job.of(job, queue_position=places.get(job.id)) for job in jobs])


@router.get("/{job_id}", responses={404: {}})
def get_job(job_id: str, service: ServiceContext) -> JobDetail:
    """One job with its convergence curve."""
    return detail_of(service, job_id)


@router.post("/{job_id}/cancel", responses={404: {}, 409: {}})
async def cancel_job(job_id: str, service: ServiceContext) -> JobDetail:
    """End a job; its picture so far is kept."""
    await service.runner.cancel(job_id)
    return await asyncio.to_thread(detail_of, service, job_id)
