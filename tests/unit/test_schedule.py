"""Facts about the schedule: a pure function of a render's state says what comes next."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

from renderer.estimate.estimate import Identity
from renderer.estimate.moments import Moments
from renderer.plan import ADAPTIVE_FROM
from renderer.schedule import Allowed, next_round
from renderer.settings import Settings, Target
from renderer.state import RenderState
from renderer.stopping import StopRule

WIDTH, HEIGHT, SIZE = 24, 16, 16
N = WIDTH * HEIGHT


def state_of(replicates: int) -> RenderState:
    """After so many replicates of each pixel, noisier to the right."""
    moments, rng = Moments.empty(N), np.random.default_rng(3)
    noise = np.linspace(0.01, 2.0, WIDTH)[None, :, None].repeat(HEIGHT, axis=0).reshape(N, 1)
    for _ in range(replicates):
        none = np.zeros(N, np.uint32)
        radiance = (1 + noise * rng.exponential(size=(N, 1)) * np.ones(3)).astype(np.float32)
        moments.add_runs(np.arange(N), 1, radiance, none, SIZE, none + 2 * SIZE)
    return RenderState(Identity("digest", "scene", {}, 0, ()), moments)


def rule_of(target: Target, is_adaptive: bool = True) -> StopRule:
    return StopRule(target, WIDTH, SIZE, None, is_adaptive)


def added(state: RenderState, rule: StopRule, settings: Settings, **allowed: Any) -> np.ndarray:
    """(n,) replicates that the next round adds."""
    counts = np.zeros(N, np.int64)
    for work in next_round(state, rule, settings, Allowed(**allowed)).passes:
        if not work.is_look:
            np.add.at(counts, work.lanes()[0], 1)
    return counts


def test_a_round_is_asked_for_and_the_state_stays() -> None:
    state = state_of(2 * ADAPTIVE_FROM)
    before = copy.deepcopy(state)
    first = next_round(state, rule_of(Target(error=0.01)), Settings(), Allowed())
    works = list(first.passes)
    again = next_round(state, rule_of(Target(error=0.01)), Settings(), Allowed())
    assert state.planned is before.planned is None
    assert (state.moments.tried == before.moments.tried).all()
    assert (state.moments.m2 == before.moments.m2).all()
    assert first.planned is not None
    assert again.planned is not None
    assert (first.planned == again.planned).all()
    assert [work.n_lanes for work in works] == [work.n_lanes for work in again.passes]


def test_noisier_pixels_get_more_and_a_round_begun_is_ended_as_planned() -> None:
    state, rule = state_of(2 * ADAPTIVE_FROM), rule_of(Target(error=0.01))
    planned = next_round(state, rule, Settings(), Allowed()).planned
    assert planned is not None
    columns = planned.reshape(HEIGHT, WIDTH).mean(axis=0)
    assert columns[-6:].mean() > columns[:6].mean()
    state.planned = planned
    counts = added(state, rule, Settings())
    assert (state.moments.tried + counts == planned).all()


@pytest.mark.parametrize("replicates", [0, 1, ADAPTIVE_FROM - 1, 2 * ADAPTIVE_FROM])
def test_without_adaptive_rounds_all_pixels_are_served_alike(replicates: int) -> None:
    settings = Settings(adaptive=False)
    counts = added(state_of(replicates), rule_of(Target(spp=SIZE * 64), False), settings)
    assert counts.min() == counts.max() > 0


@pytest.mark.parametrize("is_adaptive", [True, False])
def test_no_round_goes_beyond_the_samples_asked_for(is_adaptive: bool) -> None:
    replicates = 2 * ADAPTIVE_FROM
    target = Target(spp=SIZE * (replicates + 1))
    counts = added(state_of(replicates), rule_of(target, is_adaptive), Settings(adaptive=is_adaptive))
    assert 0 < counts.sum() <= N


def test_looks_are_left_out_where_nobody_looks() -> None:
    n, width = 512 * 384, 512
    state = RenderState(Identity("digest", "scene", {}, 0, ()), Moments.empty(n))
    rule = StopRule(Target(spp=64), width, SIZE, None, is_adaptive=True)
    for looks in (True, False):
        works = list(next_round(state, rule, Settings(independent_pixels=False), Allowed(looks=looks)).passes)
        assert any(work.is_look for work in works) == looks
        assert sum(work.n_lanes for work in works if not work.is_look) >= n
