"""Facts about pictures to look at: sRGB, clipped, and what is not finite is seen."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from renderer.image.picture import ToneMap, to_srgb8
from tests.files import write_png


def grey(*values: float) -> np.ndarray:
    return np.repeat(np.array(values, np.float32)[None, :, None], 3, axis=2)


def test_bytes_follow_the_srgb_curve() -> None:
    linear = np.linspace(0, 1, 4001)
    curve = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    difference = to_srgb8(grey(*linear))[0, :, 0] - 255 * curve
    assert np.abs(difference).max() <= 0.501


def test_known_greys_have_their_known_bytes() -> None:
    assert to_srgb8(grey(0, 0.18, 0.5, 1))[0, :, 0].tolist() == [0, 118, 188, 255]


def test_every_byte_survives_decoding_and_encoding() -> None:
    encoded = np.arange(256) / 255
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    assert to_srgb8(grey(*linear))[0, :, 1].tolist() == list(range(256))


def test_brighter_radiance_never_gives_a_darker_byte() -> None:
    values = to_srgb8(grey(*np.geomspace(1e-20, 1e20, 500)))[0, :, 2].astype(int)
    assert (np.diff(values) >= 0).all()
    assert (values[0], values[-1]) == (0, 255)


@pytest.mark.parametrize("value", [1.0, 7.0, 65504.0, 1e20, 3e38])
def test_what_is_brighter_than_white_is_white(value: float) -> None:
    assert (to_srgb8(grey(value)) == 255).all()


def test_negative_radiance_is_black() -> None:
    assert (to_srgb8(grey(-1e-9, -1.0, -1e20)) == 0).all()


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("channel", [0, 1, 2])
def test_a_pixel_that_is_not_finite_is_magenta(value: float, channel: int) -> None:
    image = grey(0.5, 0.5)
    image[0, 1, channel] = value
    assert to_srgb8(image)[0].tolist() == [[188, 188, 188], [255, 0, 255]]


def test_one_stop_of_exposure_doubles_the_radiance() -> None:
    image = grey(*np.linspace(0, 0.25, 50))
    np.testing.assert_array_equal(to_srgb8(image, exposure=2), to_srgb8(4 * image))
    np.testing.assert_array_equal(to_srgb8(image, exposure=-1), to_srgb8(image / 2))


def test_the_radiance_is_left_as_it_was() -> None:
    image = np.array([[[np.nan, 2.0, -1.0]]])
    before = image.copy()
    to_srgb8(image, exposure=1)
    np.testing.assert_array_equal(image, before)


def test_a_png_holds_the_bytes_it_was_given(tmp_path: Path) -> None:
    picture = np.random.default_rng(0).integers(0, 256, (5, 7, 3), np.uint8)
    write_png(str(tmp_path / "a.png"), picture)
    source = oiio.ImageInput.open(str(tmp_path / "a.png"))
    assert source is not None
    np.testing.assert_array_equal(source.read_image("uint8"), picture)
    source.close()


def test_a_view_with_strides_is_written_like_its_copy(tmp_path: Path) -> None:
    picture = np.random.default_rng(0).integers(0, 256, (5, 14, 3), np.uint8)[::-1, ::2]
    write_png(str(tmp_path / "a.png"), picture)
    write_png(str(tmp_path / "b.png"), picture.copy())
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_a_png_that_cannot_be_written_is_an_error_that_names_it(tmp_path: Path) -> None:
    with pytest.raises(OSError, match=r"a\.png"):
        write_png(str(tmp_path / "none" / "a.png"), np.zeros((1, 1, 3), np.uint8))


@pytest.mark.parametrize("tone", ["srgb", "filmic", "reinhard"])
def test_every_tone_map_keeps_black_and_order_up_to_the_largest_number(tone: ToneMap) -> None:
    values = to_srgb8(grey(0, *np.geomspace(1e-6, 3e38, 500)), tone=tone)[0, :, 1].astype(int)
    assert values[0] == 0
    assert (np.diff(values) >= 0).all()


def test_tone_maps_are_their_published_formulas() -> None:
    def encoded(linear: float) -> int:
        return round(255 * (1.055 * linear ** (1 / 2.4) - 0.055))

    filmic = (0.18 * (2.51 * 0.18 + 0.03)) / (0.18 * (2.43 * 0.18 + 0.59) + 0.14)
    assert to_srgb8(grey(0.18), tone="filmic")[0, 0, 0] == encoded(filmic)
    # By luminance: the ratios of the channels stay.
    red = to_srgb8(np.array([[[4.0, 1.0, 0.0]]], np.float32), tone="reinhard")[0, 0].tolist()
    white = 1 + 4 * 0.2126 + 0.7152
    assert red == [255, encoded(1 / white), 0]
