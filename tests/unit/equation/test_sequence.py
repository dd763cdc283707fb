"""Facts about the random numbers: a replicate is a (0,2)-net; replicates, pixels and dimensions are unrelated."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2, norm

from renderer.backend import mitsuba
from renderer.equation.sequence import Sequence

FALSE_ALARM = 1e-6  # of each assertion, were its keys drawn afresh
KEYS = 2**16
mi = mitsuba()


def points(
    *,
    index: Any = 0,
    dimension: int = 0,
    seed: int = 1,
    pixel: Any = 0,
    replicate: Any = 0,
    size: int,
    plain: bool = False,
) -> NDArray[np.float64]:
    """(n, 2) points; arguments broadcast."""
    index, pixel, replicate = (
        a.astype(np.uint32) for a in np.broadcast_arrays(*map(np.asarray, (index, pixel, replicate)))
    )
    seed_low, seed_high = mi.UInt32(seed & 0xFFFFFFFF), mi.UInt32(seed >> 32)
    key_a, key_b = Sequence.keys(seed_low, seed_high, mi.UInt32(pixel.ravel()), mi.UInt32(replicate.ravel()))
    sequence = Sequence(mi, key_a, key_b, size, stratified=not plain)
    return np.array(sequence.point(mi.UInt32(index.ravel()), mi.UInt32(dimension)), np.float64).T


def replicates(size: int, n_keys: int, **more: Any) -> NDArray[np.float64]:
    """(keys, size, 2): all points of many pixels' replicates."""
    pixel, index = np.divmod(np.arange(n_keys * size), size)
    return points(index=index, pixel=pixel, size=size, **more).reshape(n_keys, size, 2)


def assert_uniform(cells: NDArray[np.integer], n_cells: int) -> None:
    counts = np.bincount(cells, minlength=n_cells)
    expected = len(cells) / n_cells
    statistic = float(((counts - expected) ** 2 / expected).sum())
    # Far too even is as wrong as far too uneven.
    assert chi2.ppf(FALSE_ALARM / 2, n_cells - 1) < statistic < chi2.ppf(1 - FALSE_ALARM / 2, n_cells - 1)


def assert_unrelated(a: NDArray[np.float64], b: NDArray[np.float64]) -> None:
    """Uncorrelated, and uniform together: 16 × 16 cells of each coordinate of a with each of b."""
    for i in range(2):
        for j in range(2):
            correlation = float(np.corrcoef(a[:, i], b[:, j])[0, 1])
            assert abs(correlation) * np.sqrt(len(a)) < norm.ppf(1 - FALSE_ALARM / 2)
            assert_uniform((a[:, i] * 16).astype(int) * 16 + (b[:, j] * 16).astype(int), 256)


@pytest.mark.parametrize("size", [2, 4, 8, 16, 32, 64])
@pytest.mark.parametrize(("dimension", "seed"), [(0, 1), (1, 1), (7, 2**40 + 3), (3001, 0)])
def test_every_elementary_interval_holds_exactly_one_point_of_a_replicate(size: int, dimension: int, seed: int) -> None:
    net = replicates(size, 500, dimension=dimension, seed=seed)
    bits = size.bit_length() - 1
    for a in range(bits + 1):
        b = bits - a
        cells = (net[..., 0] * 2**a).astype(int) * 2**b + (net[..., 1] * 2**b).astype(int)
        np.testing.assert_array_equal(np.sort(cells, axis=1), np.broadcast_to(np.arange(size), cells.shape))


@pytest.mark.parametrize("size", [1, 4, 16, 64])
def test_points_lie_in_the_half_open_unit_square(size: int) -> None:
    found = replicates(size, 4000)
    assert found.min() >= 0
    assert found.max() < 1
    assert np.float32(found.max()) < 1


