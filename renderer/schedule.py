"""What a render does next. Pure: nothing is rendered here, no clock is read, and the state handed in stays as it is.

Enters: the state of a render, its stop rule, its settings, and what pace allows. Leaves: a `Round`: the counts that
pixels are to have at its end, where they differ, and the passes that bring them there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from renderer import allocation, plan
from renderer.settings import Settings
from renderer.state import RenderState
from renderer.stopping import StopRule


@dataclass(frozen=True, slots=True, eq=False)
class Round:
    """planned: (n,) replicates of each pixel at its end, None where all are served alike; a render that was stopped in
    between goes on with the same ones. passes: made one by one, while others run.
    """

    planned: NDArray[np.int64] | None
    passes: Iterator[plan.Pass]


@dataclass(frozen=True, slots=True)
class Allowed:
    """What pace allows. pass_samples: of the next pass, asked each time. samples_left: before the target's time is
    over, about. least_replicates: per pixel, in the mean, that an adaptive round is worth planning for. looks: whether
    passes for a first picture alone are wanted.
    """

    pass_samples: Callable[[], int] = lambda: 2**20
    samples_left: float = math.inf
    least_replicates: float = 0.0
    looks: bool = True


def next_round(state: RenderState, rule: StopRule, settings: Settings, allowed: Allowed) -> Round:
    """The next round of a render with these resolved settings."""
    tried, wanted, planned = state.moments.tried, rule.replicates_wanted, state.planned
    height = len(tried) // rule.width
    if not settings.adaptive or int(tried.min()) < plan.ADAPTIVE_FROM:
        return Round(planned, _level(tried, rule, settings, wanted, allowed))
    if state.is_round_over:
        planned = allocation.next_counts(state.moments, rule.width, height, rule.scope, allowed.least_replicates)
    assert planned is not None
    if (level := int(planned.min())) == int(planned.max()) and int(tried.max()) <= level:
        most = level if wanted is None else min(level, wanted)
        return Round(planned, _level(tried, rule, settings, most, allowed))
    left = None if wanted is None else wanted * len(tried) - int(tried.sum())
    passes = plan.planned_round(tried, planned, rule.width, rule.replicate_size, left, allowed.pass_samples)
    return Round(planned, passes)


def _level(
    tried: NDArray[np.int64], rule: StopRule, settings: Settings, most: int | None, allowed: Allowed
) -> Iterator[plan.Pass]:
    """The passes that give the pixels of lowest count their next replicates, up to `most`."""
    works = plan.next_round(
        tried,
        rule.width,
        len(tried) // rule.width,
        rule.replicate_size,
        most,
        allowed.pass_samples,
        rule.target.error is not None,
        allowed.samples_left,
        is_shared=not settings.independent_pixels,
    )
    return works if allowed.looks else (work for work in works if not work.is_look)
