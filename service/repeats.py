"""Lines of a log that come again and again are counted instead of repeated: a log must not fill a disk."""

from __future__ import annotations

import logging
import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from typing import Any

_SAME, _ALIKE = 5, 1500  # lines that are told of a kind within `_SECONDS`: the very same ones, and those of one event
_SECONDS = 30.0
_MOST_KINDS = 2000
_VOLATILE = frozenset({"timestamp", "request", "ms", "level"})  # that differ from line to line and say nothing new


class _Kind:
    """Lines that count together."""

    def __init__(self, began: float) -> None:
        self.began, self.told = began, 0


class Repeats(logging.Filter):
    """Lets the first lines of a kind pass; says with a later one, or after a while, how many were left out."""

    def __init__(self, clock: Callable[[], float] = time.monotonic, seconds: float = _SECONDS) -> None:
        super().__init__()
        self._clock = clock
        self._seconds = seconds
        self._kinds: OrderedDict[object, _Kind] = OrderedDict()
        self._lock = threading.Lock()
        self._due: threading.Timer | None = None
        self._left_out: dict[str, int] = {}  # since it was last said, by event

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether a line is told."""
        event = _event(record)
        if getattr(record, "is_count", False):
            return True
        with self._lock:
            now = self._clock()
            # Both count each line; neither is asked in place of the other.
            passes = [self._passes((record.name, *key), most, now) for key, most in _keys(record, event)]
            if all(passes):
                return True
            name = f"{record.name}: {event}"
            self._left_out[name] = self._left_out.get(name, 0) + 1
            if self._due is None:
                self._due = threading.Timer(self._seconds, self.tell)
                self._due.daemon = True
                self._due.start()
            return False

    def _passes(self, key: object, most: int, now: float) -> bool:
        kind = self._kinds.pop(key, None)
        if kind is None or now - kind.began >= self._seconds:
            kind = _Kind(now)
        self._kinds[key] = kind
        while len(self._kinds) > _MOST_KINDS:
            self._kinds.popitem(last=False)
        kind.told += 1
        return kind.told <= most

    def tell(self) -> None:
        """Say what was left out."""
        with self._lock:
            left_out, self._left_out, self._due = self._left_out, {}, None
        for name, count in left_out.items():
            logger, _, event = name.partition(": ")
            text = "lines like one before were left out: %s (%d in %g s)"
            logging.getLogger(logger).warning(text, event, count, self._seconds, extra={"is_count": True})


def _event(record: logging.LogRecord) -> str:
    return str(record.msg.get("event", "")) if isinstance(record.msg, dict) else str(record.msg)[:200]


def _keys(record: logging.LogRecord, event: str) -> list[tuple[tuple[Any, ...], int]]:
    if isinstance(record.msg, dict):
        fields = tuple(sorted((name, str(value)) for name, value in record.msg.items() if name not in _VOLATILE))
    else:
        fields = (str(record.args),)
    return [((event, fields), _SAME), ((event,), _ALIKE)]
