"""What strangers' scenes say of themselves, in sizes fit for lists: a shape's name may be 100 kB long."""

from __future__ import annotations

from typing import Any

MOST_CHARACTERS, MOST_ENTRIES, MOST_DEPTH = 300, 100, 6


def shown(value: Any, depth: int = 0) -> Any:
    """A JSON value with long texts and long lists cut, and what was cut said."""
    if isinstance(value, str):
        return value if len(value) <= MOST_CHARACTERS else f"{value[: MOST_CHARACTERS - 1]}…"
    if depth >= MOST_DEPTH and isinstance(value, dict | list | tuple):
        return type(value)()
    if isinstance(value, dict):
        return {shown(key): shown(one, depth + 1) for key, one in list(value.items())[:MOST_ENTRIES]}
    if isinstance(value, list | tuple):
        told = [shown(one, depth + 1) for one in value[:MOST_ENTRIES]]
        if len(value) > MOST_ENTRIES and all(isinstance(one, str) for one in value):
            told[-1] = f"… and {len(value) - MOST_ENTRIES + 1} more"
        return type(value)(told)
    return value
