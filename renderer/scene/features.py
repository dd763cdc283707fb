"""What a kernel for a scene has to contain: told from the plugins alone, and never too little.

Enters: parsed nodes. Leaves: `Features`. What is known of each plugin stands in `scene.plugins`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from renderer.backend import mitsuba
from renderer.scene.plugins import having
from renderer.scene.vet.nodes import channels, properties

_WRAPPERS = having("wraps")
_DELTA_ONLY = having("delta", "BSDF") - having("smooth") - _WRAPPERS


@dataclass(frozen=True, slots=True)
class Features:
    """has_delta: some BSDF has mirror or clear-glass lobes. has_smooth: some has others. has_null: light may pass a
    surface unchanged. has_transmission: light may pass a surface. has_environment: light may come from a miss.
    has_point_lights: lights that no ray can hit. has_visible_emitters: lights that a ray can. reflects: some light may
    be reflected, or scattered by a medium, at all. needs_time: the picture depends on the time within the shutter's
    opening (nothing moves in Mitsuba 3). needs_uv: something looks at texture coordinates or tangents of surfaces.
    """

    has_delta: bool
    has_smooth: bool
    has_null: bool
    has_transmission: bool
    has_environment: bool
    has_point_lights: bool
    has_visible_emitters: bool
    reflects: bool
    needs_time: bool = False
    needs_uv: bool = True


def of(state: Any) -> Features:
    """The features that the nodes need."""
    mi = mitsuba()
    nodes = list(state.nodes)
    bsdfs = {node.props.plugin_name() for node in nodes if node.type == mi.ObjectType.BSDF}
    emitters = {node.props.plugin_name() for node in nodes if node.type == mi.ObjectType.Emitter}
    if has_bare_shape(state):
        bsdfs.add("diffuse")  # Mitsuba's default
    return Features(
        has_delta=bool(bsdfs & having("delta")),
        has_smooth=bool(bsdfs - _DELTA_ONLY - _WRAPPERS),
        has_null=bool(bsdfs & having("null")),
        has_transmission=bool(bsdfs & having("transmits")),
        has_environment=bool(emitters & having("environment")),
        has_point_lights=bool(emitters & having("delta")),
        has_visible_emitters=bool(emitters - having("unseen")),
        reflects=any(node.type == mi.ObjectType.BSDF and _reflects(state, node) for node in nodes)
        or has_bare_shape(state)
        or any(node.type == mi.ObjectType.Medium for node in nodes),
        needs_uv=_needs_uv(state),
    )


def _needs_uv(state: Any) -> bool:
    """Whether a BSDF may have a direction of its own on the surface, or anything but the sky a texture."""
    mi = mitsuba()
    for node in state.nodes:
        plugin = node.props.plugin_name()
        if node.type == mi.ObjectType.BSDF and plugin not in having("isotropic"):
            return True
        if node.type == mi.ObjectType.BSDF and {"alpha_u", "alpha_v"} & {key for key, _ in properties(node)}:
            return True
        if node.type == mi.ObjectType.Texture and plugin not in having("even"):
            return True
    return False


def has_bare_shape(state: Any) -> bool:
    """Whether a shape has no BSDF of its own; groups and instances need none."""
    mi = mitsuba()
    reference = mi.Properties.Type.ResolvedReference
    for node in state.nodes:
        if node.type != mi.ObjectType.Shape or node.props.plugin_name() in ("shapegroup", "instance"):
            continue
        inner = [value.index() for key, value in properties(node) if node.props.type(key) == reference]
        if not any(state.nodes[index].type == mi.ObjectType.BSDF for index in inner):
            return True
    return False


def _reflects(state: Any, node: Any) -> bool:
    """False where a BSDF is known to send nothing on: diffuse and black, or a wrapper, whose content tells."""
    plugin = node.props.plugin_name()
    if plugin in _WRAPPERS:
        return plugin == "mask"
    if plugin != "diffuse":
        return True
    value = dict(properties(node)).get("reflectance")
    found = channels(value) if value is not None and "Reference" not in type(value).__name__ else None
    return found is None or bool(np.any(found != 0))
