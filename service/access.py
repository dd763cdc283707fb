"""What a request may do: the caller by its key, its role, its rate, and the jobs that are its own."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable
from dataclasses import replace
from typing import Annotated

import structlog
from fastapi import Depends, Path, Request

from service.clients import ANYONE, Caller, RateLimit, Role
from service.context import Service, ServiceContext
from service.errors import ProblemError
from service.store import JobNotFound, JobRecord

COOKIE = "fredholm_key"
JobId = Annotated[str, Path(pattern="^[0-9a-zA-Z_-]{1,64}$")]
SceneId = Annotated[str, Path(pattern="^[0-9a-zA-Z_-]{1,64}$")]


def key_of(request: Request) -> str | None:
    """The key that came with a request, in its header or, from the page, in its cookie."""
    scheme, _, key = request.headers.get("authorization", "").partition(" ")
    return key.strip() if scheme.lower() == "bearer" else request.cookies.get(COOKIE)


async def caller_of(request: Request, service: Service) -> Caller:
    """Who asks. Raises ProblemError."""
    if not service.settings.are_keys_required:
        return ANYONE
    address = request.client.host if request.client else ""
    key = key_of(request)
    caller = (service.keys.known(key) or await asyncio.to_thread(service.keys.caller, key)) if key else None
    if caller is None:
        pass_limit(service, service.failed_attempts, f"address {address}", "attempts")
        detail = "This key opens nothing." if key else "A key is needed: send it as Authorization: Bearer KEY."
        raise ProblemError(
            401, "key-needed", "Who are you?", detail, headers={"WWW-Authenticate": 'Bearer realm="fredholm"'}
        )
    structlog.contextvars.bind_contextvars(client=caller.client_id)
    pass_limit(service, service.requests, f"client {caller.client_id}", "requests")
    return caller


async def may_still_ask(request: Request, service: Service) -> bool:
    """Whether the key of a request that goes on for long still opens something."""
    if not service.settings.are_keys_required:
        return True
    key = key_of(request)
    return key is not None and await asyncio.to_thread(service.keys.caller, key) is not None


def pass_limit(service: Service, limit: RateLimit, who: str, name: str) -> None:
    """Count a request against a limit. Raises ProblemError."""
    wait = limit.take(who)
    if wait > 0:
        service.metrics.refusals.labels(name).inc()
        seconds = math.ceil(wait)
        detail = f"Too many {name}; ask again in {seconds} s."
        raise ProblemError(429, "too-many", "Too many requests", detail, headers={"Retry-After": str(seconds)})


def _at_least(role: Role) -> Callable[[Request, Service], Awaitable[Caller]]:
    async def check(request: Request, service: ServiceContext) -> Caller:
        caller = await caller_of(request, service)
        if caller.role < role:
            detail = f"This needs the role {role.name.lower()}; your key has the role {caller.role.name.lower()}."
            raise ProblemError(403, "role-needed", "Not allowed", detail)
        return caller

    return check


NEEDS_READER = Depends(_at_least(Role.READ))
Reader = Annotated[Caller, Depends(_at_least(Role.READ))]
Submitter = Annotated[Caller, Depends(_at_least(Role.SUBMIT))]
Admin = Annotated[Caller, Depends(_at_least(Role.ADMIN))]


def up_to_date(service: Service, job: JobRecord) -> JobRecord:
    """The stored job with what its running renderer has told since."""
    live = service.runner.live(job.id)
    if live is None or live.record.attempt < job.attempt:
        return job
    known = {"progress": live.progress, "checkpoint": live.checkpoint, "warnings": live.record.warnings}
    return replace(job, curve=tuple(live.curve), **known)


def own_job(service: Service, caller: Caller, job_id: str) -> JobRecord:
    """A job of the caller. Someone else's is as unknown as one that never was. Raises JobNotFound."""
    job = service.jobs.get(job_id)
    _check_own(caller, job)
    return job


def _check_own(caller: Caller, job: JobRecord) -> None:
    if caller.scope not in (None, job.client_id):
        raise JobNotFound(job.id)


def _own_job_of(dependency: Callable[[Request, Service], Awaitable[Caller]]) -> Callable[..., Awaitable[JobRecord]]:
    asks = Depends(dependency)

    async def find(job_id: JobId, service: ServiceContext, caller: Caller = asks) -> JobRecord:
        # Pages ask for the frames of running jobs all the time: those need no database.
        if (live := service.runner.live(job_id)) is not None:
            _check_own(caller, live.record)
            return up_to_date(service, live.record)
        return up_to_date(service, await asyncio.to_thread(own_job, service, caller, job_id))

    return find


# A job that the caller may read, and one that it may change.
ReadableJob = Annotated[JobRecord, Depends(_own_job_of(_at_least(Role.READ)))]
OwnJob = Annotated[JobRecord, Depends(_own_job_of(_at_least(Role.SUBMIT)))]
