"""Places and the probabilities of lights at each: NumPy only."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.equation.lights.place_tree import (
    BLIND_SHARE,
    FEATURES,
    GRID,
    cumulative,
    plant,
    relative_squares,
    rows_of,
)


def descend(nodes: np.ndarray, depth: int, features: np.ndarray) -> np.ndarray:
    """The leaf of each point, found as a kernel finds it."""
    node = np.zeros(len(features), np.int64)
    for _ in range(depth):
        value = features[np.arange(len(features)), nodes[node, 0].astype(np.int64)]
        node = 2 * node + np.where(value <= nodes[node, 1], 1, 2)
    return node - (2**depth - 1)


@pytest.mark.parametrize(("n", "depth"), [(500, 5), (40, 3), (3, 4), (1, 2)])
def test_going_down_the_tree_leads_every_point_to_its_leaf(n: int, depth: int) -> None:
    rng = np.random.default_rng(1)
    features = rng.normal(size=(n, FEATURES)).astype(np.float32)
    nodes, leaf = plant(features, rng.exponential(size=(n, 3)), depth)
    assert nodes.shape == (2**depth - 1, 2)
    np.testing.assert_array_equal(descend(nodes, depth, features), leaf)


def test_places_hold_about_equally_many_points() -> None:
    rng = np.random.default_rng(2)
    features, squares = rng.normal(size=(1024, FEATURES)), rng.exponential(size=(1024, 4))
    counts = np.bincount(plant(features, squares, 5)[1], minlength=32)
    assert counts.min() >= 31
    assert counts.max() <= 33


def test_points_that_coincide_share_a_place() -> None:
    _, leaf = plant(np.ones((64, FEATURES)), np.ones((64, 2)), 3)
    assert len(set(leaf)) == 1


def test_places_are_parted_where_the_lights_that_matter_change() -> None:
    features = np.random.default_rng(4).normal(size=(256, FEATURES)) * [9, 9, 9, 1, 1, 1]
    is_left = features[:, 4] < 0
    nodes, _ = plant(features, np.stack([is_left, ~is_left], axis=1).astype(float), 1)
    assert nodes[0, 0] == 4
    assert abs(nodes[0, 1]) < 0.3


def test_a_light_is_chosen_in_proportion_to_the_root_mean_square_of_what_it_gives() -> None:
    given = np.array([[3.0, 1.0, 0.0], [3.0, 1.0, 0.0]], np.float32)
    rows = rows_of(relative_squares(given), np.zeros(2, np.int64), 0, np.full(3, 1 / 3))
    np.testing.assert_allclose(rows[0], (1 - BLIND_SHARE) * np.array([0.75, 0.25, 0]) + BLIND_SHARE / 3)


def test_a_light_that_was_seen_nowhere_keeps_its_blind_share_everywhere() -> None:
    rng = np.random.default_rng(3)
    given = rng.exponential(size=(200, 12)).astype(np.float32)
    given[:, 7] = 0
    blind = rng.dirichlet(np.ones(12))
    rows = rows_of(relative_squares(given), rng.integers(0, 16, 200), 4, blind)
    np.testing.assert_allclose(rows[:, 7], BLIND_SHARE * blind[7])
    assert (rows >= BLIND_SHARE * blind - 1e-15).all()
    np.testing.assert_allclose(rows.sum(axis=1), 1)


def test_where_nothing_was_lit_lights_are_chosen_as_in_the_larger_place() -> None:
    given = np.array([[1.0, 0.0], [0.0, 0.0]], np.float32)
    rows = rows_of(relative_squares(given), np.array([0, 1]), 1, np.array([0.5, 0.5]))
    np.testing.assert_allclose(rows[0], rows[1])
    assert rows[1, 0] > 0.9
    dark = rows_of(np.zeros((2, 2)), np.array([0, 1]), 1, np.array([0.3, 0.7]))
    np.testing.assert_allclose(dark, [[0.3, 0.7]] * 2)


def test_light_that_is_not_finite_does_not_spoil_a_row() -> None:
    given = np.array([[np.inf, 1.0], [np.nan, 1.0]], np.float32)
    rows = rows_of(relative_squares(given), np.zeros(2, np.int64), 0, np.array([0.5, 0.5]))
    assert np.isfinite(rows).all()


def test_no_light_is_lost_to_rounding() -> None:
    rows = np.array([[1.0, 1e-12, 1e-30, 1e-9], [1e-30, 1e-30, 1.0, 0.0]])
    sums = cumulative(rows).astype(np.float64)
    assert (np.diff(sums) >= 1 / GRID).all()
    np.testing.assert_array_equal(sums[:, 0], 0)
    np.testing.assert_array_equal(sums[:, -1], 1)
    np.testing.assert_array_equal(sums * GRID, np.round(sums * GRID))
    np.testing.assert_allclose(np.diff(sums)[0, 0], 1, atol=1e-6)
