"""Facts about regions: crops and masks cover what they say, and reach nowhere else."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest

from renderer.errors import SettingsError
from renderer.region import Region


def test_a_crop_covers_its_rectangle() -> None:
    inside = Region.of([2, 1, 3, 2]).scope(8, 4).reshape(4, 8)
    assert inside[1:3, 2:5].all()
    assert inside.sum() == 6


def test_a_mask_covers_its_pixels_and_equals_itself() -> None:
    mask = np.random.default_rng(0).random((5, 9)) < 0.4
    np.testing.assert_array_equal(Region.of(mask).scope(9, 5).reshape(5, 9), mask)
    assert Region.of(mask) == Region.of(mask.copy())
    assert hash(Region.of(mask)) == hash(Region.of(mask.copy()))


@pytest.mark.parametrize(
    "bad", [[1, 2, 3], "1,2,3,4,5", [0, 0, 0, 4], [-1, 0, 2, 2], [0, 0, 1.5, 2], 7, np.zeros((3, 3))]
)
def test_what_is_no_region_is_refused(bad: Any) -> None:
    with pytest.raises(SettingsError, match="region"):
        Region.of(bad)


def test_a_region_outside_the_image_is_refused_with_both_sizes() -> None:
    with pytest.raises(SettingsError, match=r"\[4, 0, 5, 1\] reaches outside the image of 8×4"):
        Region.of([4, 0, 5, 1]).scope(8, 4)


def test_a_mask_is_read_from_an_image(tmp_path: Path) -> None:
    mask = np.zeros((6, 10), np.float32)
    mask[2:4, 3:7] = 1
    assert oiio.ImageBuf(mask[..., None]).write(str(tmp_path / "mask.png"))
    np.testing.assert_array_equal(Region.read(tmp_path / "mask.png").scope(10, 6).reshape(6, 10), mask > 0)
    with pytest.raises(SettingsError, match="no such image"):
        Region.read(tmp_path / "none.png")
