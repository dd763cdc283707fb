"""An id, a log line and a figure for every request."""

from __future__ import annotations

import re
import secrets
import time

import structlog
from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.errors import shown_path

_SLOW_SECONDS = 1.0
_ID = re.compile(r"[A-Za-z0-9._-]{1,64}")
_log = structlog.get_logger("service.requests")


class RequestLog:
    """Binds a request id to all that is logged on the way, and answers with it as X-Request-ID."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            return await self._app(scope, receive, send)
        given = Headers(scope=scope).get("x-request-id", "")
        request_id = given if _ID.fullmatch(given) else secrets.token_hex(8)
        structlog.contextvars.clear_contextvars()
        structlog.contextvars.bind_contextvars(request=request_id)
        began = time.perf_counter()

        async def counted(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message)["X-Request-ID"] = request_id
                seconds, status = time.perf_counter() - began, message["status"]
                method = scope["method"] if scope["method"] in ("GET", "POST", "DELETE", "HEAD") else "OTHER"
                service = getattr(scope["app"].state, "service", None) if "app" in scope else None
                if service is not None:
                    service.metrics.answers.labels(method, str(status)).observe(seconds)
                # Changes are news; polling for frames is not.
                level = "info" if method in ("POST", "DELETE") else "debug"
                level = "warning" if seconds > _SLOW_SECONDS or status >= 500 else level
                told = {"method": method, "path": shown_path(scope), "status": status, "ms": round(1000 * seconds, 1)}
                getattr(_log, level)("request", **told)
            await send(message)

        await self._app(scope, receive, counted)
