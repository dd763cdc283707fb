"""How a route asks the renderer a question while somebody waits: by fair turns, once for all who ask the same."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from typing import TypeVar

from fastapi import Request

from service.clients import Caller
from service.context import Service
from service.engine.interface import Lost
from service.engine.turn import Failure
from service.errors import ProblemError
from service.questions import Busy
from service.without_paths import without_paths

T = TypeVar("T")
_DEADLINE_SECONDS = 60.0


async def own_page(request: Request) -> None:
    """A picture or script of another site's page must not set the renderer to work. Raises ProblemError."""
    site = request.headers.get("sec-fetch-site", "none")
    origin = request.headers.get("origin")
    own = f"{request.url.scheme}://{request.headers.get('host', '')}"
    if site not in ("same-origin", "none") or (origin is not None and origin != own):
        detail = "Web pages of other sites cannot set the renderer to work; open the service's own page."
        raise ProblemError(403, "cross-site", "Refused for pages of other sites", detail)


async def ask(
    service: Service, caller: Caller, call: Callable[..., T | Failure], *arguments: object, about: str | None = None
) -> T:
    """What a call answers, which is the same for all who ask the same: it is made once, and kept for a while.

    about: id of the uploaded scene that it is about, which is counted against that if the renderer is lost.
    """
    key = (call.__module__, call.__name__, *arguments)
    async with service.lessons.making(key):
        if (kept := service.lessons.get(key)) is None:
            kept = pickle.dumps(await _answer(service, caller, call, *arguments, about=about))
            service.lessons.put(key, kept)
    return pickle.loads(kept)


async def _answer(
    service: Service, caller: Caller, call: Callable[..., T | Failure], *arguments: object, about: str | None
) -> T:
    try:
        answer = await service.runner.ask(caller.client_id, _DEADLINE_SECONDS, call, *arguments)
    except Busy:
        service.metrics.refusals.labels("questions").inc()
        detail = "Too many ask the renderer now; ask again in a moment."
        raise ProblemError(429, "too-many", "The renderer is busy", detail, headers={"Retry-After": "2"}) from None
    except Lost as lost:
        if about is not None and not lost.was_killed:
            service.lesson_losses[about] += 1
        raise ProblemError(503, "renderer-lost", "The renderer was lost", f"{lost}; ask again.") from None
    if isinstance(answer, Failure):
        if answer.is_unexpected:
            service.runner.renew_renderer()
        detail = without_paths(answer.detail, [service.settings.scenes_dir])
        raise ProblemError(500, "lesson-failed", answer.title, detail)
    return answer
