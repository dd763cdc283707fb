"""Values of grids: those of Mitsuba's volume files (.vol), and of arrays that were handed over in memory."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderer.errors import SceneError
from renderer.scene.files.picture import GRID_HEADER_BYTES, GridFacts

MOST_VALUE = 1e30  # beyond it, products of a few values leave float32
MATRIX_CHANNELS = 6  # of a symmetric matrix in each voxel, as `sggx` takes them: those may be negative
_AT_ONCE = 1 << 22  # values that are looked at together


def check_file(path: Path, facts: GridFacts, *, is_signed: bool = False) -> None:
    """Refuses values in a volume file that no medium, no texture and (is_signed) no distance field can have."""
    values = np.memmap(path, np.dtype("<f4"), "r", GRID_HEADER_BYTES, (facts.values,))
    check_values(values, path.name, is_signed=is_signed or facts.channels == MATRIX_CHANNELS)


def check_values(values: NDArray[Any], name: str, *, is_signed: bool) -> None:
    """Refuses numbers that are not finite, huge, or negative where none may be. values: (n,)."""
    for start in range(0, len(values), _AT_ONCE):
        part = np.asarray(values[start : start + _AT_ONCE], np.float64)
        wrong = ~np.isfinite(part) | (np.abs(part) > MOST_VALUE)
        if not is_signed:
            wrong |= part < 0
        if wrong.any():
            at = int(np.argmax(wrong))
            low = f"-{MOST_VALUE:g}" if is_signed else "0"
            raise SceneError(
                f"{name}: the grid's value number {start + at} is {part[at]:g}; values go from {low} to "
                f"{MOST_VALUE:g}, mend that voxel"
            )


def channels_of(shape: tuple[int, ...]) -> int:
    """Channels of a grid in memory: (z, y, x) or (z, y, x, channels)."""
    return shape[3] if len(shape) == 4 else 1
