"""Russian roulette: who plays, and with what chance."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from renderer.backend import mitsuba
from renderer.equation.roulette import CEILING, FLOOR, carried, first_play, survival_probability

mi = mitsuba()


@pytest.mark.parametrize(
    ("throughput", "eta", "expected"),
    [
        ((0.1, 0.05, 0.2), 1.0, 0.2),
        ((-0.1, 0.05, -0.05), 1.0, 0.1),  # a filter's negative lobe: its paths matter as much
        ((0.1, 0.1, 0.1), 1.5, 0.225),  # radiance is compressed where it enters glass, and comes out again
    ],
)
def test_what_a_path_carries(throughput: tuple[float, float, float], eta: float, expected: float) -> None:
    assert number(carried(mi.Color3f(*throughput), mi.Float(eta))) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(
    ("carries", "typical", "depth", "is_limited", "chance"),
    [
        (0.6, 1.0, 2, True, 1.0),  # more than half of what is usual: nothing to gain
        (0.2, 1.0, 2, True, 0.4),
        (0.2, 1.0, 5, True, 0.3),
        (0.02, 0.1, 2, True, 0.4),  # behind a dark surface all carry little
        (0.2, 0.0, 2, True, 0.4),  # nothing but mirrors so far
        (1.0, 1.0, 9, True, 1.0),
        (1.0, 1.0, 9, False, CEILING),
        (1e-20, 1.0, 2, False, FLOOR),
    ],
)
def test_a_path_goes_on_with_the_chance_that_it_carries(
    carries: float, typical: float, depth: int, is_limited: bool, chance: float
) -> None:
    found = survival_probability(
        mi.Float(carries), mi.Float(typical), mi.UInt32(depth), mi.UInt32(5), mi.Bool(is_limited)
    )
    assert number(found) == pytest.approx(chance, rel=1e-6)


def number(value: Any) -> float:
    return float(np.array(value).ravel()[0])


def test_no_path_plays_where_the_scene_puts_roulette_out_of_reach() -> None:
    assert [first_play(depth) for depth in (1, 5, 1000)] == [0, 2, 500]
