"""Facts about allocation: nobody starves, nobody decides for itself, the budget is kept."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from renderer import allocation
from renderer.allocation import EVEN_GROWTH, FLOOR_SHARE, MAX_GROWTH, MOST_GROWTH, _is_even, next_counts
from renderer.estimate.moments import Moments
from renderer.stopping import CHECKPOINT_GROWTH

WIDTH, HEIGHT = 24, 16
N = WIDTH * HEIGHT
LAWS = settings(max_examples=40, deadline=None, derandomize=True)


def moments_of(spread: NDArray, n_replicates: int = 16, seed: int = 0) -> Moments:
    """Replicates of mean 1 with the given standard deviation (n,) per pixel."""
    rng, moments = np.random.default_rng(seed), Moments.empty(len(spread))
    for _ in range(n_replicates):
        value = 1 + spread * rng.uniform(-1.7, 1.7, len(spread))
        moments.add(slice(None), np.repeat(value[:, None], 3, axis=1), np.zeros(len(spread), np.uint32), 4)
    return moments


@LAWS
@given(seed=st.integers(0, 999), n=st.integers(4, 40), scale=st.floats(1e-3, 10))
def test_a_round_adds_its_share_and_takes_nothing_away(seed: int, n: int, scale: float) -> None:
    spread = scale * np.random.default_rng(seed).lognormal(0, 1.5, N)
    moments = moments_of(spread, n, seed)
    more = next_counts(moments, WIDTH, HEIGHT) - moments.tried
    if len(set(more)) == 1 and n > 1:  # nothing to be gained
        assert more[0] == np.ceil(EVEN_GROWTH * n) - n
        return
    assert (more >= 0).all()
    assert (more <= np.ceil((MAX_GROWTH - 1) * moments.tried)).all()
    assert more.sum() == pytest.approx((CHECKPOINT_GROWTH - 1) * n * N, rel=0.1, abs=N / 20)


def test_a_pixels_own_values_do_not_change_its_count() -> None:
    moments = moments_of(np.where(np.arange(N) % WIDTH < WIDTH // 2, 0.1, 0.5))
    before = next_counts(moments, WIDTH, HEIGHT)
    i = 8 * WIDTH + 3
    moments.m2[i] *= 2.0
    moments.m3[i] *= 2.0**1.5
    after = next_counts(moments, WIDTH, HEIGHT)
    neighbour = i + 1
    assert abs(int(after[i]) - int(before[i])) <= 1, "through the sum over the image alone"
    moments.m2[i] *= 1000
    moments.m3[i] *= 1000**1.5
    assert next_counts(moments, WIDTH, HEIGHT)[neighbour] > after[neighbour], "its neighbours do take notice"


def test_of_equally_noisy_pixels_the_cheaper_ones_get_more() -> None:
    moments = moments_of(np.full(N, 0.5), 40)
    is_dear = np.arange(N) % WIDTH >= WIDTH // 2
    moments.segments += np.where(is_dear, 9 * 40 * 4, 40 * 4)
    more = next_counts(moments, WIDTH, HEIGHT) - moments.tried
    inside = np.abs(np.arange(N) % WIDTH - (WIDTH - 1) / 2) > 2
    assert more[inside & is_dear].mean() < 0.1 * more[inside & ~is_dear].mean(), "they are behind, and wait"
    ratio = 0.0
    for _ in range(12):
        wanted = next_counts(moments, WIDTH, HEIGHT)
        ratio = wanted[inside & ~is_dear].mean() / wanted[inside & is_dear].mean()
        moments.segments = moments.segments * wanted // moments.tried
        moments.count, moments.m2 = wanted, moments.m2 * (wanted / moments.tried)[:, None]
        moments.tried = wanted.copy()
    assert ratio == pytest.approx(
        (FLOOR_SHARE / 2 + (1 - FLOOR_SHARE) * 0.75) / (FLOOR_SHARE / 2 + (1 - FLOOR_SHARE) * 0.25), rel=0.1
    )


def grown(spread: NDArray, rounds: int, focus: NDArray | None = None) -> Moments:
    """Rounds of adaptive sampling."""
    rng, moments = np.random.default_rng(3), moments_of(spread, 4)
    for _ in range(rounds):
        wanted = next_counts(moments, WIDTH, HEIGHT, focus)
        while (behind := np.flatnonzero(wanted > moments.tried)).size:
            value = 1 + spread[behind] * rng.uniform(-1.7, 1.7, len(behind))
            moments.add(behind, np.repeat(value[:, None], 3, axis=1), np.zeros(len(behind), np.uint32), 4)
    return moments


def test_noisy_places_get_more_and_quiet_ones_their_floor() -> None:
    noisy = np.arange(N) % WIDTH >= WIDTH // 2
    count = grown(np.where(noisy, 1.0, 0.01), 20).count
    assert count[noisy].mean() > 3 * count[~noisy].mean()
    assert count.min() >= 0.8 * FLOOR_SHARE * count.mean()


@pytest.mark.parametrize(("probability", "replicates", "least"), [(0.1, 64, 2.5), (0.1, 128, 3.5), (0.05, 128, 3.0)])
def test_a_rare_light_in_one_spot_draws_the_samples_there(probability: float, replicates: int, least: float) -> None:
    # Without noise in the counts 7.1 and 8.8 could be gained.
    y, x = np.divmod(np.arange(N), WIDTH)
    in_spot = (abs(x - WIDTH // 2) < 3) & (abs(y - HEIGHT // 2) < 3)
    variance = np.where(in_spot, (1 / probability - 1) / 4, 0.05**2)  # relative to the squared mean, 4 in the spot
    rng, moments = np.random.default_rng(5), Moments.empty(N)

    def add(pixels: NDArray) -> None:
        flash = (rng.random(len(pixels)) < probability) / probability
        value = 1 + 0.05 * rng.uniform(-1.7, 1.7, len(pixels)) + np.where(in_spot[pixels], flash, 0.0)
        moments.add(pixels, np.repeat(value[:, None], 3, axis=1), np.zeros(len(pixels), np.uint32), 4)

    for _ in range(4):
        add(np.arange(N))
    while moments.tried.mean() < replicates:
        wanted = next_counts(moments, WIDTH, HEIGHT)
        while (behind := np.flatnonzero(wanted > moments.tried)).size:
            add(behind)
    gain = variance.mean() / (moments.tried.mean() * np.mean(variance / moments.tried))
    assert gain > least


def test_even_noise_is_sampled_evenly() -> None:
    count = grown(np.full(N, 0.5), 8).count
    assert count.std() / count.mean() < 0.1


def test_an_image_that_does_not_vary_is_sampled_evenly() -> None:
    count = grown(np.zeros(N), 8).count
    assert count.max() - count.min() <= 2


def test_pixels_outside_the_focus_get_the_floor_alone() -> None:
    focus = np.arange(N) % WIDTH < 6
    count = grown(np.full(N, 0.5), 20, focus=focus).count
    assert count[focus].mean() > 3 * count[~focus].mean()
    assert count[~focus].min() >= 0.8 * FLOOR_SHARE * count.mean()


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (7, 1), (2, 3)])
def test_the_smallest_images_have_a_next_round_too(size: tuple[int, int]) -> None:
    width, height = size
    moments = moments_of(np.full(width * height, 0.5), 5)
    assert next_counts(moments, width, height).sum() > 5 * width * height


def test_equal_counts_stay_equal_where_others_would_hardly_do_better() -> None:
    counts = next_counts(moments_of(np.full(N, 0.5), 16), WIDTH, HEIGHT)
    assert set(counts) == {int(np.ceil(EVEN_GROWTH * 16))}
    is_dull = np.arange(N) % WIDTH < WIDTH // 2
    assert len(set(next_counts(moments_of(np.where(is_dull, 0.1, 0.5), 16), WIDTH, HEIGHT))) > 1


def test_shares_are_judged_by_what_they_were_not_made_of() -> None:
    """Where neighbours vary by chance alone, shares that follow them promise a gain that the pixels do not know of."""
    chance = np.random.default_rng(4).lognormal(0.0, 1.0, N)
    share, even = np.sqrt(chance) / np.sqrt(chance).sum(), np.ones(N)
    assert _is_even(share, even, even)
    assert not _is_even(share, chance, even), "here they do"
    assert _is_even(share, chance, share), "but not where those pixels cost more as well"


def test_counts_that_the_pixels_themselves_do_not_bear_out_are_not_aimed_at(monkeypatch: pytest.MonkeyPatch) -> None:
    chance = np.random.default_rng(4).lognormal(0.0, 1.0, N)
    monkeypatch.setattr(allocation, "_wanting", lambda *_: (chance, 1.0))
    assert len(set(next_counts(moments_of(np.full(N, 0.5)), WIDTH, HEIGHT))) == 1


def test_a_round_has_the_least_that_is_asked_for_within_a_limit() -> None:
    is_dull = np.arange(N) % WIDTH < WIDTH // 2
    moments = moments_of(np.where(is_dull, 0.1, 0.5), 16)
    for least, expected in ((0.0, CHECKPOINT_GROWTH * 16), (5.0, 21.0), (100.0, MOST_GROWTH * 16)):
        assert next_counts(moments, WIDTH, HEIGHT, least=least).mean() == pytest.approx(expected, rel=0.01)


def test_a_few_flashes_anywhere_draw_no_samples() -> None:
    """Light that is as rare everywhere: where the first flashes were seen says nothing about the next ones."""
    rng, moments, probability = np.random.default_rng(2), Moments.empty(N), 3e-4
    for _ in range(64):
        value = 1 + (rng.random(N) < probability) / probability
        moments.add(slice(None), np.repeat(value[:, None], 3, axis=1), np.zeros(N, np.uint32), 4)
    assert len(set(next_counts(moments, WIDTH, HEIGHT))) == 1
