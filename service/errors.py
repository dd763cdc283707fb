"""Errors as RFC 9457 problem bodies. No answer carries a trace or a path of this machine."""

from __future__ import annotations

import asyncio
from http import HTTPStatus
from typing import Any

import structlog
from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from sqlalchemy.exc import InterfaceError, OperationalError
from sqlalchemy.exc import TimeoutError as PoolTimeout
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.accountant import QuotaReached
from service.messages import FieldError, Problem
from service.origin import why_foreign
from service.room import Shortage, is_full
from service.states import IllegalStep
from service.store import (
    DatabaseReplaced,
    JobNotFound,
    KeyUsedOtherwise,
    QueueFull,
    RowUnreadable,
    SceneDamaged,
    SceneNotFound,
    SceneStillNeeded,
    StillRunning,
)
from service.without_paths import without_paths

MEDIA_TYPE = "application/problem+json"
UPLOADS = "/api/scenes"  # the one address that takes long bodies
_TOLD_FIELDS, _TOLD_NAME = 20, 200
_SECRET_FIELDS = frozenset({"key"})  # whose values no answer repeats
log = structlog.get_logger("service.errors")


class ProblemError(Exception):
    """An answer that is a problem: raise it from anywhere in a request."""

    def __init__(
        self,
        status: int,
        kind: str,
        title: str,
        detail: str,
        errors: list[FieldError] | None = None,
        headers: dict[str, str] | None = None,
    ) -> None:
        self.headers = headers
        self.problem = Problem(type=f"urn:fredholm:{kind}", title=title, status=status, detail=detail, errors=errors)
        super().__init__(detail)


def not_found(what: str, detail: str) -> ProblemError:
    """404 with what was looked for."""
    return ProblemError(404, "not-found", f"No such {what}", detail)


def refused(field: str, message: str) -> ProblemError:
    """422 for one field of a request."""
    errors = [FieldError(field=field, message=message)]
    return ProblemError(422, "invalid-request", "The request is not valid", f"{field}: {message}", errors)


def too_large(limit_bytes: int, setting: str) -> ProblemError:
    """413 with the limit and the setting that it comes from."""
    limit = f"{limit_bytes / 2**20:g} MiB"
    detail = f"The body is larger than {limit}, the limit here; send less, or raise FREDHOLM_{setting.upper()}."
    return ProblemError(413, "too-large", "The request is too large", detail)


def disk_full(shortage: Shortage | None, what: str) -> ProblemError:
    """507: the disk has no room. shortage: None if there is room again by now."""
    detail = f"To {what}, {shortage}." if shortage else f"The disk was too full to {what}."
    detail += " Delete jobs or scenes that are not needed, or have the operator make room; then ask again."
    return ProblemError(507, "disk-full", "The disk is full", detail, headers={"Retry-After": "60"})


def answer(problem: Problem, headers: dict[str, str] | None = None) -> JSONResponse:
    """A problem as a response."""
    body = problem.model_dump(exclude_none=True)
    return JSONResponse(body, status_code=problem.status, media_type=MEDIA_TYPE, headers=headers)


async def _on_problem(_request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, ProblemError)
    return answer(error.problem, error.headers)


async def _on_invalid(_request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, RequestValidationError)
    errors = [_field_error(one) for one in error.errors()[:_TOLD_FIELDS]]
    detail = "; ".join(f"{one.field}: {one.message}" for one in errors[:5])
    return answer(
        Problem(
            type="urn:fredholm:invalid-request",
            title="The request is not valid",
            status=422,
            detail=detail,
            errors=errors,
        )
    )


def _field_error(error: dict[str, Any]) -> FieldError:
    place = [str(part) for part in error["loc"] if part not in ("body", "query", "path", "header")]
    if error["type"] == "json_invalid":
        return FieldError(field="body", message=f"not valid JSON: {error.get('ctx', {}).get('error', 'unreadable')}")
    message = str(error["msg"]).removeprefix("Value error, ")
    value = error.get("input")
    is_told = isinstance(value, str | int | float) and error["type"] != "value_error"
    if is_told and not _SECRET_FIELDS.intersection(place):
        message = f"{message} (got {str(value)[:60]!r})" if isinstance(value, str) else f"{message} (got {value})"
    return FieldError(field=".".join(place)[:_TOLD_NAME] or "body", message=message)


