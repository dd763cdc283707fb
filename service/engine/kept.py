"""Runs inside a worker: values that stay there until they are fetched, and calls that use them."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

_KEPT_VALUES = 64  # of calls whose value nobody came for
_values: OrderedDict[int, Any] = OrderedDict()


class ValueGone(Exception):
    """An argument names a value that this worker does not have: it was fetched, or its worker died."""


@dataclass(frozen=True, slots=True)
class Ref:
    """Stands for a kept value among the arguments of a call."""

    id: int


def run(handle_id: int, call: Callable[..., Any], args: tuple[object, ...], is_brought: bool = False) -> Any:
    """Make a call and keep its value, or return it if it is to be brought."""
    for arg in args:
        if isinstance(arg, Ref) and arg.id not in _values:
            raise ValueGone(f"value {arg.id} is not here")
    value = call(*(_values[arg.id] if isinstance(arg, Ref) else arg for arg in args))
    if is_brought:
        return value
    _values[handle_id] = value
    while len(_values) > _KEPT_VALUES:
        _values.popitem(last=False)
    return None


def take(handle_id: int) -> tuple[bool, Any]:
    """Whether a value is here, and the value, which is kept no longer."""
    return handle_id in _values, _values.pop(handle_id, None)
