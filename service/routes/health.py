"""Whether the service is up, whether it can render, and its figures."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from fastapi import APIRouter, Response
from prometheus_client import CONTENT_TYPE_LATEST, generate_latest
from sqlalchemy.exc import SQLAlchemyError

from service.access import Admin
from service.context import ServiceContext
from service.messages import Health, Readiness
from service.metrics import Metrics, resident_bytes
from service.states import State
from service.store import DatabaseReplaced
from service.store.threads import reading

if TYPE_CHECKING:
    from service.cluster.gate import Gate

router = APIRouter(tags=["health"])


@router.get("/healthz")
async def health() -> Health:
    """The server answers."""
    return Health(status="ok")


@router.get("/readyz", responses={503: {"model": Readiness}})
async def readiness(service: ServiceContext, response: Response) -> Readiness:
    """200 once the database answers, files can be written and the renderer is warm; else what is not ready."""
    missing = await service.not_ready()
    if missing:
        response.status_code = 503
    state = service.runner.renderer_state
    return Readiness(status="starting" if missing else "ready", renderer=state, not_ready=missing)


@router.get(
    "/metrics",
    response_class=Response,
    responses={200: {"content": {"text/plain": {"schema": {"type": "string"}}}}, 401: {}, 403: {}},
)
async def metrics(service: ServiceContext, caller: Admin) -> Response:
    """Figures for Prometheus."""
    figures = service.metrics
    try:
        counts = await reading(service.jobs.counts)
    except (SQLAlchemyError, DatabaseReplaced):
        counts = dict.fromkeys(State, math.nan)  # the other figures are wanted all the more
    for state, count in counts.items():
        figures.jobs.labels(state.value).set(count)
    figures.unreadable.set(len(service.jobs.unreadable()))
    figures.streams.set(service.hub.count())
    for name, (taken, most) in service.account().items():
        figures.reckoned.labels(name).set(taken)
        figures.budgets.labels(name).set(most)
    if service.gate is not None:
        _note_cluster(service.gate, figures)
    figures.memory.labels("service").set(resident_bytes())
    figures.memory.labels("render").set(sum(resident_bytes(pid) for pid in service.engine.pids()))
    return Response(generate_latest(figures.registry), media_type=CONTENT_TYPE_LATEST)


def _note_cluster(gate: Gate, figures: Metrics) -> None:
    """Of the workers that there are now; those that have left are not told of."""
    workers = gate.workers()
    usable = sum(map(gate.is_usable, workers))
    figures.workers.labels("usable").set(usable)
    figures.workers.labels("other").set(len(workers) - usable)
    figures.worker_passes.clear()
    figures.worker_rendered.clear()
    for worker in workers:
        figures.worker_passes.labels(worker.name).set(worker.passes)
        figures.worker_rendered.labels(worker.name).set(worker.rendered)
    figures.pass_bytes.labels("sent").set(gate.sent_bytes)
    figures.pass_bytes.labels("received").set(gate.received_bytes)
