"""The scenes that are loaded in this process: what a recording of a kernel has to know besides its own scene."""

from __future__ import annotations

from typing import Any
from weakref import WeakValueDictionary

_loaded: WeakValueDictionary[int, Any] = WeakValueDictionary()


def note_loaded(owner: Any) -> None:
    """Says that `owner.mitsuba_scene` of `owner.variant` is there for as long as its owner is: a scene or a kernel."""
    _loaded[id(owner)] = owner


def loaded_scenes(variant: str) -> list[Any]:
    """Mitsuba's scenes of a variant, each once, in the order of loading."""
    found = [owner.mitsuba_scene for owner in list(_loaded.values()) if owner.variant == variant]
    return list({id(scene): scene for scene in found}.values())
