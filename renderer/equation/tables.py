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


def number(value: Any) -> Any:
    """A number that is no part of the kernel's code, so that one kernel serves all values."""
    return dr.opaque(mi.Float, float(np.array(value).ravel()[0]))


def last_up_to(u: Any, values: Any, start: Any, n: Any, most: int, active: Any) -> Any:
    """Which of the n ≤ most rising values from `start` on is the last one up to u; the first one is taken to be."""
    at = mi.UInt32(0)
    for step in (2**i for i in reversed(range((most - 1).bit_length()))):
        further = at + step
        is_there = active & (further < n)
        at = dr.select(is_there & (dr.gather(mi.Float, values, start + further, is_there) <= u), further, at)
    return at


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
