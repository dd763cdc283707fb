"""What the page, the pixel read-out and the PNG need of an estimate, as a file that two processes share.

The render process writes one per turn into shared memory and renames it; the server maps it. A map stays
valid after the file is replaced, so readers never see half a picture.
"""

from __future__ import annotations

import json
import math
import mmap
import os
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from renderer.estimate.interval import standard_error as known_error

if TYPE_CHECKING:
    from renderer import Estimate

_ALIGN = 64
_PART = 1 << 14  # pixels whose numbers stay in the processor's cache


@dataclass(frozen=True, slots=True)
class Display:
    """One snapshot, reduced to what is shown.

    radiance: (H, W, 3) float32, W·sr⁻¹·m⁻², pixels without samples filled from a neighbour.
    standard_error: (H, W, 4) float32 of R, G, B and luminance Y; NaN where it is not known.
    replicates: (H, W) uint32. trusted: (H, W) bool. seconds: of rendering.
    """

    seq: int
    replicate_size: int
    seconds: float
    radiance: NDArray[np.float32]
    standard_error: NDArray[np.float32]
    replicates: NDArray[np.uint32]
    trusted: NDArray[np.bool_]

    @property
    def height(self) -> int:
        """Rows."""
        return self.radiance.shape[0]

    @property
    def width(self) -> int:
        """Columns."""
        return self.radiance.shape[1]


def display_bytes(display: Display) -> int:
    """What its arrays take."""
    arrays = (display.radiance, display.standard_error, display.replicates, display.trusted)
    return sum(array.nbytes for array in arrays)


def display_of(estimate: Estimate, *, seq: int, seconds: float) -> Display:
    """The display of an estimate."""
    standard_error = np.empty((estimate.height * estimate.width, 4), np.float32)
    trusted = estimate.trust.ravel()
    for start in range(0, len(standard_error), _PART):
        part = slice(start, start + _PART)
        standard_error[part] = known_error(estimate.moments.at(part), trusted[part])
    return Display(
        seq=seq,
        replicate_size=estimate.replicate_size,
        seconds=seconds,
        radiance=estimate.filled(),
        standard_error=standard_error.reshape(estimate.height, estimate.width, 4),
        replicates=np.ascontiguousarray(estimate.count, dtype=np.uint32),
        trusted=np.ascontiguousarray(estimate.trust, dtype=np.bool_),
    )


def write_display(display: Display, path: Path) -> None:
    """Write under a temporary name and rename: a reader finds the old picture or the new one."""
    arrays = (display.radiance, display.standard_error, display.replicates, display.trusted)
    header: dict[str, Any] = {
        "seq": display.seq,
        "replicate_size": display.replicate_size,
        "seconds": display.seconds,
        "shape": [display.height, display.width],
    }
    text = json.dumps(header).encode()
    start = -(-(4 + len(text)) // _ALIGN) * _ALIGN
    # Cleaners of temporary files may take a folder that has been quiet for long.
    path.parent.mkdir(mode=0o700, exist_ok=True)
    temporary = path.with_name(path.name + ".part")
    try:
        with temporary.open("wb") as file:
            file.write((struct.pack("<I", start - 4) + text).ljust(start, b" "))
            for array in arrays:
                file.write(np.ascontiguousarray(array).data)
        os.replace(temporary, path)
    except OSError:
        temporary.unlink(missing_ok=True)  # where there is no room, half a picture must not take what is left
        raise


def read_display(path: Path) -> Display:
    """Map a display file. Raises FileNotFoundError."""
    with path.open("rb") as file:
        mapped = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    (length,) = struct.unpack_from("<I", mapped)
    header = json.loads(mapped[4 : 4 + length])
    height, width = header["shape"]
    offset = 4 + length

    def take(dtype: Any, *shape: int) -> NDArray[Any]:
        nonlocal offset
        array = np.frombuffer(mapped, dtype=dtype, count=math.prod(shape), offset=offset).reshape(shape)
        offset += array.nbytes
        return array

    return Display(
        seq=header["seq"],
        replicate_size=header["replicate_size"],
        seconds=header["seconds"],
        radiance=take(np.float32, height, width, 3),
        standard_error=take(np.float32, height, width, 4),
        replicates=take(np.uint32, height, width),
        trusted=take(np.bool_, height, width),
    )
