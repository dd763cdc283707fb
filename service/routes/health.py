"""Whether the service is up, whether it can render, and its figures."""

from __future__ import annotations

from fastapi import APIRouter, Response
from prometheus_client import CONTENT_TYPE_LATEST, generate_latest

from service.access import Admin
from service.context import ServiceContext
from service.messages import Health, Readiness
from service.metrics import resident_bytes

router = APIRouter(tags=["health"])


@router.get("/healthz")
async def health() -> Health:
    """The server answers."""
    return Health(status="ok")


@router.get("/readyz", responses={503: {"model": Readiness}})
def readiness(service: ServiceContext, response: Response) -> Readiness:
    """200 once the database answers, files can be written and the renderer is warm; else what is not ready."""
    missing = service.not_ready()
    if missing:
        response.status_code = 503
    state = service.runner.renderer_state
    return Readiness(status="starting" if missing else "ready", renderer=state, not_ready=missing)


@router.get(
    "/metrics",
    response_class=Response,
    responses={200: {"content": {"text/plain": {"schema": {"type": "string"}}}}, 401: {}, 403: {}},
)
def metrics(service: ServiceContext, caller: Admin) -> Response:
    """Figures for Prometheus."""
    figures = service.metrics
    for state, count in service.jobs.counts().items():
        figures.jobs.labels(state.value).set(count)
    figures.streams.set(service.hub.count())
    figures.memory.labels("service").set(resident_bytes())
    figures.memory.labels("render").set(sum(resident_bytes(pid) for pid in service.engine.pids()))
    return Response(generate_latest(figures.registry), media_type=CONTENT_TYPE_LATEST)
