"""The API's description for people."""

from __future__ import annotations

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, Response

from service.reference import STYLE, reference

router = APIRouter(include_in_schema=False)


@router.get("/docs")
def docs(request: Request) -> HTMLResponse:
    """All operations and messages."""
    return HTMLResponse(reference(request.app.openapi()), headers={"Cache-Control": "no-cache"})


@router.get("/docs.css")
def style() -> Response:
    """The style of the plain pages."""
    return Response(STYLE, media_type="text/css", headers={"Cache-Control": "no-cache"})
