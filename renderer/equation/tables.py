"""Tables that kernels read: NumPy numbers in Dr.Jit's own memory."""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np

from renderer.backend import mitsuba

mi: Any = mitsuba()


def table(values: Any, of_type: Any) -> Any:
    """Numbers as a Dr.Jit array of mi.UInt32 or mi.Float. The alignment of a NumPy array would be compiled into every
    kernel that reads it: hence the copy."""
    dtype = np.uint32 if of_type is mi.UInt32 else np.float32
    copy = of_type(np.ascontiguousarray(values, dtype)) + dr.opaque(of_type, 0)
    dr.eval(copy)
    return copy


def registry_id(plugin: Any) -> int:
    """The number by which Dr.Jit's pointers name a BSDF or an emitter."""
    pointer = mi.BSDFPtr(plugin) if isinstance(plugin, mi.BSDF) else mi.EmitterPtr(plugin)
    number: Any = dr.reinterpret_array(mi.UInt32, pointer)
    return int(number[0])


def arrays_in(*holders: Any) -> list[Any]:
    """The Dr.Jit arrays that objects of ours hold, in a fixed order: what a recorded kernel reads."""
    found: list[Any] = []
    left = list(reversed(holders))
    while left:
        one = left.pop()
        if dr.is_array_v(one):
            found.append(one)
        elif isinstance(one, list | tuple):
            left += reversed(one)
        elif type(one).__module__.startswith("renderer.") and hasattr(one, "__dict__"):
            left += reversed(vars(one).values())
    return found
