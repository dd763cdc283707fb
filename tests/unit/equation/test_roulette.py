"""Russian roulette: who plays, and with what chance."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.backend import mitsuba
from renderer.equation.roulette import CEILING, FLOOR, first_play, survival_probability

mi = mitsuba()


@pytest.mark.parametrize(
    ("throughput", "eta", "depth", "is_limited", "chance"),
    [
        ((0.3, 0.1, 0.1), 1.0, 2, True, 1.0),  # more than a quarter: nothing to gain
        ((0.1, 0.05, 0.1), 1.0, 2, True, 0.4),
        ((0.1, 0.05, 0.1), 1.0, 5, True, 0.3),
        ((-0.1, 0.05, -0.05), 1.0, 2, True, 0.4),  # a filter's negative lobe: its paths matter as much
        ((0.1, 0.1, 0.1), 1.5, 2, True, 0.9),  # radiance is compressed where it enters glass, and comes out again
        ((1.0, 1.0, 1.0), 1.0, 9, True, 1.0),
        ((1.0, 1.0, 1.0), 1.0, 9, False, CEILING),
        ((1e-20, 0.0, 0.0), 1.0, 2, False, FLOOR),
    ],
)
def test_a_path_goes_on_with_the_chance_that_it_carries(
    throughput: tuple[float, float, float], eta: float, depth: int, is_limited: bool, chance: float
) -> None:
    found = survival_probability(
        mi.Color3f(*throughput), mi.Float(eta), mi.UInt32(depth), mi.UInt32(5), mi.Bool(is_limited)
    )
    assert float(np.array(found).ravel()[0]) == pytest.approx(chance, rel=1e-6)


def test_no_path_plays_where_the_scene_puts_roulette_out_of_reach() -> None:
    assert [first_play(depth) for depth in (1, 5, 1000)] == [0, 2, 500]
