"""Emission as it stands in a parsed scene: multiply it, and tell whether it is zero."""

from __future__ import annotations

from typing import Any

import numpy as np

from renderer.backend import mitsuba
from renderer.scene.vet.nodes import properties

_WITH_SCALE = frozenset({"d65", "blackbody"})


class Unscalable(Exception):
    """A scene that cannot be rescaled; the message says what stands in the way."""


def scale_emission(state: Any, node: Any, key: str, factor: float) -> None:
    """Multiplies a node's emission in place. Raises Unscalable where it is a texture that cannot be scaled."""
    mi = mitsuba()
    value = dict(properties(node)).get(key, 1.0)
    name = type(value).__name__
    if isinstance(value, (int, float)):
        node.props[key] = float(value) * factor
    elif "Color" in name:
        node.props[key] = mi.ScalarColor3d([float(c) * factor for c in np.array(value, np.float64).ravel()])
    elif name == "Spectrum":
        scaled = [v * factor for v in value.values]
        node.props[key] = type(value)(scaled[0]) if value.is_uniform() else type(value)(value.wavelengths, scaled)
    elif node.props.type(key) == mi.Properties.Type.ResolvedReference:
        texture = state.nodes[value.index()]
        if texture.props.plugin_name() not in _WITH_SCALE or _uses(state, value.index()) > 1:
            raise Unscalable(f"the {key} of {node.props.plugin_name()} is a texture that is not scaled")
        before = dict(properties(texture)).get("scale", 1.0)
        texture.props["scale"] = float(before) * factor
    else:
        raise Unscalable(f"the {key} of {node.props.plugin_name()} is of an unknown kind")


def is_zero(value: Any) -> bool:
    """Whether an emission is known to be zero."""
    name = type(value).__name__
    if isinstance(value, (int, float)):
        return value == 0
    if name == "Spectrum":
        return not any(value.values)
    if "Color" in name:
        return not np.any(np.array(value, np.float64))
    return False


def _uses(state: Any, index: int) -> int:
    kind = mitsuba().Properties.Type.ResolvedReference
    return sum(
        value.index() == index
        for node in state.nodes
        for key, value in properties(node)
        if node.props.type(key) == kind
    )
