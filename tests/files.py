"""What tests alone write and read: PNGs as textures, and frames as the page decodes them."""

from __future__ import annotations

import struct

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from service.frames import MAGIC
from service.messages import FrameHeader


def write_png(path: str, picture: NDArray[np.uint8]) -> None:
    """Writes (H, W, 3) or (H, W, 4) sRGB bytes as PNG."""
    height, width, channels = picture.shape
    out = oiio.ImageOutput.create(path)
    spec = oiio.ImageSpec(width, height, channels, "uint8")
    spec.attribute("oiio:ColorSpace", "sRGB")
    if not out or not out.open(path, spec) or not out.write_image(np.ascontiguousarray(picture)):
        raise OSError(f"cannot write {path}: {out.geterror() if out else oiio.geterror()}")
    out.close()


def decode_frame(body: bytes) -> tuple[FrameHeader, NDArray[np.float64]]:
    """Header and planes (H, W, 4 or 5) of an uncompressed body: the inverse of `encode_frame`, up to rounding."""
    if body[:4] != MAGIC:
        raise ValueError(f"a frame starts with {MAGIC!r}, this starts with {body[:4]!r}")
    (length,) = struct.unpack_from("<I", body, 4)
    header = FrameHeader.model_validate_json(body[8 : 8 + length])
    low_high = np.frombuffer(body, dtype=np.uint8, offset=8 + length).reshape(2, -1)
    halves = np.ascontiguousarray(low_high.T).view(np.float16)
    planes = halves.reshape(len(header.channels), header.height, header.width).transpose(1, 2, 0).astype(np.float64)
    planes[..., :4] /= header.scale
    return header, planes
