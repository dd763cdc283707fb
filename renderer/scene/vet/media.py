"""Participating media of the parsed nodes: numbers that no medium can have, before anything is made of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from renderer.backend import mitsuba
from renderer.errors import SceneError
from renderer.scene.files.voxels import MATRIX_CHANNELS, channels_of, check_values
from renderer.scene.vet.nodes import channels, properties

_COEFFICIENTS = ("sigma_t", "albedo", "scale")


def check_media(state: Any, place: Any) -> None:
    """Refuses negative extinctions, albedos and scales, homogeneous media of a grid, and grids in memory with values
    that no medium can have. place: node → "file:line"."""
    mi = mitsuba()
    for node in state.nodes:
        if node.type == mi.ObjectType.Medium:
            _check_medium(state, node, place)
        elif node.type == mi.ObjectType.Volume:
            for key, value in properties(node):
                _check_volume(key, value, place(node))


def _check_medium(state: Any, node: Any, place: Any) -> None:
    kind = mitsuba().Properties.Type.ResolvedReference
    for key, value in properties(node):
        if node.props.type(key) == kind:
            child = state.nodes[value.index()].props.plugin_name()
            if node.props.plugin_name() == "homogeneous" and key == "sigma_t" and child == "gridvolume":
                raise SceneError(
                    f"{place(node)}: the extinction of a homogeneous medium is a grid (gridvolume), which changes from "
                    "place to place; make the medium heterogeneous"
                )
        elif key in _COEFFICIENTS:
            _check_sign(key, value, place(node))


def _check_volume(key: str, value: Any, where: str) -> None:
    if key == "value":
        _check_sign(key, value, where)
    elif key in ("grid", "data"):
        found = np.array(value)
        if found.ndim not in (3, 4) or not found.size:
            raise SceneError(f"{where}: the grid has the shape {found.shape}; give (z, y, x) or (z, y, x, channels)")
        check_values(found.ravel(), where, is_signed=channels_of(found.shape) == MATRIX_CHANNELS)


def _check_sign(key: str, value: Any, where: str) -> None:
    found = channels(value)
    if found is not None and found.size and found.min() < 0:
        raise SceneError(f"{where}: {key} is {found.min():g}; it cannot be negative, give 0 or more")
