"""A region of interest: the pixels whose error a target asks about, as a crop or a mask."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderer.errors import SettingsError, check_name


@dataclass(frozen=True, slots=True)
class Region:
    """Crop of width × height pixels at (x, y), from the top left; with `mask`, those of its pixels that are set.

    mask: the bits of a (height, width) image, eight to a byte, as `numpy.packbits` makes them.
    """

    x: int
    y: int
    width: int
    height: int
    mask: bytes | None = None

    def __post_init__(self) -> None:
        for name, low in (("x", 0), ("y", 0), ("width", 1), ("height", 1)):
            value = getattr(self, name)
            value = value.item() if isinstance(value, np.generic) else value
            if isinstance(value, bool) or not isinstance(value, int) or value < low:
                raise SettingsError(f"region {name} is {value!r}; it must be a whole number of pixels from {low}")
            object.__setattr__(self, name, value)
        if self.mask is not None and not any(self.mask):
            raise SettingsError("the region's mask is empty; set at least one pixel")

    @classmethod
    def of(cls, value: Any) -> Region:
        """From [x, y, width, height] or a (H, W) mask. Raises SettingsError."""
        if isinstance(value, Region):
            return value
        if isinstance(value, np.ndarray) and value.ndim == 2:
            height, width = value.shape
            return cls(0, 0, width, height, np.packbits(value.astype(bool)).tobytes())
        try:
            x, y, width, height = value
        except (TypeError, ValueError):
            raise SettingsError(f"region is {value!r}; give [x, y, width, height] or a mask (H, W)") from None
        return cls(x, y, width, height)

    @classmethod
    def read(cls, path: str | Path) -> Region:
        """From an image file whose pixels are not black where they count."""
        import OpenImageIO as oiio

        check_name(Path(path), "the region's mask", SettingsError)
        pixels = oiio.ImageBuf(str(path)).get_pixels("float") if Path(path).is_file() else None
        if pixels is None or not pixels.size:
            raise SettingsError(f"region {path}: no such image; give x,y,width,height or an image file as a mask")
        return cls.of(np.asarray(pixels).reshape(*pixels.shape[:2], -1)[..., :3].any(axis=-1))

    def scope(self, width: int, height: int) -> NDArray[np.bool_]:
        """(width · height,) the pixels of an image that it covers. Raises SettingsError where it reaches outside."""
        if self.x + self.width > width or self.y + self.height > height:
            raise SettingsError(f"region {self.as_list()} reaches outside the image of {width}×{height}")
        inside = np.zeros((height, width), bool)
        covered: NDArray[Any] | bool = True
        if self.mask is not None:
            bits = np.unpackbits(np.frombuffer(self.mask, np.uint8), count=self.width * self.height)
            covered = bits.astype(bool).reshape(self.height, self.width)
        inside[self.y : self.y + self.height, self.x : self.x + self.width] = covered
        return inside.ravel()

    @property
    def name(self) -> str:
        """Tells it from other regions: x, y, width, height and, of a mask, a digest."""
        mask = "" if self.mask is None else f" {hashlib.sha256(self.mask).hexdigest()[:16]}"
        return ",".join(map(str, self.as_list())) + mask

    def as_list(self) -> list[int]:
        """[x, y, width, height]."""
        return [self.x, self.y, self.width, self.height]
