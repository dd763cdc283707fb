"""A browser cannot send a key with every picture, so the page exchanges it for a cookie that scripts cannot read."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Form, Request, Response
from fastapi.responses import HTMLResponse, RedirectResponse
from pydantic import SecretStr

from service.access import COOKIE, Reader, caller_by_key
from service.context import ServiceContext
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
async def login(request: Request, service: ServiceContext, key: Annotated[SecretStr, Form(max_length=200)]) -> Response:
    """Take the form and go to the page."""
    key = SecretStr(key.get_secret_value().strip())
    session = await _check(request, service, key)
    response = RedirectResponse("./", status_code=303)
    if session.keys_required:
        _set_cookie(request, response, key)
    return response


async def _check(request: Request, service: ServiceContext, key: SecretStr) -> Session:
    if not service.settings.are_keys_required:
        return Session(client=None, role="admin", keys_required=False)
    caller = await caller_by_key(request, service, key)
    return Session(client=caller.client_id, role=caller.role.name.lower(), keys_required=True)  # type: ignore[arg-type]


def _set_cookie(request: Request, response: Response, key: SecretStr) -> None:
    response.set_cookie(
        COOKIE,
        key.get_secret_value(),
        max_age=_DAYS * 86400,
        httponly=True,
        samesite="strict",
        secure=request.url.scheme == "https",
    )
