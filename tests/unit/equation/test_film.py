"""Facts about shared samples: whole replicates, weights of one, and the same bits however the image is cut up."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import renderer
from renderer import Settings, Target
from renderer.backend import mitsuba
from renderer.equation.film import SharedFilm, generator_of, lanes_for, reach_of, shares_samples
from renderer.replay import differences, replay, settings_of

mi = mitsuba()
LAWS = settings(max_examples=60, deadline=None, derandomize=True)
FILTERS = {"gaussian": 2, "tent": 1, "mitchell": 2, "catmullrom": 2, "lanczos": 3, "box": 0}
SIZE = Settings(40, 30)


def scene(rfilter: str = "gaussian", **more: Any) -> dict[str, Any]:
    """A lamp in front of a wall."""
    T = mi.ScalarTransform4f
    return {
        "type": "scene",
        "sensor": {
            "type": "perspective",
            "to_world": T().look_at([0, 0, 5], [0, 0, 0], [0, 1, 0]),
            "film": {"type": "hdrfilm", "width": 40, "height": 30, "rfilter": {"type": rfilter}},
        },
        "wall": {"type": "rectangle", "to_world": T().scale(3)},
        "lamp": {
            "type": "rectangle",
            "to_world": T().translate([0.3, 0.2, 1]).scale(0.4),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [4, 2, 1]}},
        },
    } | more


@pytest.mark.parametrize(("name", "reach"), FILTERS.items())
def test_reach_is_how_far_samples_count(name: str, reach: int) -> None:
    rfilter = mi.load_dict({"type": name})
    assert reach_of(rfilter) == reach
    assert shares_samples(rfilter) == (reach > 0)
    # Just beyond it the filter is zero, and at its edge it is not.
    beyond = np.array(rfilter.eval(mi.Float(np.linspace(reach + 0.5001, reach + 1.5, 50, dtype=np.float32))))
    assert (beyond == 0).all() or name == "box"
    if reach:
        assert np.array(rfilter.eval(mi.Float(np.linspace(reach - 0.5, reach + 0.49, 500, dtype=np.float32)))).any()


@pytest.mark.parametrize("name", [n for n, reach in FILTERS.items() if reach])
def test_weights_over_all_squares_integrate_to_one(name: str) -> None:
    film = SharedFilm(mi.load_dict({"type": name}))
    u = (np.arange(4096, dtype=np.float32) + 0.5) / 4096
    total = sum(float(np.mean(np.array(w, np.float64))) for w in film.weights(mi.Float(u)))
    assert total == pytest.approx(1, abs=2e-6)


@pytest.mark.parametrize("n", [2, 4, 8, 16, 32, 64])
def test_the_lattice_has_each_column_and_row_once(n: int) -> None:
    assert sorted(generator_of(n) * np.arange(n) % n) == list(range(n))


def whole(pixels: NDArray[np.uint32], replicates: NDArray[np.uint32], width: int, reach: int) -> set[tuple[int, int]]:
    stride = width + 2 * reach
    return {
        ((p // width + reach + dy) * stride + p % width + reach + dx, r)
        for p, r in zip(pixels.tolist(), replicates.tolist(), strict=True)
        for dy in range(-reach, reach + 1)
        for dx in range(-reach, reach + 1)
    }


@LAWS
@given(
    width=st.integers(1, 30),
    height=st.integers(1, 30),
    reach=st.integers(1, 3),
    first=st.integers(0, 2**20),
    n=st.integers(1, 3),
    chosen=st.randoms(use_true_random=False),
)
def test_a_pass_has_each_lane_that_its_replicates_need_once(
    width: int, height: int, reach: int, first: int, n: int, chosen: Any
) -> None:
    some = np.array(sorted(chosen.sample(range(width * height), chosen.randint(1, width * height))), np.uint32)
    pixels, replicates = np.repeat(some, n), np.tile(np.arange(first, first + n, dtype=np.uint32), len(some))
    lanes = lanes_for(pixels, replicates, width, reach)
    rendered = list(zip(lanes.places.tolist(), lanes.replicates.tolist(), strict=True))
    assert len(set(rendered)) == len(rendered)
    assert set(rendered) == whole(pixels, replicates, width, reach)
    # The table finds them again.
    for dy in (-reach, 0, reach):
        for dx in (-reach, 0, reach):
            found = (lanes.starts[lanes.targets.astype(np.int64) + dy * lanes.stride + dx] + replicates) & 0xFFFFFFFF
            row, column = np.divmod(pixels.astype(np.int64), width)
            places = (row + reach + dy) * (width + 2 * reach) + column + reach + dx
            assert (lanes.places[found] == places).all()
            assert (lanes.replicates[found] == replicates).all()


def test_counts_that_differ_have_all_the_lanes_they_need() -> None:
    pixels, replicates = np.array([3, 3, 3, 20], np.uint32), np.array([5, 6, 7, 2], np.uint32)
    lanes = lanes_for(pixels, replicates, 8, 2)
    rendered = set(zip(lanes.places.tolist(), lanes.replicates.tolist(), strict=True))
    assert whole(pixels, replicates, 8, 2) <= rendered


@pytest.mark.parametrize("name", ["gaussian", "tent", "mitchell", "lanczos"])
@pytest.mark.parametrize("size", [2, 16])
def test_an_even_picture_has_no_noise(name: str, size: int) -> None:
    sky = {"type": "constant", "radiance": {"type": "rgb", "value": [0.7, 0.2, 0.4]}}
    even = {"type": "scene", "sensor": scene(name)["sensor"], "sky": sky}
    estimate = renderer.render(even, Target(spp=16 * size), Settings(40, 30, replicate_size=size))
    assert not estimate.identity.settings["independent_pixels"]
    tolerance = 2e-2 if name == "lanczos" else 2e-4 if size == 2 else 2e-5  # whose translates do not sum to one
    np.testing.assert_allclose(estimate.mean, np.broadcast_to([0.7, 0.2, 0.4], estimate.mean.shape), rtol=tolerance)
    assert np.nanmax(estimate.stderr[..., 3]) <= tolerance * 0.3


def test_a_box_shares_nothing() -> None:
    estimate = renderer.render(scene("box"), Target(spp=64), SIZE)
    assert estimate.identity.settings["independent_pixels"]
    assert "correlation" not in estimate.identity.settings


def test_a_pixel_alone_has_the_bits_that_it_has_in_the_image() -> None:
    estimate = renderer.render(scene(), Target(spp=64), SIZE)
    for pixel in [(0, 0), (39, 29), (21, 14), (0, 17)]:
        count = int(estimate.count[pixel[1], pixel[0]])
        again = replay(scene(), settings_of(estimate), pixel, range(count))
        assert differences(estimate, pixel, again) == []


def test_an_image_cut_into_blocks_has_the_bits_of_one_in_a_piece(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = Settings(150, 110, replicate_size=4)
    loaded = renderer.load_scene(scene(), settings=asked)
    whole_image = renderer.render(loaded, Target(spp=16), asked)
    monkeypatch.setattr("renderer.plan.pass_samples_for", lambda *_, **__: 2**13)
    monkeypatch.setattr("renderer.plan.FIRST_SAMPLES", 2**10)
    shown = list(renderer.progressive(loaded, Target(spp=16), asked))
    cut = shown[-1].estimate
    assert cut.moments.mean.tobytes() == whole_image.moments.mean.tobytes()
    assert cut.moments.m2.tobytes() == whole_image.moments.m2.tobytes()
    # The first picture is there before any replicate is whole, and says nothing that is not known.
    first = shown[0]
    assert first.estimate.count.max() == 0
    assert first.error is None
    assert first.estimate.filled().max() > 0.5


def test_samples_that_are_not_finite_are_counted_and_stand_aside() -> None:
    glowing = {"type": "area", "radiance": {"type": "rgb", "value": [1e38, 1e38, 1e38]}}
    T = mi.ScalarTransform4f
    bright = {"type": "rectangle", "to_world": T().translate([-1, 0, 1]).scale(0.3), "emitter": glowing}
    estimate = renderer.render(scene("tent", bright=bright), Target(spp=32), SIZE)
    assert np.isfinite(estimate.mean).all()


def test_a_region_has_pixels_of_its_own() -> None:
    target = Target(error=0.3, spp=64, region=[4, 4, 10, 10])
    estimate = renderer.render(scene(), target, SIZE)
    assert estimate.identity.settings["independent_pixels"]
    again = renderer.render(scene(), Target(spp=96), SIZE, start=estimate)
    assert again.identity.settings["independent_pixels"]
