"""What a request may do: the caller by its key, its role, its rate, and the jobs that are its own.

All of that is known from the head of a request: routes that take a body are `HeadFirst`, so that nobody without the
right to send one has it stored.
"""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable, Coroutine, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Annotated, Any

import structlog
from fastapi import Depends, Path, Request, Response
from fastapi.dependencies.models import Dependant
from fastapi.routing import APIRoute
from pydantic import SecretStr

from service.clients import ANYONE, Caller, RateLimit, Role
from service.connections import KNOWN
from service.context import Service, ServiceContext
from service.errors import ProblemError
from service.store import JobNotFound, JobRecord
from service.store.threads import reading

COOKIE = "fredholm_key"
_LARGE_BODY_BYTES = 1 << 20  # more than any job
_PREFIX = len("frd_0123456789")  # of a key: the form and its id, which is no secret
JobId = Annotated[str, Path(pattern="^[0-9a-zA-Z_-]{1,64}$")]
SceneId = Annotated[str, Path(pattern="^[0-9a-zA-Z_-]{1,64}$")]


def key_of(request: Request) -> SecretStr | None:
    """The key that came with a request, in its header or, from the page, in its cookie; None if there is none."""
    scheme, _, key = request.headers.get("authorization", "").partition(" ")
    key = key.strip() if scheme.lower() == "bearer" else request.cookies.get(COOKIE, "")
    return SecretStr(key) if key else None


async def caller_of(request: Request, service: Service) -> Caller:
    """Who asks. Raises ProblemError."""
    if not service.settings.are_keys_required:
        return ANYONE
    caller = await caller_by_key(request, service, key_of(request))
    getattr(request.state, KNOWN, _nobody_asks)()
    structlog.contextvars.bind_contextvars(client=caller.client_id)
    pass_limit(service, service.requests, f"client {caller.client_id}", "requests")
    return caller


def _nobody_asks() -> None:
    """Of a request that did not come over a connection of ours."""


async def caller_by_key(request: Request, service: Service, key: SecretStr | None) -> Caller:
    """Whose key this is. Raises ProblemError, soon with 429 for who guesses."""
    if key is not None and (caller := service.keys.known(key)) is not None:
        return caller
    caller = await reading(service.keys.caller, key) if key is not None else None
    if caller is None:
        address = request.client.host if request.client else ""
        pass_limit(service, service.failed_attempts, f"address {address}", "attempts")
        if key is not None:
            pass_limit(service, service.failed_keys, key.get_secret_value()[:_PREFIX], "attempts with this key")
        detail = "This key opens nothing." if key else "A key is needed: send it as Authorization: Bearer KEY."
        raise ProblemError(
            401, "key-needed", "Who are you?", detail, headers={"WWW-Authenticate": 'Bearer realm="fredholm"'}
        )
    return caller


async def may_still_ask(request: Request, service: Service) -> bool:
    """Whether the key of a request that goes on for long still opens something."""
    if not service.settings.are_keys_required:
        return True
    key = key_of(request)
    return key is not None and await reading(service.keys.caller, key) is not None


def pass_limit(service: Service, limit: RateLimit, who: str, name: str) -> None:
    """Count a request against a limit. Raises ProblemError."""
    wait = limit.take(who)
    if wait > 0:
        service.metrics.refusals.labels(name).inc()
        seconds = math.ceil(wait)
        detail = f"Too many {name}; ask again in {seconds} s."
        raise ProblemError(429, "too-many", "Too many requests", detail, headers={"Retry-After": str(seconds)})


class _AtLeast:
    """A dependency: the caller, who must have this role."""

    def __init__(self, role: Role) -> None:
        self.role = role

    async def __call__(self, request: Request, service: ServiceContext) -> Caller:
        caller: Caller | None = getattr(request.state, "caller", None)  # known from the head already
        if caller is None:
            caller = request.state.caller = await caller_of(request, service)
        if caller.role < self.role:
            detail = f"This needs the role {self.role.name.lower()}; your key has the role {caller.role.name.lower()}."
            raise ProblemError(403, "role-needed", "Not allowed", detail)
        return caller


def _checks_of(dependant: Dependant) -> Iterator[_AtLeast]:
    for inner in dependant.dependencies:
        if isinstance(inner.call, _AtLeast):
            yield inner.call
        yield from _checks_of(inner)


class HeadFirst(APIRoute):
    """A route that looks at the caller before it takes a byte of the body, which FastAPI would read and store first."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """The handler, behind the checks that its dependencies ask for."""
        handle, checks = super().get_route_handler(), tuple(_checks_of(self.dependant))

        async def checked(request: Request) -> Response:
            service: Service = request.app.state.service
            for check in checks:
                await check(request, service)
            with _place_for_body(request, service):
                return await handle(request)

        return checked


@contextmanager
def _place_for_body(request: Request, service: Service) -> Iterator[None]:
    """A place among the large bodies that its client sends, until it is answered. Raises ProblemError."""
    length = request.headers.get("content-length", "")
    is_large = "transfer-encoding" in request.headers or (length.isdigit() and int(length) > _LARGE_BODY_BYTES)
    caller: Caller | None = getattr(request.state, "caller", None)
    if caller is None or not is_large:
        yield
        return
    sending, most = service.bodies, service.settings.max_bodies_of_client
    if sending[caller.client_id] >= most:
        detail = f"{most} large requests of yours are on their way; send this one when one of them has its answer."
        raise ProblemError(429, "too-many", "Too many requests at a time", detail, headers={"Retry-After": "5"})
    sending[caller.client_id] += 1
    try:
        yield
    finally:
        sending[caller.client_id] -= 1
        if not sending[caller.client_id]:
            del sending[caller.client_id]


NEEDS_READER = Depends(_AtLeast(Role.READ))
Reader = Annotated[Caller, Depends(_AtLeast(Role.READ))]
Submitter = Annotated[Caller, Depends(_AtLeast(Role.SUBMIT))]
Admin = Annotated[Caller, Depends(_AtLeast(Role.ADMIN))]


def up_to_date(service: Service, job: JobRecord) -> JobRecord:
    """The stored job with what its running renderer has told since."""
    live = service.runner.live(job.id)
    if live is None or live.record.attempt < job.attempt:
        return job
    newest, earlier = (*live.kept, None, None)[:2]
    known = {"progress": live.progress, "warnings": live.record.warnings, "losses": live.record.losses}
    known |= {"checkpoint": newest and newest.name, "checkpoint_digest": newest and newest.digest, "earlier": earlier}
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
        return up_to_date(service, await reading(own_job, service, caller, job_id))

    return find


# A job that the caller may read, and one that it may change.
ReadableJob = Annotated[JobRecord, Depends(_own_job_of(_AtLeast(Role.READ)))]
OwnJob = Annotated[JobRecord, Depends(_own_job_of(_AtLeast(Role.SUBMIT)))]
