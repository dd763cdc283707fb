"""Pictures and grids: their size from the header alone, and whether a picture has colour in it."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderer.errors import SceneError

_ROWS = 64
_COLOUR_TOLERANCE = 1 / 512  # half a step of eight bits


@dataclass(frozen=True, slots=True)
class PictureFacts:
    """width, height in pixels; channels; bytes of one value in the file."""

    width: int
    height: int
    channels: int
    value_bytes: int


def read_picture(path: Path) -> PictureFacts:
    """Size of a picture, from its header. Raises SceneError if it is none."""
    import OpenImageIO as oiio

    with _Opened(path) as image:
        spec = image.spec()
        if spec.depth > 1 or spec.width < 1 or spec.height < 1:
            raise SceneError(f"{path.name}: a picture of {spec.width}×{spec.height}; use a flat one")
        return PictureFacts(spec.width, spec.height, spec.nchannels, oiio.TypeDesc(spec.format).size())


def has_colour(path: Path) -> bool:
    """Whether any pixel's red, green and blue differ. Stops reading at the first that do."""
    with _Opened(path) as image:
        spec = image.spec()
        if spec.nchannels < 3:
            return False
        if spec.tile_width:
            return _differ(np.asarray(image.read_image(0, 0, 0, 3, "float"), np.float32))
        for row in range(spec.y, spec.y + spec.height, _ROWS):
            until = min(row + _ROWS, spec.y + spec.height)
            if _differ(np.asarray(image.read_scanlines(row, until, 0, 0, 3, "float"), np.float32)):
                return True
    return False


def _differ(pixels: NDArray[np.float32]) -> bool:
    highest = pixels.max(axis=-1)
    return bool((highest - pixels.min(axis=-1) > _COLOUR_TOLERANCE * np.maximum(highest, 1e-6)).any())


class _Opened:
    """An open picture file; closed at the end."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.image: Any = None

    def __enter__(self):
        import OpenImageIO as oiio

        self.image = oiio.ImageInput.open(str(self.path))
        if self.image is None:
            why = " ".join(oiio.geterror().split())[:160].replace(str(self.path), self.path.name)
            raise SceneError(f"{self.path.name}: cannot be read as a picture ({why}); export it again")
        return self.image

    def __exit__(self, *_: object) -> None:
        self.image.close()


def read_grid(path: Path) -> int:
    """Values in a Mitsuba volume file (.vol), from its header, checked against the file's size."""
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(24)
    if len(head) < 24 or head[:3] != b"VOL":
        raise SceneError(f"{path.name}: is no Mitsuba volume file (.vol); export it again")
    kind, x, y, z, channels = struct.unpack_from("<5i", head, 4)
    values = x * y * z * channels
    if kind != 1 or min(x, y, z, channels) < 1 or 4 * values > size:
        raise SceneError(
            f"{path.name}: damaged volume file, its header promises {x}×{y}×{z}×{channels} values; export it again"
        )
    return values