async def _on_http(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, HTTPException)
    if error.__cause__ is not None and is_full(error.__cause__):
        # FastAPI calls whatever happens while a body is stored a bad request.
        return await _on_problem(request, disk_full(None, "take in what was sent"))
    phrase = HTTPStatus(error.status_code).phrase
    details = {404: "There is nothing at this address.", 405: "This address does not take that method."}
    detail = error.detail if error.detail != phrase else details.get(error.status_code, phrase)
    response = answer(
        Problem(type="about:blank", title=phrase, status=error.status_code, detail=str(detail), errors=None)
    )
    response.headers.update(error.headers or {})
    return response


async def _on_missing_job(_request: Request, error: Exception) -> JSONResponse:
    return answer(not_found("job", f"{error}.".capitalize()).problem)


async def _on_missing_scene(_request: Request, error: Exception) -> JSONResponse:
    return answer(not_found("scene", f"{error}.".capitalize()).problem)


async def _on_needed_scene(_request: Request, error: Exception) -> JSONResponse:
    return answer(ProblemError(409, "scene-needed", "The scene is still needed", f"{error}.".capitalize()).problem)


async def _on_full_queue(_request: Request, error: Exception) -> JSONResponse:
    problem = ProblemError(429, "queue-full", "The queue is full", f"{error}.").problem
    return answer(problem, {"Retry-After": "30"})


async def _on_quota(_request: Request, error: Exception) -> JSONResponse:
    detail = f"{error}, or have FREDHOLM_MAX_ESTIMATES_BYTES raised."
    return answer(ProblemError(507, "no-room", "There is no room for the picture", detail).problem)


async def _on_unreadable_row(_request: Request, error: Exception) -> JSONResponse:
    detail = f"{error}; a newer version may have written it.".capitalize()
    return answer(ProblemError(409, "unreadable", "This version cannot read that", detail).problem)


async def _on_illegal_step(_request: Request, error: Exception) -> JSONResponse:
    detail = f"{error}.".capitalize()
    return answer(ProblemError(409, "wrong-state", "The job is in another state", detail).problem)


async def _on_key_used_otherwise(_request: Request, error: Exception) -> JSONResponse:
    detail = f"{error}.".capitalize()
    errors = [FieldError(field="Idempotency-Key", message=detail)]
    return answer(ProblemError(422, "idempotency-key-reused", "The key was used before", detail, errors).problem)


async def _on_damaged_scene(_request: Request, error: Exception) -> JSONResponse:
    detail = f"{error}; upload the same scene again, which puts them back.".capitalize()
    return answer(ProblemError(410, "scene-damaged", "The scene's files are damaged", detail).problem)


async def _on_lost_database(request: Request, error: Exception) -> JSONResponse:
    if is_full(error):
        return await _on_problem(request, disk_full(None, "record that in the database"))
    log.error("the database does not answer", cause=type(error).__name__)
    detail = "The service's database does not answer; ask again in a moment."
    problem = ProblemError(503, "database-unavailable", "The database does not answer", detail).problem
    return answer(problem, {"Retry-After": "2"})


async def _on_replaced_database(_request: Request, error: Exception) -> JSONResponse:
    detail = f"{without_paths(str(error))}; nothing can be taken until its operator has put that right.".capitalize()
    problem = ProblemError(503, "database-replaced", "The database is not the one of this service", detail).problem
    return answer(problem, {"Retry-After": "60"})


def _mistake() -> JSONResponse:
    detail = "The service made a mistake; its log says more. Trying again may help."
    return answer(ProblemError(500, "internal", "Internal error", detail).problem)


def _cut() -> JSONResponse:
    detail = "The service ended before this had its answer, and nothing was acknowledged; ask again once it is back."
    problem = ProblemError(503, "stopping", "The service is stopping", detail, headers={"Retry-After": "5"})
    return answer(problem.problem, problem.headers)


