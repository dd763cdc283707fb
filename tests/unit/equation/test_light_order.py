"""Facts about the order of lights: none matters, for Mitsuba lists them as they were loaded."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import renderer
from renderer.backend import using
from renderer.equation.lights.powers import choice_probabilities, side_by_side
from renderer.equation.lights.scene_lights import is_sampleable


@pytest.fixture(scope="module")
def scene() -> renderer.Scene:
    rng = np.random.default_rng(5)
    contents: dict[str, Any] = {"type": "scene", "sensor": {"type": "perspective"}}
    for i in range(40):
        place = {"position": rng.normal(size=3).tolist()} if i > 0 else {"direction": rng.normal(size=3).tolist()}
        power = {"type": "rgb", "value": rng.lognormal(size=3).tolist()}
        kind = {"type": "point", "intensity": power} if i > 0 else {"type": "directional", "irradiance": power}
        contents[f"light{i}"] = kind | place
    return renderer.load_scene(contents, settings=renderer.Settings(width=8, height=8, colour="rgb"))


@pytest.mark.parametrize("seed", range(4))
def test_lights_listed_in_another_order_are_chosen_alike_to_the_bit(scene: renderer.Scene, seed: int) -> None:
    with using(scene.variant):
        listed = [e for e in scene.mitsuba_scene.emitters() if is_sampleable(e)]
        shuffled = [listed[i] for i in np.random.default_rng(seed).permutation(len(listed))]
        orders = [[each[i] for i in side_by_side(each)] for each in (listed, shuffled)]
        chances = [
            dict(zip(map(str, each), choice_probabilities(each).tolist(), strict=True)) for each in (listed, shuffled)
        ]
        assert [str(e) for e in orders[0]] == [str(e) for e in orders[1]]
        assert chances[0] == chances[1]
