"""Where the shapes of a parsed scene are: bounds in the world's coordinates, in double precision.

Enters: parsed nodes and what their files hold. Leaves: a box around each placed shape. Corners of local boxes are
transformed, so that a box may be larger than its shape, never smaller.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderer.backend import mitsuba
from renderer.scene.assets import Assets
from renderer.scene.vet.nodes import number, properties, value_of, vector

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


def meters(state: Any) -> dict[int, int]:
    """The sensors that are part of the scene's own shapes: index of a sensor's node → index of its shape's."""
    mi = mitsuba()
    own = [index for _, index in children(state, state.root) if state.nodes[index].type == mi.ObjectType.Shape]
    pairs = [(inner, shape) for shape in own for _, inner in children(state, state.nodes[shape])]
    return {inner: shape for inner, shape in pairs if state.nodes[inner].type == mi.ObjectType.Sensor}


# In place of a sensor on a shape: Mitsuba's irradiance meters lack a function that its batches call of all sensors.
STAND_IN = "orthographic"


def take_meters_off(state: Any) -> None:
    """Takes sensors off their shapes: they are made apart, and Mitsuba 3.9 makes none on a mesh.

    Where there are media, a stand-in beside the cameras, in the order of the meters, knows the medium that each is in:
    its own, or the one outside of its shape.
    """
    mi = mitsuba()
    found = meters(state)
    has_media = any(node.type == mi.ObjectType.Medium for node in state.nodes)
    for sensor, shape in found.items() if has_media else ():
        _stand_in(state, state.nodes[sensor], state.nodes[shape])
        state.root.props[f"meter_{sensor}"] = mi.Properties.ResolvedReference(sensor)
    for node in state.nodes:
        if node.type not in (mi.ObjectType.Shape, mi.ObjectType.Sensor):
            continue
        inner = [key for key, index in children(state, node) if index in found]
        for key in inner:
            del node.props[key]
        if inner and node.type == mi.ObjectType.Sensor:  # a batch of meters
            node.props.set_plugin_name(STAND_IN)


def _stand_in(state: Any, sensor: Any, shape: Any) -> None:
    """Makes a meter's node one of a sensor that has nothing but the medium that the meter is in."""
    mi = mitsuba()
    own = [index for _, index in children(state, sensor) if state.nodes[index].type == mi.ObjectType.Medium]
    outside = [index for key, index in children(state, shape) if key == "exterior"]
    for key in list(sensor.props.keys()):
        del sensor.props[key]
    sensor.props.set_plugin_name(STAND_IN)
    for index in (own or outside)[:1]:
        sensor.props["medium"] = mi.Properties.ResolvedReference(index)


def placed_shapes(state: Any, assets: Assets) -> list[Placed]:
    """The shapes of the scene itself, each once. What a shape group holds is placed by its instances alone."""
    mi = mitsuba()
    found = []
    for _, index in children(state, state.root):
        node = state.nodes[index]
        if node.type == mi.ObjectType.Shape and node.props.plugin_name() != "shapegroup":
            found.append(index)
    return _place(state, found, assets)


def _place(state: Any, indices: list[int], assets: Assets) -> list[Placed]:
    """All of them at once: a scene may have a hundred thousand shapes."""
    plugins, locals_, matrices = [], [], np.empty((len(indices), 4, 4))
    for row, index in enumerate(indices):
        node = state.nodes[index]
        plugins.append(node.props.plugin_name())
        matrices[row] = matrix_of(value_of(node, "to_world"))
        locals_.append(_local_box(state, index, plugins[row], assets))
    known = [row for row, box in enumerate(locals_) if box is not None]
    boxes: list[Box | None] = [None] * len(indices)
    if known:
        low, high = transformed(np.array([locals_[row] for row in known], dtype=np.float64), matrices[known])
        for at, row in enumerate(known):
            boxes[row] = low[at], high[at]
    return [Placed(*placed) for placed in zip(indices, plugins, boxes, matrices, strict=True)]


def _local_box(state: Any, index: int, plugin: str, assets: Assets) -> Box | None:
    if mesh := assets.meshes.get(index):
        return None if mesh.low is None or mesh.high is None else (np.array(mesh.low), np.array(mesh.high))
    if plugin in ("rectangle", "disk"):
        return _FLAT
    if plugin == "cube":
        return _UNIT
    values = dict(properties(state.nodes[index]))
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
    if plugin == "instance":
        return _group_box(state, index, assets)
    return None


def _group_box(state: Any, index: int, assets: Assets) -> Box | None:
    """Box of the group that an instance places, in the group's coordinates."""
    for _, group in children(state, state.nodes[index]):
        if state.nodes[group].props.plugin_name() == "shapegroup":
            inner = [i for _, i in children(state, state.nodes[group])]
            known = [placed.box for placed in _place(state, inner, assets) if placed.box is not None]
            return union(known) if known else None
    return None


def matrix_of(transform: Any) -> NDArray[np.float64]:
    """(4, 4) matrix of a transform property; the identity for none."""
    return np.array(transform.matrix, dtype=np.float64) if hasattr(transform, "matrix") else np.eye(4)


def transformed(boxes: NDArray[np.float64], matrices: NDArray[np.float64]) -> Box:
    """Boxes around transformed boxes. boxes: (n, 2, 3); matrices: (n, 4, 4). Returns low and high corners, (n, 3)."""
    at = np.array(list(itertools.product((0, 1), repeat=3)))
    corners = np.ones((len(boxes), 8, 4))
    corners[..., :3] = boxes[:, at, [0, 1, 2]]
    moved = np.einsum("nck,nik->nci", corners, matrices)
    points = moved[..., :3] / moved[..., 3:]
    return points.min(axis=1), points.max(axis=1)


def union(boxes: list[Box]) -> Box:
    """Box around boxes."""
    return np.min([low for low, _ in boxes], axis=0), np.max([high for _, high in boxes], axis=0)


def bounds(shapes: list[Placed]) -> Box | None:
    """Box around the shapes whose own is known; None if there is none."""
    known = [shape.box for shape in shapes if shape.box is not None and np.isfinite(shape.box).all()]
    return union(known) if known else None
