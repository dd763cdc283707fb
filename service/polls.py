"""The question that pages ask most, answered before any routing: is there a newer frame? Mostly there is none.

Each page asks twice a second for a job that has its turn every few seconds. What is not answered here goes on to the
route of frames, which says the same of everything else.
"""

from __future__ import annotations

import re

from starlette.requests import Request
from starlette.responses import Response
from starlette.types import ASGIApp, Receive, Scope, Send

from service.access import caller_of
from service.context import Service
from service.errors import ProblemError, answer

_PATH = re.compile(r"/api/jobs/([0-9a-zA-Z_-]{1,64})/frames/latest")
_QUERY = re.compile(rb"(?:(?:scale=[12]|maps=[01])&)*after=([0-9]{1,15})(?:&(?:scale=[12]|maps=[01]))*")


class NothingNewer:
    """Answers 204 for a running job without a newer frame than the one at hand."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        is_get = scope["type"] == "http" and scope["method"] == "GET"
        path = _PATH.fullmatch(scope["path"]) if is_get else None
        response = await self._answer(scope, path[1]) if path is not None else None
        await (response or self._app)(scope, receive, send)

    async def _answer(self, scope: Scope, job_id: str) -> Response | None:
        service: Service = scope["app"].state.service
        live, query = service.runner.live(job_id), _QUERY.fullmatch(scope["query_string"])
        if live is None or query is None or (seq := live.progress.frame_seq) > int(query[1]):
            return None
        try:
            caller = await caller_of(Request(scope), service)
        except ProblemError as error:
            return answer(error.problem, error.headers)
        if caller.scope not in (None, live.record.client_id):
            return None
        return Response(status_code=204, headers={"X-Frame-Seq": str(seq)})
