"""Tone mapping for PNG only: measurements never pass through here. The page's shaders have the same formulas."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

ToneMap = Literal["srgb", "filmic", "reinhard"]
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)
_WHITE = 1e6  # of the filmic curve: its square is still a float32


def to_srgb8(radiance: NDArray, exposure: float = 0.0, tone: ToneMap = "srgb") -> NDArray[np.uint8]:
    """(H, W, 3) sRGB bytes of linear radiance, exposure in stops; clipped at white. NaN becomes magenta, to be seen."""
    linear = np.asarray(radiance, np.float32) * np.float32(2.0**exposure)
    unseen = ~np.isfinite(linear).all(axis=-1)
    linear = np.clip(_toned(np.maximum(np.nan_to_num(linear), 0), tone), 0, 1)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.power(linear, 1 / 2.4) - 0.055)
    picture = (encoded * 255 + 0.5).astype(np.uint8)
    picture[unseen] = (255, 0, 255)
    return picture


def _toned(linear: NDArray, tone: ToneMap) -> NDArray:
    """filmic: the fit of Narkowicz (2016) to the ACES curve. reinhard: by luminance, Reinhard et al. (2002)."""
    if tone == "filmic":
        c = np.minimum(linear, _WHITE)
        return (c * (2.51 * c + 0.03)) / (c * (2.43 * c + 0.59) + 0.14)
    if tone == "reinhard":
        return linear / (1 + (linear @ _LUMINANCE)[..., None])
    return linear


def with_alpha(radiance: NDArray, alpha: NDArray, exposure: float = 0.0, tone: ToneMap = "srgb") -> NDArray[np.uint8]:
    """(H, W, 4) sRGB bytes and alpha. Radiance is what a pixel's covered part adds to it; PNG wants that part's own."""
    covered = np.clip(np.nan_to_num(np.asarray(alpha, np.float32).reshape(*radiance.shape[:2], 1)), 0, 1)
    colour = to_srgb8(np.asarray(radiance, np.float32) / np.where(covered > 0, covered, 1), exposure, tone)
    return np.concatenate([colour, (covered * 255 + 0.5).astype(np.uint8)], axis=-1)
