"""Threads of their own for what reads and what writes, and how long a request waits for them.

While a database keeps writers waiting, nobody who reads waits for a thread; while it answers nobody, nothing else that
needs a thread waits for one, and whoever asks is told so in two seconds.
"""

from __future__ import annotations

import asyncio
import contextvars
import functools
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import ParamSpec, TypeVar

from sqlalchemy.exc import TimeoutError as PoolTimeout

P = ParamSpec("P")
T = TypeVar("T")
WAIT_SECONDS = 2.0  # that a request waits for the database
WRITERS, READERS = 4, 8
_writers = ThreadPoolExecutor(WRITERS, thread_name_prefix="write")
_readers = ThreadPoolExecutor(READERS, thread_name_prefix="read")
_leisure = ThreadPoolExecutor(1, thread_name_prefix="leisure")
# When whoever asked waits no longer, on the monotonic clock.
_ends: contextvars.ContextVar[float | None] = contextvars.ContextVar("ends", default=None)


async def writing(call: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
    """As `asyncio.to_thread`, in a thread for writers. Raises PoolTimeout where the database keeps them waiting.

    What was to be written then is not: see `check_wanted`.
    """
    whole = functools.partial(call, *args, **kwargs)
    return await _within(_writers, whole, "the database lets nobody write")


async def reading(call: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
    """As `asyncio.to_thread`, in a thread for readers. Raises PoolTimeout where the database does not answer."""
    return await _within(_readers, functools.partial(call, *args, **kwargs), "the database does not answer")


async def at_leisure(call: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
    """As `asyncio.to_thread`, in a thread of its own for what nobody waits for, however long the database takes."""
    return await asyncio.get_running_loop().run_in_executor(_leisure, functools.partial(call, *args, **kwargs))


async def _within(threads: ThreadPoolExecutor, call: Callable[[], T], otherwise: str) -> T:
    context = contextvars.copy_context()
    context.run(_ends.set, time.monotonic() + WAIT_SECONDS)
    try:
        async with asyncio.timeout(WAIT_SECONDS):
            return await asyncio.get_running_loop().run_in_executor(threads, functools.partial(context.run, call))
    except TimeoutError:
        raise PoolTimeout(otherwise) from None


def check_wanted() -> None:
    """Before a commit: whether somebody still waits for it. Raises PoolTimeout."""
    ends = _ends.get()
    if ends is not None and time.monotonic() > ends:
        raise PoolTimeout("the database took so long that what was to be written was given up")
