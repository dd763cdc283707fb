"""Facts about the stop rule: the bound decides, at few looks, and what is known to be missing counts."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from renderer.estimate.error import Missing
from renderer.estimate.moments import Moments
from renderer.settings import Target
from renderer.stopping import CHECKPOINT_GROWTH, MIN_REPLICATES_TO_STOP, StopRule, is_checkpoint, next_checkpoint

WIDTH, N = 32, 1024


def rule_of(target: Target, is_adaptive: bool = False, scope: Any = None) -> StopRule:
    return StopRule(target, WIDTH, 4, scope, is_adaptive)


def noisy(replicates: int = 16) -> Moments:
    moments, rng = Moments.empty(N), np.random.default_rng(7)
    for _ in range(replicates):
        moments.add(slice(None), rng.gamma(4.0, 1.0, (N, 3)), np.zeros(N, np.uint32), 4)
    return moments


def test_checkpoints_grow_strictly_and_geometrically() -> None:
    first = [c for c in range(20_000) if is_checkpoint(c)]
    assert first[0] == MIN_REPLICATES_TO_STOP
    for a, b in itertools.pairwise(first):
        assert a < b <= max(a + 1, a * CHECKPOINT_GROWTH)
    assert len(first) < 70


@pytest.mark.parametrize("replicates", [0, 1, 3, 4, 5, 17, 100, 12345])
def test_the_next_checkpoint_lies_ahead_and_is_one(replicates: int) -> None:
    ahead = next_checkpoint(replicates)
    assert ahead > replicates
    assert is_checkpoint(ahead)
    assert not any(is_checkpoint(c) for c in range(replicates + 1, ahead))


def test_the_first_limit_reached_wins_and_samples_go_before_time() -> None:
    rule = rule_of(Target(spp=8, seconds=2.0))
    assert rule.limit_reached(np.full(N, 1), 1.9) is None
    assert rule.limit_reached(np.full(N, 1), 2.0) == "seconds"
    assert rule.limit_reached(np.full(N, 2), 2.0) == "spp"


@pytest.mark.parametrize(
    ("counts", "is_adaptive", "is_round_over", "looks"),
    [
        ((4, 4), False, True, True),
        ((3, 3), False, True, False),  # too few to believe
        ((16, 16), True, True, True),  # a checkpoint
        ((17, 17), True, True, False),  # between two
        ((4, 5), True, True, True),  # the end of an adaptive round
        ((4, 5), True, False, False),
        ((4, 5), False, True, False),  # in the middle of a level one
    ],
)
def test_errors_are_judged_at_checkpoints_and_the_ends_of_rounds(
    counts: tuple[int, int], is_adaptive: bool, is_round_over: bool, looks: bool
) -> None:
    tried = np.repeat(counts, N // 2)
    assert rule_of(Target(error=0.1), is_adaptive).is_look(tried, is_round_over) is looks
    assert not rule_of(Target(spp=64), is_adaptive).is_look(tried, is_round_over)


def test_the_bound_decides_and_not_the_estimate() -> None:
    found = rule_of(Target(error=0.1)).error(noisy())
    assert found.error is not None
    assert found.upper is not None
    between = 0.5 * (found.error + found.upper)
    assert not rule_of(Target(error=between)).is_reached(found)
    assert rule_of(Target(error=1.01 * found.upper)).is_reached(found)


def test_no_target_is_reached_while_the_error_cannot_be_said() -> None:
    rule = rule_of(Target(error=0.5))
    found = rule.error(noisy())
    assert rule.is_reached(found)
    assert not rule.is_reached(replace(found, error=None, unknown="not yet known"))


def test_no_target_is_reached_while_light_is_known_to_be_missing() -> None:
    moments = noisy()
    rule = rule_of(Target(error=0.15))
    plain, audited = rule.error(moments), rule.error(moments, Missing(squared=0.1**2))
    assert rule.is_reached(plain)
    assert not rule.is_reached(audited)
    for name in ("error", "upper"):
        assert getattr(audited, name) == pytest.approx(np.hypot(getattr(plain, name), 0.1))


def test_doubted_pixels_are_not_within_a_target() -> None:
    doubted = np.arange(N) < N // 4
    moments, missing = noisy(64), Missing(doubted=doubted)
    rule = rule_of(Target(error=0.5, share=0.9))
    plain, audited = (rule.error(moments, one) for one in (Missing(), missing))
    assert rule.is_reached(plain)
    assert not rule.is_reached(audited)
    assert audited.share_within == pytest.approx(0.75)
    inside = rule_of(Target(error=0.5, share=0.9), scope=~doubted)
    assert inside.is_reached(inside.error(moments, missing))
