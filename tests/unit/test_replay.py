"""Facts about replay: a pixel rendered alone has the bits that it has in the image."""

from __future__ import annotations

import numpy as np
import pytest

import renderer
from renderer.errors import SettingsError
from renderer.estimate.estimate import merge
from renderer.replay import differences, replay, settings_of

WIDTH, HEIGHT = 20, 14


@pytest.fixture(scope="module")
def scene() -> renderer.Scene:
    return renderer.load_scene("glass-sky", settings=renderer.Settings(width=WIDTH, height=HEIGHT))


@pytest.fixture(scope="module")
def estimate(scene: renderer.Scene) -> renderer.Estimate:
    return renderer.render(scene, renderer.Target(spp=48), renderer.Settings(WIDTH, HEIGHT, seed=5, replicate_size=4))


@pytest.mark.parametrize("pixel", [(0, 0), (19, 13), (7, 5), (11, 9), (3, 12)])
def test_a_pixel_replays_with_the_same_bits(
    scene: renderer.Scene, estimate: renderer.Estimate, pixel: tuple[int, int]
) -> None:
    x, y = pixel
    again = replay(scene, settings_of(estimate), pixel, range(int(estimate.count[y, x])))
    assert differences(estimate, pixel, again) == []
    one_less = replay(scene, settings_of(estimate), pixel, range(int(estimate.count[y, x]) - 1))
    assert "mean" in differences(estimate, pixel, one_less)


def test_a_replicate_alone_is_the_one_among_the_others(scene: renderer.Scene, estimate: renderer.Estimate) -> None:
    several = replay(scene, settings_of(estimate), (7, 5), range(2, 9))
    alone = replay(scene, settings_of(estimate), (7, 5), 4)
    assert alone.radiance[0].tobytes() == several.radiance[2].tobytes()
    assert len({r.tobytes() for r in several.radiance}) == 7


def test_another_seed_is_another_replicate(scene: renderer.Scene) -> None:
    a, b = (replay(scene, renderer.Settings(WIDTH, HEIGHT, seed=s), (7, 5), 0).radiance for s in (1, 2))
    assert not np.array_equal(a, b)


def test_what_is_not_there_is_refused(scene: renderer.Scene, estimate: renderer.Estimate) -> None:
    with pytest.raises(SettingsError, match=r"pixel \(20, 0\) is outside the image of 20×14"):
        replay(scene, settings_of(estimate), (20, 0), 0)
    for bad in (-1, range(0), range(0, 8, 2)):
        with pytest.raises(SettingsError, match="replicates are"):
            replay(scene, settings_of(estimate), (0, 0), bad)
    other = renderer.render(scene, renderer.Target(spp=8), renderer.Settings(WIDTH, HEIGHT, seed=6, replicate_size=4))
    with pytest.raises(renderer.errors.CheckpointError, match="several seeds"):
        settings_of(merge(estimate, other))
