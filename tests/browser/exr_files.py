"""Pictures as files, by OpenImageIO, for tests of what the page reads."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray


def write(
    path: Path,
    pixels: NDArray[Any],
    names: list[str] | None = None,
    types: list[str] | None = None,
    **attributes: Any,
) -> Path:
    """(H, W, C) values as a file."""
    height, width, count = pixels.shape
    same = types[0] if types and len(set(types)) == 1 else None
    spec = oiio.ImageSpec(width, height, count, same or "float")
    if names:
        spec.channelnames = tuple(names)
    if types and not same:
        spec.channelformats = tuple(types)
    for key, value in attributes.items():
        if key.startswith("spec_"):
            setattr(spec, key[5:], value)
        else:
            spec.attribute(key, value)
    out = oiio.ImageOutput.create(str(path))
    assert out is not None, oiio.geterror()
    assert out.open(str(path), spec), out.geterror()
    assert out.write_image(np.ascontiguousarray(pixels, np.uint32 if same == "uint" else np.float32)), out.geterror()
    assert out.close()
    return path


def values(path: Path, kind: str = "float") -> NDArray[Any]:
    """(H, W, C) values of a file."""
    pixels = oiio.ImageBuf(str(path)).get_pixels(kind)
    assert pixels is not None, oiio.geterror()
    return pixels


def names(path: Path) -> list[str]:
    """Its channels, in the order of `values`."""
    return list(oiio.ImageBuf(str(path)).spec().channelnames)
