"""Facts about replicates that wait: joined in any order they have the bits of a straight run; none counts twice."""

from __future__ import annotations

import itertools
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from renderer.errors import CheckpointError, MergeError
from renderer.estimate.blocks import Block, Held, join
from renderer.estimate.estimate import Estimate, Identity
from renderer.estimate.moments import Moments

WIDTH, HEIGHT, SIZE, N_REPLICATES = 7, 3, 4, 12
N = WIDTH * HEIGHT
RNG = np.random.default_rng(0)
RADIANCE = RNG.gamma(0.3, 5.0, (N_REPLICATES, N, 3)).astype(np.float32)
INVALID = np.where(RNG.random((N_REPLICATES, N)) < 0.1, RNG.integers(1, SIZE + 1, (N_REPLICATES, N)), 0).astype(
    np.uint8
)
SEGMENTS = RNG.integers(4, 2**40, (N_REPLICATES, N))
EVERYWHERE = np.arange(N)


def straight(first: int, end: int, pixels: np.ndarray = EVERYWHERE) -> Moments:
    """Replicates of some pixels, added one by one, as a render does."""
    moments = Moments.empty(N)
    for r in range(first, end):
        moments.add(pixels, RADIANCE[r, pixels], INVALID[r, pixels], SIZE, SEGMENTS[r, pixels])
    return moments


def part(first: int, end: int, pixels: np.ndarray = EVERYWHERE) -> Held:
    if first == 0:
        return Held(straight(0, end, pixels))
    chosen = slice(first, end), pixels
    return Held(
        Moments.empty(N), (Block(first, pixels, RADIANCE[chosen], INVALID[chosen], SEGMENTS[chosen].sum(axis=0)),)
    )


def assert_same_bits(a: Moments, b: Moments) -> None:
    for field in fields(Moments):
        assert getattr(a, field.name).tobytes() == getattr(b, field.name).tobytes(), field.name


@st.composite
def tilings(draw: st.DrawFn) -> list[Held]:
    """Parts that cover every replicate of every pixel once, in some order."""
    owner = np.array(draw(st.lists(st.integers(0, 2), min_size=N, max_size=N)))
    parts = []
    for region in range(3):
        pixels = np.flatnonzero(owner == region)
        cuts = sorted({0, N_REPLICATES, *draw(st.lists(st.integers(1, N_REPLICATES - 1), max_size=3))})
        parts += [part(a, b, pixels) for a, b in itertools.pairwise(cuts) if len(pixels)]
    return draw(st.permutations(parts))


@given(tilings())
@settings(max_examples=60, deadline=None, derandomize=True)
def test_parts_joined_in_any_order_have_the_bits_of_a_straight_run(parts: list[Held]) -> None:
    total = Held(Moments.empty(N))
    for one in parts:
        total = join(total, one, SIZE)
    assert not total.waiting
    assert not total.missing
    assert_same_bits(total.head, straight(0, N_REPLICATES))


def test_joining_pairs_of_pairs_gives_the_same_bits() -> None:
    a, b, c, d = (part(first, first + 3) for first in (0, 3, 6, 9))
    joined = join(join(d, b, SIZE), join(c, a, SIZE), SIZE)
    assert_same_bits(joined.head, straight(0, 12))


def test_what_is_missing_is_said_and_what_is_there_counts() -> None:
    held = join(part(0, 3), join(part(5, 7), part(9, 12), SIZE), SIZE)
    assert held.missing == ((3, 5), (7, 9))
    assert held.said_missing == "3:5 and 7:9"
    assert_same_bits(held.head, straight(0, 3))
    moments = held.moments(SIZE)
    assert (moments.tried == 8).all()
    kept = np.r_[0:3, 5:7, 9:12]
    is_whole = (INVALID[kept] < SIZE)[..., None]
    mean = (RADIANCE[kept] * is_whole).sum(axis=0) / is_whole.sum(axis=0)
    np.testing.assert_allclose(moments.mean, mean, rtol=1e-6)
    np.testing.assert_array_equal(moments.segments, SEGMENTS[kept].sum(axis=0))


LEFT, RIGHT = EVERYWHERE[:9], EVERYWHERE[9:]


@pytest.mark.parametrize(
    ("a", "b", "said"),
    [
        (part(0, 6), part(5, 8), "replicates 5:6 of 21 pixels"),
        (part(4, 8), part(6, 7), "replicates 6:7 of 21 pixels"),
        (part(4, 8), part(4, 8), "replicates 4:8 of 21 pixels"),
        (part(0, 6), part(0, 4), "replicates 0:4 of 21 pixels"),
        (part(2, 4, LEFT), part(3, 5, EVERYWHERE[8:10]), "replicates 3:4 of 1 pixels"),
        (part(0, 4, LEFT), part(0, 4, EVERYWHERE[7:]), "replicates 0:4 of 2 pixels"),
    ],
)
def test_a_replicate_that_both_hold_is_refused(a: Held, b: Held, said: str) -> None:
    for one, other in ((a, b), (b, a)):
        with pytest.raises(MergeError, match=said):
            join(one, other, SIZE)


def test_joining_changes_neither_side() -> None:
    a, b = part(0, 6), part(6, 9)
    join(b, join(a, part(9, 12), SIZE), SIZE)
    assert_same_bits(a.head, straight(0, 6))
    assert (b.waiting[0].first, b.waiting[0].end) == (6, 9)


def estimate(held: Held) -> Estimate:
    identity = Identity("a" * 64, "box", {"width": WIDTH, "height": HEIGHT}, 3, ("x",))
    return Estimate(WIDTH, HEIGHT, SIZE, held.moments(SIZE), identity, ranges=((3, 12),), held=held)


def test_a_file_keeps_every_bit_of_what_waits(tmp_path: Path) -> None:
    odd = RADIANCE.copy()
    odd[6, 0] = np.nan, np.inf, -np.inf
    odd[6, 1] = 1e-45, -0.0, 3.4e38
    grey = np.repeat(RADIANCE[9:12, :, :1], 3, axis=2)
    signed = np.zeros((1, len(RIGHT), 3), np.float32)
    signed[..., 1] = -0.0  # equal to 0, of other bits
    none = np.zeros
    blocks = (
        Block(6, LEFT, odd[6:8, LEFT], INVALID[6:8, LEFT], SEGMENTS[6, LEFT]),
        Block(8, RIGHT, signed, none((1, len(RIGHT)), np.uint8), SEGMENTS[8, RIGHT]),
        Block(9, EVERYWHERE, grey, none((3, N), np.uint8), SEGMENTS[9]),
    )
    with np.errstate(all="ignore"):
        estimate(Held(straight(0, 3), blocks)).write(tmp_path / "part.exr")
        read = Estimate.read(tmp_path / "part.exr")
    assert read.held is not None
    assert_same_bits(read.held.head, straight(0, 3))
    for was, now in zip(blocks, read.held.waiting, strict=True):
        assert now.first == was.first
        for name in ("pixels", "radiance", "invalid", "segments"):
            left, right = getattr(was, name), getattr(now, name)
            assert left.dtype == right.dtype, name
            assert left.tobytes() == right.tobytes(), name


def test_a_file_of_which_the_end_is_lost_is_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "part.exr"
    estimate(part(4, 12)).write(path)
    path.write_bytes(path.read_bytes()[:-600])
    with pytest.raises(CheckpointError, match=r"part\.exr"):
        Estimate.read(path)
