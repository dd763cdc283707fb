"""Frames: what goes in comes out, within half precision, whatever the scale."""

from __future__ import annotations

import asyncio
import gzip
import math
import struct
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from renderer.estimate.estimate import Estimate, Identity
from renderer.estimate.moments import Moments
from service.display import Display, display_of, read_display, write_display
from service.frames import MAGIC, FrameCache, choose_encoding, compress, encode_frame, scale_for
from service.pixels import read_pixel
from tests.files import decode_frame

HALF_PRECISION = 2.0**-11


def display(radiance: NDArray[np.float32], error: NDArray[np.float32] | None = None, replicates: int = 8) -> Display:
    height, width = radiance.shape[:2]
    errors = np.repeat((np.full((height, width), 0.1) if error is None else error)[..., None], 4, axis=-1)
    return Display(
        seq=7,
        replicate_size=16,
        seconds=1.5,
        radiance=radiance.astype(np.float32),
        standard_error=errors.astype(np.float32),
        replicates=np.full((height, width), replicates, dtype=np.uint32),
        trusted=np.ones((height, width), dtype=np.bool_),
    )


def noise(height: int = 6, width: int = 5) -> NDArray[np.float32]:
    return np.random.default_rng(1).uniform(0.1, 1.0, (height, width, 3)).astype(np.float32)


@pytest.mark.parametrize("exponent", [-37, -20, -6, 0, 6, 20, 37])
def test_a_frame_keeps_values_at_every_scale(exponent: int) -> None:
    radiance = (noise() * 10.0**exponent).astype(np.float32)
    error = (radiance[..., 1] * 0.05).astype(np.float32)
    header, planes = decode_frame(encode_frame(display(radiance, error)))
    assert math.frexp(header.scale)[0] == 0.5  # a power of two
    np.testing.assert_allclose(planes[..., :3], radiance, rtol=HALF_PRECISION)
    np.testing.assert_allclose(planes[..., 3], error, rtol=HALF_PRECISION)
    assert header.clamped == 0


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(0, 2.0**99, width=32), min_size=12, max_size=12))
def test_finite_stays_finite_and_a_positive_error_stays_positive(values: list[float]) -> None:
    numbers = np.array(values, dtype=np.float32)
    shown = display(numbers.reshape(2, 2, 3), np.abs(numbers[:4]).reshape(2, 2))
    _, planes = decode_frame(encode_frame(shown))
    assert np.isfinite(planes).all()
    assert ((planes[..., 3] > 0) == (shown.standard_error[..., 3] > 0)).all()


def test_a_pixel_that_found_nothing_shows_no_error_and_no_interval() -> None:
    moments = Moments.empty(2)
    for k in range(16):
        moments.add(slice(None), np.array([[1 + k % 2, 1, 1], [0, 0, 0]], np.float32), np.zeros(2, np.uint32), 4)
    shown = display_of(Estimate(2, 1, 4, moments, Identity("d", "two", {}, 1)), seq=1, seconds=1.0)
    lit, black = read_pixel(shown, 0, 0), read_pixel(shown, 1, 0)
    assert lit.standard_error[3]
    assert lit.interval
    assert (black.value, black.standard_error, black.interval) == ([0, 0, 0], [None] * 4, None)
    _, planes = decode_frame(encode_frame(shown))
    assert np.isfinite(planes[0, 0, 3])
    assert planes[0, 1, 3] == np.inf


def test_nan_and_inf_are_kept() -> None:
    radiance = noise()
    radiance[0, 0] = np.nan
    radiance[1, 1] = np.inf
    _, planes = decode_frame(encode_frame(display(radiance)))
    assert np.isnan(planes[0, 0, :3]).all()
    assert np.isinf(planes[1, 1, :3]).all()
    assert np.isfinite(planes[2:]).all()


def test_one_firefly_is_clamped_and_does_not_blacken_the_rest() -> None:
    radiance = noise(16, 16)
    radiance[3, 3] = 1e25
    header, planes = decode_frame(encode_frame(display(radiance)))
    others = np.ones((16, 16), dtype=bool)
    others[3, 3] = False
    np.testing.assert_allclose(planes[others][:, :3], radiance[others], rtol=HALF_PRECISION)
    assert header.clamped == 3
    assert np.isfinite(planes[3, 3]).all()


def test_without_two_replicates_the_error_is_infinite() -> None:
    shown = display(noise(), np.full((6, 5), np.nan, dtype=np.float32), replicates=1)
    _, planes = decode_frame(encode_frame(shown))
    assert np.isposinf(planes[..., 3]).all()


def test_an_all_black_frame_has_scale_one() -> None:
    assert scale_for(np.zeros((2, 2, 4), dtype=np.float32)) == 1.0


