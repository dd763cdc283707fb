"""Whether anything in a scene depends on wavelength: if not, one channel says all that three would.

Looked at in the parsed form, so that the variant can be chosen before anything is instantiated. Whatever is not known
to be grey counts as coloured.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from renderer.backend import mitsuba
from renderer.errors import SceneError
from renderer.scene.assets import Assets
from renderer.scene.files.picture import has_colour
from renderer.scene.files.voxels import channels_of
from renderer.scene.plugins import having
from renderer.scene.vet.nodes import properties

_NAMED_MATERIALS = ("none", "")


def coloured_by(state: Any, assets: Assets) -> str | None:
    """What makes the scene coloured, as "diffuse reflectance" or a file's name; None for a scene without colour."""
    geometry = _geometry_textures(state)
    pictures: list[Path] = []
    mi = mitsuba()
    skipped = (mi.ObjectType.Integrator, mi.ObjectType.Sampler, mi.ObjectType.Film, mi.ObjectType.Sensor)
    for index, node in enumerate(state.nodes):
        plugin = node.props.plugin_name()
        if plugin == "gridvolume":
            if _grid_channels(node, index, assets) > 1:
                return plugin
            continue
        if plugin == "specfilm" or (plugin in having("coloured") and node.type not in skipped):
            return plugin
        if node.type in skipped or index in geometry:
            continue
        is_light = node.type == mi.ObjectType.Emitter
        for key, value in properties(node):
            if _is_coloured(key, value, is_light):
                return f"{plugin} {key}"
        if index in assets.pictures and assets.pictures[index].channels >= 3:
            pictures.append(assets.paths[index])
    for path in dict.fromkeys(pictures):
        try:
            if has_colour(path):
                return path.name
        except SceneError:
            return path.name
    return None


def _grid_channels(node: Any, index: int, assets: Assets) -> int:
    """Of a grid in a file or in memory."""
    if index in assets.grids:
        return assets.grids[index].channels
    return max(
        (channels_of(np.array(value).shape) for key, value in properties(node) if key in ("grid", "data")), default=1
    )


def spectral_by(state: Any) -> str | None:
    """The spectrum that a light or a surface has and that only single wavelengths can be asked for, as "irregular";
    None where red, green and blue will do. What a film or a sensor has is a response, and no light.
    """
    mi = mitsuba()
    kind = mi.Properties.Type.ResolvedReference
    for node in state.nodes:
        if node.type not in (mi.ObjectType.Emitter, mi.ObjectType.BSDF, mi.ObjectType.Texture):
            continue
        for key, value in properties(node):
            if node.props.type(key) == kind:
                plugin = state.nodes[value.index()].props.plugin_name()
                if plugin in having("spectral"):
                    return plugin
    return None


def _geometry_textures(state: Any) -> set[int]:
    """Nodes that stand for bumps and normals, and for nothing else."""
    geometry: set[int] = set()
    others: set[int] = set()
    kind = mitsuba().Properties.Type.ResolvedReference
    for node in state.nodes:
        found = geometry if node.props.plugin_name() in having("geometry") else others
        for key, value in properties(node):
            if node.props.type(key) == kind and state.nodes[value.index()].type == mitsuba().ObjectType.Texture:
                found.add(value.index())
    return geometry - others


def _is_coloured(key: str, value: Any, is_light: bool) -> bool:
    name = type(value).__name__
    if "Color" in name:
        channels = np.array(value, dtype=np.float64)
        return bool(np.ptp(channels) > 0)
    if name == "Spectrum":
        # A light of constant spectrum is not white: white is the light of day (D65).
        # Equal values at some wavelengths are no grey either: there is nothing beyond the first and the last one.
        return is_light or not value.is_uniform()
    if name == "Bitmap" or "Tensor" in name:  # pictures that were handed over in memory
        pixels = np.array(value)
        return pixels.ndim == 3 and pixels.shape[-1] >= 3 and bool(np.ptp(pixels[..., :3], axis=-1).max() > 0)
    if key == "material" and isinstance(value, str):
        return value.lower() not in _NAMED_MATERIALS
    return False
