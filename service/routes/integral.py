"""Monte Carlo in one dimension, for the Learn view: the estimator itself, of a function that is typed in."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Query

from renderer.lesson.expression import LONGEST
from service.access import Reader
from service.asking import ask, own_page
from service.clients import Caller
from service.context import Service, ServiceContext
from service.engine import learning_integral
from service.errors import refused
from service.messages import IntegralEstimate, IntegralRuns

router = APIRouter(prefix="/api/integral", tags=["learn"], dependencies=[Depends(own_page)])

_MOST_POINTS, _MOST_SHOWN = 1 << 20, 256
_MOST_RUNS, _MOST_POINTS_OF_RUNS = 200, 4096

Function = Annotated[str, Query(min_length=1, max_length=LONGEST, description="an expression of x: sin(x)^2, 1/(1+x)")]
Limit = Annotated[float, Query(description="of the integral; finite")]
Density = Annotated[
    str,
    Query(max_length=LONGEST, description="uniform, rough (steps that follow |f|), best (|f|/∫|f|), or an expression"),
]


@router.get("", responses={422: {}, 429: {}})
async def estimate_integral(
    service: ServiceContext,
    caller: Reader,
    f: Function,
    a: Limit = 0.0,
    b: Limit = 1.0,
    density: Density = "uniform",
    n: Annotated[int, Query(ge=1, le=_MOST_POINTS, description="points")] = 16,
    seed: Annotated[int, Query(ge=0, le=1 << 31)] = 0,
    shown: Annotated[int, Query(ge=0, le=_MOST_SHOWN, description="points that are told, the first ones")] = 128,
) -> IntegralEstimate:
    """⟨I⟩ = 1/n Σ f(xj)/p(xj), with V, σ and the 95 % interval; equal seeds have the same points."""
    told = await _ask(service, caller, learning_integral.estimate, f, a, b, density, n, seed, shown)
    return IntegralEstimate.model_validate(told)


@router.get("/runs", responses={422: {}, 429: {}})
async def integral_runs(
    service: ServiceContext,
    caller: Reader,
    f: Function,
    a: Limit = 0.0,
    b: Limit = 1.0,
    density: Density = "uniform",
    n: Annotated[int, Query(ge=1, le=_MOST_POINTS_OF_RUNS, description="points of the longest")] = 1024,
    runs: Annotated[int, Query(ge=2, le=_MOST_RUNS)] = 200,
) -> IntegralRuns:
    """Estimates of many independent runs for 1, 4, 16, … points."""
    told = await _ask(service, caller, learning_integral.runs, f, a, b, density, n, runs)
    return IntegralRuns.model_validate(told)


async def _ask(service: Service, caller: Caller, call: Callable[..., Any], *arguments: object) -> Any:
    told = await ask(service, caller, call, *arguments)
    if isinstance(told, learning_integral.Unfit):
        raise refused("integral", told.why)
    return told
