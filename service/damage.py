"""Saved estimates that are not what was saved: which one stands in, and what is said of the loss. Pure."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from service.store.records import Kept

T = TypeVar("T")


class EstimateDamaged(Exception):
    """A saved estimate is missing, or not what was saved. The message is the reason."""


@dataclass(frozen=True, slots=True)
class Found(Generic[T]):
    """What the newest sound estimate led to, and the sentences about those before it. kept None: none is sound."""

    value: T | None
    kept: Kept | None
    losses: tuple[str, ...]


def first_sound(kept: Sequence[Kept], read: Callable[[Kept], T]) -> Found[T]:
    """Read the newest estimate that can be believed. read: raises EstimateDamaged."""
    damaged: list[tuple[Kept, str]] = []
    for one in kept:
        try:
            value = read(one)
        except EstimateDamaged as why:
            damaged.append((one, str(why)))
        else:
            return Found(value, one, tuple(loss(bad, reason, one) for bad, reason in damaged))
    return Found(None, None, tuple(loss(bad, reason, None) for bad, reason in damaged))


def loss(damaged: Kept, reason: str, instead: Kept | None) -> str:
    """What is said of a damaged estimate. instead: the one from before that stands in for it."""
    was = f"The estimate that was saved at {_samples(damaged)} is damaged ({reason})"
    if instead is None:
        return f"{was}, and there is no earlier one: those samples are lost."
    return f"{was}; the one before it is used, of {_samples(instead)}."


def _samples(kept: Kept) -> str:
    return f"{kept.progress.spp:.4g} samples per pixel"
