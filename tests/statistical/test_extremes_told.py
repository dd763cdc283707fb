"""What the Learn view tells of extremes: ours is within what we accept where the naive formula is not."""

from __future__ import annotations

import math

import pytest

from renderer.errors import SettingsError
from renderer.lesson.extremes import LADDERS, rung

# Relative error that ours may have, and a place at which the naive formula is off by more than a tenth, or no number.
ACCEPTED = {
    "small-light": (1e-3, 4),
    "far-light": (1e-3, 5),
    "far-scene": (2e-2, 5),
    "thin-gap": (1e-2, 4),
    "many-samples": (1e-6, 6),
    "small-variance": (1e-9, 4),
}


@pytest.mark.parametrize("name", LADDERS)
def test_ours_holds_where_the_naive_formula_fails(name: str) -> None:
    limit, place = ACCEPTED[name]
    mild, bad = rung(name, 0), rung(name, place)
    for found in (mild, bad):
        assert abs(found.ours / found.exact - 1) < limit + found.half / found.exact
    assert abs(mild.naive / mild.exact - 1) < 2e-3, "it is right where nothing is extreme"
    assert not math.isfinite(bad.naive) or abs(bad.naive / bad.exact - 1) > 0.1


def test_what_is_no_extreme_is_refused() -> None:
    with pytest.raises(SettingsError, match="choose from small-light"):
        rung("nothing", 0)
    with pytest.raises(SettingsError, match="places are 0 to 6"):
        rung("thin-gap", 7)
