"""Tone mapping for PNG only: measurements never pass through here."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def to_srgb8(radiance: NDArray, exposure: float = 0.0) -> NDArray[np.uint8]:
    """(H, W, 3) sRGB bytes of linear radiance, exposure in stops; clipped at white. NaN becomes magenta, to be seen."""
    linear = np.asarray(radiance, np.float32) * np.float32(2.0**exposure)
    unseen = ~np.isfinite(linear).all(axis=-1)
    linear = np.clip(np.nan_to_num(linear), 0, 1)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.power(linear, 1 / 2.4) - 0.055)
    picture = (encoded * 255 + 0.5).astype(np.uint8)
    picture[unseen] = (255, 0, 255)
    return picture


def write_png(path: str, picture: NDArray[np.uint8]) -> None:
    """Writes (H, W, 3) sRGB bytes as PNG."""
    import OpenImageIO as oiio

    height, width, channels = picture.shape
    out = oiio.ImageOutput.create(path)
    spec = oiio.ImageSpec(width, height, channels, "uint8")
    spec.attribute("oiio:ColorSpace", "sRGB")
    if not out or not out.open(path, spec) or not out.write_image(np.ascontiguousarray(picture)):
        raise OSError(f"cannot write {path}: {out.geterror() if out else oiio.geterror()}")
    out.close()
