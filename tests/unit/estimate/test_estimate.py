"""Facts about estimates: what may be merged, what is refused and why, what a pixel says of itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from renderer.errors import MergeError, SettingsError
from renderer.estimate.estimate import Estimate, Identity, merge
from renderer.estimate.moments import Moments


def estimate(seed: int = 0, width: int = 5, height: int = 3, n_replicates: int = 9) -> Estimate:
    n = width * height
    rng = np.random.default_rng(seed)
    moments = Moments.empty(n)
    for _ in range(n_replicates):
        moments.add(slice(None), rng.random((n, 3)).astype(np.float32), np.zeros(n, np.uint32), 4)
    identity = Identity("d1", "box", {"width": width, "height": height, "max_depth": 4}, seed)
    return Estimate(width, height, 4, moments, identity, seconds=1.5, ranges=((seed, n_replicates),))


def test_merging_two_seeds_adds_samples_seconds_and_ranges() -> None:
    a, b = estimate(1), estimate(2, n_replicates=7)
    merged = merge(a, b)
    assert merged.samples == a.samples + b.samples
    assert merged.seconds == 3
    assert merged.ranges == ((1, 9), (2, 7))
    assert merged.spp == 64
    np.testing.assert_allclose(merged.mean, (9 * a.mean + 7 * b.mean) / 16)


def test_replicates_of_one_seed_are_never_counted_twice() -> None:
    a, b, c = estimate(1), estimate(2), estimate(3)
    with pytest.raises(MergeError, match=r"overlap.*seed 1"):
        merge(a, a)
    with pytest.raises(MergeError, match=r"overlap.*seed 2"):
        merge(merge(a, b), merge(b, c))


@pytest.mark.parametrize(
    ("other", "named"),
    [
        (estimate(2, width=3, height=5), r"sizes differ: 5×3 and 3×5"),
        (replace(estimate(2), replicate_size=8), r"replicate sizes differ: 4 and 8"),
        (replace(estimate(2), identity=Identity("d2", "box", {}, 2)), r"scenes differ"),
        (
            replace(estimate(2), identity=Identity("d1", "box", {"width": 5, "height": 3, "max_depth": 5}, 2)),
            r"max_depth is 4 and 5",
        ),
    ],
    ids=["size", "replicate size", "scene", "settings"],
)
def test_estimates_of_different_questions_do_not_merge(other: Estimate, named: str) -> None:
    with pytest.raises(MergeError, match=named):
        merge(estimate(1), other)


def test_arrays_have_the_shape_of_the_image() -> None:
    e = estimate()
    assert e.mean.shape == (3, 5, 3)
    assert e.stderr.shape == (3, 5, 4)
    for array in (e.count, e.trust, e.invalid):
        assert array.shape == (3, 5)
    assert e.samples == 15 * 9 * 4


def test_a_pixel_reads_what_the_arrays_hold() -> None:
    e = estimate()
    reading = e.pixel(4, 1)
    assert reading.value == tuple(e.mean[1, 4])
    assert reading.standard_error == tuple(e.stderr[1, 4])
    assert (reading.samples, reading.replicates, reading.trusted) == (36, 9, False)
    assert reading.interval is not None
    low, high = reading.interval
    assert low < reading.luminance < high
    assert (low + high) / 2 == pytest.approx(reading.luminance)


def test_a_pixel_with_one_replicate_has_no_interval() -> None:
    reading = estimate(n_replicates=1).pixel(0, 0)
    assert reading.interval is None
    assert reading.standard_error == (None, None, None, None)
    assert not reading.trusted


@pytest.mark.parametrize(("x", "y"), [(5, 0), (0, 3), (-1, 0)])
def test_a_pixel_outside_the_image_is_refused(x: int, y: int) -> None:
    with pytest.raises(SettingsError, match=r"outside the image of 5×3"):
        estimate().pixel(x, y)


@pytest.mark.parametrize(("width", "height", "stride"), [(8, 8, 4), (7, 5, 2), (1, 9, 8), (9, 1, 4)])
def test_a_coarse_grid_fills_the_whole_picture_with_its_nearest_samples(width: int, height: int, stride: int) -> None:
    rows, columns = np.mgrid[:height, :width]
    on_grid = np.flatnonzero(((rows % stride == 0) & (columns % stride == 0)).ravel())
    moments = Moments.empty(width * height)
    values = np.repeat(1.0 + on_grid[:, None], 3, axis=1)
    moments.add(on_grid, values, np.zeros(len(on_grid), np.uint32), 4)
    filled = replace(estimate(), width=width, height=height, moments=moments).filled()
    expected = 1.0 + (rows // stride * stride) * width + columns // stride * stride
    np.testing.assert_array_equal(filled[..., 0], expected)


def test_filling_never_changes_a_pixel_that_has_samples() -> None:
    e = estimate()
    np.testing.assert_array_equal(e.filled(), e.mean.astype(np.float32))
