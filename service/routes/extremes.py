"""Numbers at the edge of float32, for the Learn view: the naive formula beside the renderer's, computed now."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import APIRouter, Depends, Query

from service.access import Reader
from service.asking import ask, own_page
from service.context import ServiceContext
from service.engine import learning_extremes
from service.messages import ExtremeRung

router = APIRouter(prefix="/api/extremes", tags=["learn"], dependencies=[Depends(own_page)])

Extreme = Literal["small-light", "far-light", "far-scene", "thin-gap", "many-samples", "small-variance"]
PLACES = 7


@router.get("/{name}", responses={422: {}, 429: {}})
async def extreme_rung(
    name: Extreme,
    service: ServiceContext,
    caller: Reader,
    k: Annotated[int, Query(ge=0, lt=PLACES, description="place on its ladder, 0 = the mildest")] = 0,
) -> ExtremeRung:
    """One place on the ladder of an extreme: exact, naive in float32, and by the renderer."""
    return ExtremeRung.model_validate(await ask(service, caller, learning_extremes.rung, name, k))