@pytest.mark.parametrize("size", [1, 4, 16, 64])
@pytest.mark.parametrize("dimension", [0, 1, 30])
def test_each_point_is_uniform_over_keys(size: int, dimension: int) -> None:
    for index in {0, size // 2, size - 1}:
        p = points(index=index, pixel=np.arange(KEYS), dimension=dimension, size=size)
        for axis in range(2):
            assert_uniform((p[:, axis] * 256).astype(int), 256)
            assert_uniform((p[:, axis] * 2**18).astype(int) % 64, 64)  # finer than any stratum
        assert_uniform((p[:, 0] * 32).astype(int) * 32 + (p[:, 1] * 32).astype(int), 1024)


@pytest.mark.parametrize("size", [4, 16, 64])
def test_the_first_sample_visits_every_stratum_equally_often(size: int) -> None:
    p = points(pixel=np.arange(KEYS), size=size)
    assert_uniform((p[:, 0] * size).astype(int), size)
    # And where it lies within its strata says nothing of the other coordinate.
    assert_uniform((p[:, 0] * size % 1 * 16).astype(int) * 16 + (p[:, 1] * size % 1 * 16).astype(int), 256)


@pytest.mark.parametrize("size", [1, 4, 16, 64])
@pytest.mark.parametrize(
    "other",
    [
        {"dimension": 1},
        {"dimension": 3},
        {"dimension": 300},
        {"replicate": 1},
        {"replicate": 2**20},
        {"seed": 2},
        {"seed": 1 + 2**20},
        {"seed": 1 + 2**32},
        {"pixel": np.arange(1, KEYS + 1)},
        {"pixel": np.arange(KEYS) + 512},
    ],
    ids=lambda other: "-".join(other),
)
def test_other_dimensions_replicates_seeds_and_pixels_are_unrelated(size: int, other: dict[str, Any]) -> None:
    here = {"pixel": np.arange(KEYS), "size": size}
    assert_unrelated(points(**here), points(**(here | other)))


def test_successive_replicates_of_one_pixel_are_unrelated() -> None:
    p = points(pixel=77, replicate=np.arange(KEYS + 1), size=16)
    assert_unrelated(p[:-1], p[1:])
    for axis in range(2):
        assert_uniform((p[:, axis] * 256).astype(int), 256)


def test_swapping_pixel_and_replicate_gives_other_numbers() -> None:
    i = np.arange(KEYS)
    assert_unrelated(points(pixel=i, replicate=i + 1, size=4), points(pixel=i + 1, replicate=i, size=4))


@pytest.mark.parametrize("seed", [2, 1 + 2**20, 1 + 2**32, 1 + 2**62])
def test_no_two_seeds_share_a_replicate(seed: int) -> None:
    # Some samplers repeat after 2^20 seeds.
    a, b = replicates(4, 2000, seed=1), replicates(4, 2000, seed=seed)
    assert not (a == b).all(axis=(1, 2)).any()


def test_keys_of_a_large_image_do_not_collide() -> None:
    n = 2**20
    lane = np.arange(n, dtype=np.uint32)
    key_a, key_b = Sequence.keys(mi.UInt32(1), mi.UInt32(0), mi.UInt32(lane % 2**16), mi.UInt32(lane >> 16))
    both = np.array(key_a).astype(np.uint64) << np.uint64(32) | np.array(key_b)
    assert len(np.unique(both)) == n


def test_equal_keys_give_equal_points() -> None:
    np.testing.assert_array_equal(replicates(16, 100), replicates(16, 100))


def test_a_net_integrates_a_smooth_function_with_less_variance_than_independent_points() -> None:
    def spread(plain: bool) -> float:
        net = replicates(16, 4000, plain=plain)
        return float(np.var((net[..., 0] * net[..., 1]).mean(axis=1)))

    assert spread(plain=False) < spread(plain=True) / 10


def test_independent_points_are_uniform_and_unrelated_within_a_replicate() -> None:
    here = {"pixel": np.arange(KEYS), "size": 16, "plain": True}
    first, second = points(index=0, **here), points(index=1, **here)
    assert_unrelated(first, second)
    for axis in range(2):
        assert_uniform((first[:, axis] * 256).astype(int), 256)
