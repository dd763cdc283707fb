"""The application.

Importing this module does nothing; `create_app` puts the parts together, its lifespan starts them.
"""

from __future__ import annotations

import functools
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from fastapi import FastAPI

from service import errors, openapi
from service.context import Service
from service.headers import SecurityHeaders
from service.page import Page
from service.polls import NothingNewer
from service.requests import RequestLog
from service.routes import (
    docs,
    events,
    extremes,
    frames,
    gallery,
    health,
    integral,
    jobs,
    learn,
    scenes,
    series,
    session,
)
from service.settings import ServiceSettings

API_VERSION = "1"
LOOPBACK_NAMES = ("localhost", "127.0.0.1", "::1")


def create_app(settings: ServiceSettings) -> FastAPI:
    """The service as an ASGI application."""

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        service = app.state.service = Service(settings)
        await service.start()
        try:
            yield
        finally:
            await service.stop()

    app = FastAPI(
        title="Fredholm",
        summary="Monte Carlo rendering that answers with error bars",
        version=API_VERSION,
        lifespan=lifespan,
        docs_url=None,
        redoc_url=None,
        openapi_url="/api/openapi.json",
    )
    protect(app, settings)
    for module in (gallery, scenes, jobs, series, frames, events, learn, integral, extremes, health, session, docs):
        app.include_router(module.router)
    app.mount("/", Page(settings.static_dir, settings.are_keys_required), name="page")
    app.openapi = functools.partial(openapi.describe, app)
    return app


def protect(app: FastAPI, settings: ServiceSettings) -> None:
    """What every request passes on its way in, and every answer on its way out."""
    errors.install(app)
    hosts = None if settings.are_keys_required else frozenset({*LOOPBACK_NAMES, settings.host.lower()})
    # The last one added is the outermost.
    app.add_middleware(NothingNewer)
    app.add_middleware(errors.Unforeseen)
    app.add_middleware(
        errors.RequestGuard,
        max_body_bytes=settings.max_body_bytes,
        max_message_bytes=settings.max_message_bytes,
        hosts=hosts,
        are_keys_required=settings.are_keys_required,
    )
    app.add_middleware(SecurityHeaders)
    app.add_middleware(RequestLog)
