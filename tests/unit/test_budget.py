"""Facts about time budgets: two replicates of every pixel end well inside, and what is too short is said beforehand."""

from __future__ import annotations

import pytest

from renderer.budget import FEWEST_ROUNDS, ROUNDS, Pace, replicate_size, shortfall

PACES = [Pace(1e-7, 5e-7), Pace(1e-6, 5e-7), Pace(2e-5, 1e-6), Pace(1e-8, 0.0)]


@pytest.mark.parametrize("pace", PACES)
@pytest.mark.parametrize("pixels", [1, 256**2, 1920 * 1080])
@pytest.mark.parametrize("seconds", [0.3, 1.0, 10.0, 1e4])
@pytest.mark.parametrize("most", [4, 16, 64])
def test_two_rounds_end_in_a_quarter_of_the_time_or_the_size_is_one(
    pace: Pace, pixels: int, seconds: float, most: int
) -> None:
    size = replicate_size(seconds, pixels, pace, most)
    assert size & (size - 1) == 0
    assert 1 <= size <= most
    # On a machine that turns out four times slower two rounds end in time all the same.
    assert size == 1 or 4 * 2 * pace.round_seconds(pixels, size) <= seconds
    if size < most:  # no larger than that, and no smaller than need be
        assert ROUNDS * pace.round_seconds(pixels, 2 * size) > seconds


def test_a_replicate_that_costs_more_to_add_up_than_to_render_is_larger() -> None:
    seconds, pixels = 1.0, 100_000
    cheap, dear = Pace(1e-7, 0.0), Pace(1e-7, 7e-7)
    assert replicate_size(seconds, pixels, cheap, 64) == 4
    assert replicate_size(seconds, pixels, dear, 64) == 4
    assert ROUNDS * dear.round_seconds(pixels, 4) > seconds >= FEWEST_ROUNDS * dear.round_seconds(pixels, 4)


def test_a_time_that_is_too_short_for_a_sample_of_each_pixel_is_named_with_what_it_would_take() -> None:
    pace = Pace(1e-6, 0.0)
    assert shortfall(2.1, 1920, 1080, 1, pace) is None
    said = shortfall(0.3, 1920, 1080, 1, pace)
    assert said is not None
    assert said.startswith("0.3 s are too short for one sample in each of 1920×1080 pixels, which take about 2.1 s")
    assert "64 samples in each" in str(shortfall(2.1, 1920, 1080, 64, pace))
