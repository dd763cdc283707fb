"""A browser cannot send a key with every picture, so the page exchanges it for a cookie that scripts cannot read."""

from __future__ import annotations

import asyncio
from typing import Annotated

from fastapi import APIRouter, Form, Request, Response
from fastapi.responses import HTMLResponse, RedirectResponse

from service.access import COOKIE, Reader, pass_limit
from service.context import ServiceContext
from service.errors import ProblemError
from service.messages import Session, SessionRequest
from service.reference import page

router = APIRouter(tags=["session"])

_LOGIN = page(
    "Fredholm",
    '<h1>Fredholm</h1><form method="post" action="login"><label>API key'
    '<input type="password" name="key" autocomplete="current-password" required autofocus></label>'
    "<button>Open</button></form><p>Whoever runs this service creates keys with <code>fredholm key create</code>.</p>",
)
_DAYS = 30


@router.get("/api/session", responses={401: {}})
async def who_am_i(caller: Reader, service: ServiceContext) -> Session:
    """Who asks, and what may be asked."""
    return Session(
        client=caller.client_id or None,
        role=caller.role.name.lower(),  # type: ignore[arg-type]
        keys_required=service.settings.are_keys_required,
    )


@router.post("/api/session", responses={401: {}, 422: {}, 429: {}})
async def log_in(body: SessionRequest, request: Request, response: Response, service: ServiceContext) -> Session:
    """Keep a key in a cookie of this browser."""
    session = await _check(request, service, body.key)
    if session.keys_required:
        _set_cookie(request, response, body.key)
    return session


@router.delete("/api/session", status_code=204)
async def log_out() -> Response:
    """Forget the key."""
    response = Response(status_code=204)
    response.delete_cookie(COOKIE)
    return response


@router.get("/login", include_in_schema=False)
async def login_page() -> HTMLResponse:
    """A form for the key, for browsers."""
    return HTMLResponse(_LOGIN)


@router.post("/login", include_in_schema=False)
async def login(request: Request, service: ServiceContext, key: Annotated[str, Form(max_length=200)]) -> Response:
    """Take the form and go to the page."""
    session = await _check(request, service, key.strip())
    response = RedirectResponse("./", status_code=303)
    if session.keys_required:
        _set_cookie(request, response, key.strip())
    return response


async def _check(request: Request, service: ServiceContext, key: str) -> Session:
    if not service.settings.are_keys_required:
        return Session(client=None, role="admin", keys_required=False)
    caller = await asyncio.to_thread(service.keys.caller, key)
    if caller is None:
        pass_limit(
            service, service.failed_attempts, f"address {request.client.host if request.client else ''}", "attempts"
        )
        raise ProblemError(401, "key-needed", "Who are you?", "This key opens nothing.")
    return Session(client=caller.client_id, role=caller.role.name.lower(), keys_required=True)  # type: ignore[arg-type]


def _set_cookie(request: Request, response: Response, key: str) -> None:
    response.set_cookie(
        COOKIE,
        key,
        max_age=_DAYS * 86400,
        httponly=True,
        samesite="strict",
        secure=request.url.scheme == "https",
    )