def install(app: FastAPI) -> None:
    """Let every error of the app end as a problem body."""
    app.add_exception_handler(ProblemError, _on_problem)
    app.add_exception_handler(RequestValidationError, _on_invalid)
    app.add_exception_handler(HTTPException, _on_http)
    app.add_exception_handler(JobNotFound, _on_missing_job)
    app.add_exception_handler(SceneNotFound, _on_missing_scene)
    app.add_exception_handler(RowUnreadable, _on_unreadable_row)
    app.add_exception_handler(SceneDamaged, _on_damaged_scene)
    app.add_exception_handler(QuotaReached, _on_quota)
    app.add_exception_handler(QueueFull, _on_full_queue)
    app.add_exception_handler(SceneStillNeeded, _on_needed_scene)
    app.add_exception_handler(IllegalStep, _on_illegal_step)
    app.add_exception_handler(StillRunning, _on_illegal_step)
    app.add_exception_handler(KeyUsedOtherwise, _on_key_used_otherwise)
    app.add_exception_handler(DatabaseReplaced, _on_replaced_database)
    for lost in (OperationalError, InterfaceError, PoolTimeout):
        app.add_exception_handler(lost, _on_lost_database)


class Unforeseen:
    """Answers what no handler knows.

    Innermost, so that such an answer gets its headers, its id and its place in the figures like any other.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        has_begun = False

        async def noted(message: Message) -> None:
            nonlocal has_begun
            has_begun = True
            await send(message)

        try:
            await self._app(scope, receive, noted)
        except Exception:
            if scope["type"] != "http":
                raise
            log.exception("request failed", method=scope["method"], path=shown_path(scope))
            # One that has begun stays without its end, and the connection is cut: whoever reads must not take half an
            # answer for a whole one.
            if not has_begun:
                await _mistake()(scope, receive, send)
        except asyncio.CancelledError:
            # The end of the service does not wait for what takes long.
            if scope["type"] != "http" or has_begun:
                raise
            await _cut()(scope, receive, send)


class RequestGuard:
    """Refuses bodies over the limit while they arrive, and what foreign web pages ask for.

    hosts: names under which the service may be asked; None: any. Where no key is needed, a page of another site could
    otherwise give its own name this machine's address, and ask as if it were ours.
    """

    def __init__(
        self,
        app: ASGIApp,
        max_body_bytes: int,
        max_message_bytes: int,
        hosts: frozenset[str] | None,
        are_keys_required: bool,
    ) -> None:
        self._app = app
        self._are_keys_required = are_keys_required
        self._max_body_bytes = max_body_bytes
        self._max_message_bytes = max_message_bytes
        self._hosts = hosts

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            return await self._app(scope, receive, send)
        request = Request(scope)
        if self._hosts is not None and _host_name(request) not in self._hosts:
            detail = "Without keys this service answers to names of this machine only: set FREDHOLM_API_KEYS=on."
            problem = ProblemError(421, "unknown-host", "Asked under an unknown name", detail).problem
            return await answer(problem)(scope, receive, send)
        if (foreign := why_foreign(request, self._are_keys_required)) is not None:
            problem = ProblemError(403, "cross-site", "Refused for pages of other sites", foreign).problem
            return await answer(problem)(scope, receive, send)
        # JSON grows twentyfold when it is read, and nothing else happens meanwhile: only uploads may be long.
        is_upload = scope["path"] == UPLOADS
        limit = self._max_body_bytes if is_upload else self._max_message_bytes
        refusal = too_large(limit, "max_body_bytes" if is_upload else "max_message_bytes").problem
        length = request.headers.get("content-length", "")
        if length.isdecimal() and int(length) > limit:
            return await answer(refusal)(scope, receive, send)

        received = 0

        async def counted() -> Message:
            nonlocal received
            message = await receive()
            received += len(message.get("body", b""))
            if received > limit:
                # An HTTPException, because FastAPI lets only those through while it reads a body.
                raise HTTPException(413, detail=refusal.detail)
            return message

        await self._app(scope, counted, send)


def shown_path(scope: Scope) -> str:
    """The path as it was sent, short: decoded, it could write lines of its own into a log."""
    path: bytes = scope.get("raw_path") or scope["path"].encode()
    return path[:200].decode("ascii", errors="backslashreplace")


def _host_name(request: Request) -> str:
    """The name under which the service was asked, without its port."""
    host = request.headers.get("host", "").lower()
    return host[1:].partition("]")[0] if host.startswith("[") else host.partition(":")[0]