def test_halving_averages_and_adds_errors_in_quadrature() -> None:
    radiance = noise(5, 7)
    header, planes = decode_frame(encode_frame(display(radiance), reduce=2))
    assert (header.height, header.width, header.reduce) == (3, 4, 2)
    np.testing.assert_allclose(planes[0, 0, :3], radiance[:2, :2].mean(axis=(0, 1)), rtol=2 * HALF_PRECISION)
    np.testing.assert_allclose(planes[0, 0, 3], 0.1 * math.sqrt(4) / 4, rtol=HALF_PRECISION)
    np.testing.assert_allclose(planes[2, 3, :3], radiance[4, 6], rtol=HALF_PRECISION)
    np.testing.assert_allclose(planes[2, 3, 3], 0.1, rtol=HALF_PRECISION)


def test_the_layout_is_as_documented() -> None:
    body = encode_frame(display(noise()))
    (length,) = struct.unpack_from("<I", body, 4)
    assert body[:4] == MAGIC
    assert (8 + length) % 8 == 0
    header, planes = decode_frame(body)
    pixels = header.width * header.height
    assert len(body) == 8 + length + pixels * 8
    start = 8 + length
    red = np.frombuffer(body[start : start + pixels], np.uint8).astype(np.uint16)
    red |= np.frombuffer(body[start + 4 * pixels : start + 5 * pixels], np.uint8).astype(np.uint16) << 8
    np.testing.assert_array_equal(red.view(np.float16).astype(float) / header.scale, planes[..., 0].ravel())


@pytest.mark.parametrize(
    ("accept", "chosen"),
    [
        ("", "identity"),
        ("gzip, deflate", "gzip"),
        ("gzip, deflate, br, zstd", "zstd"),
        ("zstd;q=0, gzip", "gzip"),
        ("ZSTD", "zstd"),
        ("gzip;q=nonsense", "identity"),
    ],
)
def test_the_encoding_is_one_that_the_client_accepts(accept: str, chosen: str) -> None:
    assert choose_encoding(accept) == chosen


def test_compressed_bodies_unpack_to_the_same_bytes() -> None:
    body = encode_frame(display(noise()))
    assert zstandard.ZstdDecompressor().decompress(compress(body, "zstd")) == body
    assert gzip.decompress(compress(body, "gzip")) == body
    assert compress(body, "identity") == body


def test_the_cache_drops_the_least_recently_used() -> None:
    cache = FrameCache(limit_bytes=20)
    cache.put(("a",), b"0123456789")
    cache.put(("b",), b"0123456789")
    assert cache.get(("a",)) is not None
    cache.put(("c",), b"0123456789")
    assert cache.get(("b",)) is None
    assert cache.get(("a",)) is not None


def test_a_newer_frame_takes_the_place_of_an_older_one() -> None:
    """128 MiB of frames that nobody asks for any more would be kept otherwise."""
    cache = FrameCache()
    cache.put(("a",), b"old", 1)
    cache.put(("a",), b"new", 2)
    cache.put(("a",), b"late", 1)
    assert cache.get(("a",), 2) == b"new"
    assert cache.get(("a",), 1) is None


def test_a_body_is_made_once_for_all_who_ask_at_the_same_time() -> None:
    cache, made = FrameCache(), 0

    async def ask() -> None:
        nonlocal made
        async with cache.making(("k",)):
            if cache.get(("k",)) is None:
                await asyncio.sleep(0.01)
                made += 1
                cache.put(("k",), b"body")

    async def many() -> None:
        await asyncio.gather(*(ask() for _ in range(8)))

    asyncio.run(many())
    assert made == 1


def test_a_display_file_reads_back_as_written_even_after_it_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "a.display"
    first = display(noise(3, 9))
    write_display(first, path)
    mapped = read_display(path)
    write_display(display(noise(3, 9) * 2), path)
    np.testing.assert_array_equal(mapped.radiance, first.radiance)
    np.testing.assert_array_equal(mapped.standard_error, first.standard_error)
    np.testing.assert_array_equal(mapped.replicates, first.replicates)
    assert (mapped.seq, mapped.width, mapped.height, mapped.replicate_size) == (7, 9, 3, 16)


@pytest.mark.parametrize("reduce", [1, 2])
def test_maps_carry_replicates_and_trust_unscaled(reduce: Literal[1, 2]) -> None:
    shown = display(noise(4, 4) * 1e-3)
    shown.replicates[:] = [[0, 2, 8, 8], [2, 2, 8, 8], [9, 9, 40, 40], [9, 9, 40, 70_000]]
    shown.trusted[:2, :2] = False
    header, planes = decode_frame(encode_frame(shown, reduce, has_maps=True))
    assert header.channels == ["R", "G", "B", "SE", "N"]
    assert header.scale > 1
    trusted = ~np.signbit(planes[..., 4])
    if reduce == 1:
        np.testing.assert_array_equal(np.abs(planes[..., 4]), np.minimum(shown.replicates, 65504))
        np.testing.assert_array_equal(trusted, shown.trusted)
    else:
        np.testing.assert_array_equal(np.abs(planes[..., 4]), [[0, 8], [9, 40]])
        np.testing.assert_array_equal(trusted, [[False, True], [True, True]])
