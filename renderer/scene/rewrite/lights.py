"""Drops what can neither be seen nor shine: lights of zero power, and shapes of zero area.

A light without area has no density to be sampled with: it is refused by name, never silently dark.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from renderer.backend import mitsuba
from renderer.errors import SceneError
from renderer.scene.geometry import Placed, children, meters
from renderer.scene.rewrite.emission import is_zero
from renderer.scene.source import Parsed
from renderer.scene.vet.nodes import number, properties, vector

NO_AREA_TO_METER = "the irradiance meter is on a shape that has no area; give it some size"
_EMISSION = ("radiance", "intensity", "irradiance")


def without_dark_lights(state: Any, parsed: Parsed) -> tuple[Any, list[str]]:
    """A copy of a parsed scene without lights of zero power, and a note on each."""
    mi = mitsuba()
    made = mi.parser.ParserState(state)
    dark = {
        index for index, node in enumerate(made.nodes) if node.type == mi.ObjectType.Emitter and _is_dark(made, node)
    }
    if not dark:
        return made, []
    _unlink(made, dark)
    return made, [_note([parsed.place(parsed.state.nodes[index]) for index in sorted(dark)], "emits nothing")]


def without_flat_shapes(state: Any, parsed: Parsed) -> tuple[Any, list[str]]:
    """A copy without shapes of zero area, and a note on each. Raises SceneError where one is a light, or metered."""
    mi = mitsuba()
    made = mi.parser.ParserState(state)
    metered = set(meters(made).values())
    flat = {shape.index for shape in parsed.shapes if has_no_area(made, shape)}
    for index in sorted(flat):
        node = made.nodes[index]
        if index in metered:
            raise SceneError(f"{parsed.place(parsed.state.nodes[index])}: {NO_AREA_TO_METER}")
        if any(made.nodes[inner].type == mi.ObjectType.Emitter for _, inner in children(made, node)):
            raise SceneError(
                f"{parsed.place(parsed.state.nodes[index])}: the {node.props.plugin_name()} is a light without area, "
                "which emits nothing; give it some size, or use a point or spot light"
            )
    if not flat:
        return made, []
    _unlink(made, flat)
    return made, [_note([parsed.place(parsed.state.nodes[index]) for index in sorted(flat)], "has no area")]


def has_no_area(state: Any, shape: Placed) -> bool:
    """Whether one of Mitsuba's own shapes has shrunk to a line or a point. Meshes are told by their faces."""
    linear = shape.to_world[:3, :3]
    if shape.plugin in ("rectangle", "disk"):
        return not np.any(np.cross(linear[:, 0], linear[:, 1]))
    if shape.plugin == "cube":
        return int(np.linalg.matrix_rank(linear)) < 2
    if shape.plugin not in ("sphere", "cylinder"):
        return False
    values = dict(properties(state.nodes[shape.index]))
    if shape.plugin == "sphere":
        return number(values, "radius", 1.0) == 0 or not np.any(linear)
    axis = vector(values, "p1", (0, 0, 1)) - vector(values, "p0", (0, 0, 0))
    return number(values, "radius", 1.0) == 0 or not np.any(axis) or not np.any(linear)


def _is_dark(state: Any, node: Any) -> bool:
    mi = mitsuba()
    values = dict(properties(node))
    if is_zero(values.get("scale", 1.0)):
        return True
    for key in _EMISSION:
        if key not in values:
            continue
        if node.props.type(key) == mi.Properties.Type.ResolvedReference:
            inner = dict(properties(state.nodes[values[key].index()]))
            return is_zero(inner.get("scale", 1.0))
        return is_zero(values[key])
    return False


def _unlink(state: Any, dropped: set[int]) -> None:
    """Removes all references to these nodes, in place."""
    kind = mitsuba().Properties.Type.ResolvedReference
    for node in state.nodes:
        gone = [key for key, value in properties(node) if node.props.type(key) == kind and value.index() in dropped]
        for key in gone:
            del node.props[key]


def _note(places: list[str], why: str) -> str:
    shown = ", ".join(places[:3]) + (f" and {len(places) - 3} more" if len(places) > 3 else "")
    return f"dropped {shown}: {why}"
