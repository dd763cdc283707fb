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
# What Mitsuba reads, by how a file begins, and OpenImageIO's name for it. Names of files say nothing: some choose a
# reader that makes up a picture, or take options behind a question mark.
_BEGINNINGS = (
    (b"\x89PNG\r\n\x1a\n", "png"),
    (b"\xff\xd8", "jpeg"),
    (b"v/1\x01", "openexr"),
    (b"#?", "hdr"),
    (b"BM", "bmp"),
    (b"PF", "pnm"),
    (b"Pf", "pnm"),
    (b"P6", "pnm"),
)
_TARGA_END = b"TRUEVISION-XFILE."
GRID_HEADER_BYTES = 48
_GRID_VERSION, _FLOAT32 = 3, 1  # the only ones that Mitsuba reads
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

        kind = _kind_of(self.path)
        self.image = oiio.ImageInput.open(str(self.path))
        if self.image is None:
            why = " ".join(oiio.geterror().split())[:160].replace(str(self.path), self.path.name)
            raise SceneError(f"{self.path.name}: cannot be read as a picture ({why}); export it again")
        if self.image.format_name() != kind:
            self.image.close()
            raise _no_picture(self.path)
        return self.image

    def __exit__(self, *_: object) -> None:
        self.image.close()


def _kind_of(path: Path) -> str:
    """OpenImageIO's name of a picture's format, as Mitsuba tells it: by its content."""
    with path.open("rb") as file:
        start = file.read(8)
        for beginning, kind in _BEGINNINGS:
            if start.startswith(beginning):
                return kind
        file.seek(max(0, path.stat().st_size - len(_TARGA_END) - 1))
        if file.read(len(_TARGA_END)) == _TARGA_END:
            return "targa"
    raise _no_picture(path)


def _no_picture(path: Path) -> SceneError:
    return SceneError(
        f"{path.name}: cannot be read as a picture (it is of no format that Mitsuba reads); export it as PNG, JPEG, "
        "OpenEXR, Radiance, BMP, TGA, PFM or PPM"
    )


@dataclass(frozen=True, slots=True)
class GridFacts:
    """Numbers of voxels along x, y and z; channels of each."""

    x: int
    y: int
    z: int
    channels: int

    @property
    def values(self) -> int:
        """How many numbers there are."""
        return self.x * self.y * self.z * self.channels


def read_grid(path: Path, least: int = 1) -> GridFacts:
    """What a volume file holds, from its header, checked against the file's size. least: voxels along each side."""
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(GRID_HEADER_BYTES)
    if len(head) < GRID_HEADER_BYTES or head[:3] != b"VOL":
        raise SceneError(f"{path.name}: is no Mitsuba volume file (.vol); export it again")
    version, kind, x, y, z, channels = struct.unpack_from("<B5i", head, 3)
    found = GridFacts(x, y, z, channels)
    if (
        version != _GRID_VERSION
        or kind != _FLOAT32
        or min(x, y, z, channels) < 1
        or GRID_HEADER_BYTES + 4 * found.values > size
    ):
        raise SceneError(
            f"{path.name}: damaged volume file, its header promises {x}×{y}×{z}×{channels} values; export it again"
        )
    if min(x, y, z) < least:
        raise SceneError(f"{path.name}: a volume of {x}×{y}×{z} values; this kind needs {least} along each side")
    corners = struct.unpack_from("<6f", head, 24)
    if not np.isfinite(corners).all():
        raise SceneError(f"{path.name}: damaged volume file, its bounds are {corners}; export it again")
    return found
