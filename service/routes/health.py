"""Whether the service is up and whether it can render."""

from __future__ import annotations

from fastapi import APIRouter, Response

from service.context import ServiceContext
from service.messages import Health, Readiness

router = APIRouter(tags=["health"])


@router.get("/healthz")
def health() -> Health:
    """The server answers."""
    return Health(status="ok")


@router.get("/readyz", responses={503: {"model": Readiness}})
def readiness(service: ServiceContext, response: Response) -> Readiness:
    """200 once the database answers and the renderer is warm."""
    service.jobs.last_event_id()
    state = service.runner.renderer_state
    if state != "warm":
        response.status_code = 503
    return Readiness(status="ready" if state == "warm" else "starting", renderer=state)
