"""Where the shapes of a parsed scene are: bounds in the world's coordinates, in double precision.

Enters: parsed nodes and what their files hold. Leaves: a box around each placed shape. Corners of local boxes are
transformed, so that a box may be larger than its shape, never smaller.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderer.backend import mitsuba
from renderer.scene.assets import Assets
from renderer.scene.vet.nodes import number, properties, vector

Box = tuple[NDArray[np.float64], NDArray[np.float64]]  # low and high corner
_UNIT = (np.full(3, -1.0), np.ones(3))
_FLAT = (np.array([-1.0, -1.0, 0.0]), np.array([1.0, 1.0, 0.0]))


@dataclass(frozen=True, slots=True)
class Placed:
    """A shape of the scene: index of its node, plugin, box in the world (None if unknown), and its world transform."""

    index: int
    plugin: str
    box: Box | None
    to_world: NDArray[np.float64]


def children(state: Any, node: Any) -> Iterator[tuple[str, int]]:
    """Names and indices of the nodes that a node refers to."""
    kind = mitsuba().Properties.Type.ResolvedReference
    for key, value in properties(node):
        if node.props.type(key) == kind:
            yield key, value.index()


def placed_shapes(state: Any, assets: Assets) -> list[Placed]:
    """The shapes of the scene itself, each once. What a shape group holds is placed by its instances alone."""
    mi = mitsuba()
    found = []
    for _, index in children(state, state.root):
        node = state.nodes[index]
        if node.type == mi.ObjectType.Shape and node.props.plugin_name() != "shapegroup":
            found.append(_place(state, index, assets))
    return found


def _place(state: Any, index: int, assets: Assets) -> Placed:
    node = state.nodes[index]
    plugin = node.props.plugin_name()
    values = dict(properties(node))
    to_world = matrix_of(values.get("to_world"))
    box = _local_box(state, index, plugin, values, assets)
    return Placed(index, plugin, None if box is None else transformed(box, to_world), to_world)


def _local_box(state: Any, index: int, plugin: str, values: dict[str, Any], assets: Assets) -> Box | None:
    if plugin in ("rectangle", "disk"):
        return _FLAT
    if plugin == "cube":
        return _UNIT
    if plugin == "sphere":
        centre = vector(values, "center", (0.0, 0.0, 0.0))
        radius = abs(number(values, "radius", 1.0))
        return centre - radius, centre + radius
    if plugin == "cylinder":
        ends = np.array([vector(values, "p0", (0.0, 0.0, 0.0)), vector(values, "p1", (0.0, 0.0, 1.0))])
        radius = abs(number(values, "radius", 1.0))
        return ends.min(axis=0) - radius, ends.max(axis=0) + radius
    if plugin == "sdfgrid":
        return np.zeros(3), np.ones(3)
    if mesh := assets.meshes.get(index):
        return None if mesh.low is None else (np.array(mesh.low), np.array(mesh.high))
    if plugin == "instance":
        return _group_box(state, index, assets)
    return None


def _group_box(state: Any, index: int, assets: Assets) -> Box | None:
    """Box of the group that an instance places, in the group's coordinates."""
    for _, group in children(state, state.nodes[index]):
        if state.nodes[group].props.plugin_name() == "shapegroup":
            inner = [_place(state, i, assets).box for _, i in children(state, state.nodes[group])]
            known = [box for box in inner if box is not None]
            return union(known) if known else None
    return None


def matrix_of(transform: Any) -> NDArray[np.float64]:
    """(4, 4) matrix of a transform property; the identity for none."""
    return np.array(transform.matrix, dtype=np.float64) if hasattr(transform, "matrix") else np.eye(4)


def transformed(box: Box, matrix: NDArray[np.float64]) -> Box:
    """Box around a transformed box."""
    low, high = box
    corners = np.array(
        [[x, y, z, 1.0] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
    )
    moved = corners @ matrix.T
    moved = moved[:, :3] / moved[:, 3:]
    return moved.min(axis=0), moved.max(axis=0)


def union(boxes: list[Box]) -> Box:
    """Box around boxes."""
    return np.min([low for low, _ in boxes], axis=0), np.max([high for _, high in boxes], axis=0)


def bounds(shapes: list[Placed]) -> Box | None:
    """Box around the shapes whose own is known; None if there is none."""
    known = [shape.box for shape in shapes if shape.box is not None and np.isfinite(shape.box).all()]
    return union(known) if known else None
