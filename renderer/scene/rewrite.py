"""Changes to a parsed scene before it is instantiated: image size, and an integrator that Mitsuba can ignore."""

from __future__ import annotations

from typing import Any

from renderer.backend import mitsuba
from renderer.errors import SettingsError
from renderer.settings import MAX_SIDE

_CROP = ("crop_offset_x", "crop_offset_y", "crop_width", "crop_height")
_DEFAULT_FILM = {"width": 768, "height": 576}  # Mitsuba's own defaults


def resize(state: Any, width: int | None, height: int | None) -> None:
    """Sets the size of every film. One side alone scales the other; a new size drops the film's crop window."""
    mi = mitsuba()
    for node in state.nodes:
        if node.type != mi.ObjectType.Film:
            continue
        props = node.props
        own_width, own_height = (int(props[k]) if k in props else _DEFAULT_FILM[k] for k in ("width", "height"))
        if width is None and height is None:
            check_size(own_width, own_height)
            continue
        new_width = width if width is not None else max(1, round(own_width * (height or 1) / own_height))
        new_height = height if height is not None else max(1, round(own_height * (width or 1) / own_width))
        check_size(new_width, new_height)
        if (new_width, new_height) == (own_width, own_height):
            continue
        for key in (*_CROP, "width", "height"):
            if key in props:
                props.remove_property(key)
        props["width"], props["height"] = new_width, new_height


def check_size(width: int, height: int) -> None:
    """Refuses image sizes outside 1 … 16384."""
    if not (1 <= width <= MAX_SIDE and 1 <= height <= MAX_SIDE):
        raise SettingsError(f"image size is {width}×{height}; each side must be from 1 to {MAX_SIDE}")


def neutralise_integrators(state: Any) -> None:
    """Replaces integrators by a plain one: they are never used, and unknown ones would fail to load."""
    mi = mitsuba()
    for node in state.nodes:
        if node.type != mi.ObjectType.Integrator:
            continue
        for key in list(node.props.keys()):
            node.props.remove_property(key)
        node.props.set_plugin_name("path")
