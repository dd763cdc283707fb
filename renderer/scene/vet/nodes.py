"""Looks at the parsed nodes: plugins, file names, and numbers, now that every parameter has its value."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderer.backend import mitsuba, mitsuba_folder
from renderer.errors import SceneError
from renderer.scene.files.tables import check_spectrum
from renderer.scene.limits import SceneLimits
from renderer.scene.plugins import having
from renderer.scene.vet.plugins import check_plugin, is_allowed, is_of_kind
from renderer.scene.vet.references import is_outside, leads_out

# Without one of these Mitsuba ends the process instead of saying so.
_NEEDED = {"bitmap": ("filename", "bitmap", "data"), "blendbsdf": ("weight",)}
_MAY_BE_INFINITE = frozenset({"far_clip"})


def check_nodes(state: Any, folder: Path | None, limits: SceneLimits, place: Any) -> None:
    """Refuses plugins that are not allowed, file names that lead out of `folder`, and numbers that are none.

    place: node → "file:line". Raises SceneError.
    """
    mi = mitsuba()
    never_loaded = (mi.ObjectType.Integrator, mi.ObjectType.Sampler)
    made = (mi.Shape, mi.BSDF, mi.Emitter, mi.Sensor, mi.Medium, mi.Texture, mi.Volume, mi.Film)
    for node in state.nodes:
        if node.type not in never_loaded and not is_allowed(node.props.plugin_name()):
            check_plugin(node.props.plugin_name(), place(node))  # a place is slow to find: only for an error
        if not is_of_kind(node.props.plugin_name(), node.type.name):
            kind = node.type.name.lower()
            raise SceneError(f"{place(node)}: {node.props.plugin_name()!r} is no {kind}; mend its tag or its type")
        needed = _NEEDED.get(node.props.plugin_name(), ())
        if needed and not any(key in node.props for key in needed):
            raise SceneError(f"{place(node)}: {node.props.plugin_name()!r} has no {needed[0]}; add it")
        if node.props.plugin_name() in having("metal"):
            _check_metal(value_of(node, "material"), folder, place, node)
        for key, value in properties(node):
            if isinstance(value, made):
                raise SceneError(
                    f"{place(node)}: {key} is a {type(value).__name__} that is made already; give the dictionary or "
                    "file that it was made from"
                )
            if isinstance(value, str):
                _check_text(key, value, folder, limits, place, node)
            elif key not in _MAY_BE_INFINITE and not _is_finite(value):
                raise SceneError(f"{place(node)}: {key} is {_shown(value)}; write finite numbers")


def properties(node: Any) -> Iterator[tuple[str, Any]]:
    """Names and values of a node's properties, references included, without marking them as used.

    Mitsuba refuses properties that nobody reads; reading them here must not hide a spelling mistake from it.
    """
    props = node.props
    for key in props.keys():  # noqa: SIM118 (Mitsuba's Properties is no mapping)
        was_queried = props.was_queried(key)
        value = props[key]
        props.mark_queried(key, was_queried)
        yield key, value


def value_of(node: Any, key: str, default: Any = None) -> Any:
    """One property, without marking it as used."""
    props = node.props
    if key not in props:
        return default
    was_queried = props.was_queried(key)
    value = props[key]
    props.mark_queried(key, was_queried)
    return value


def number(values: Mapping[str, Any], key: str, default: float) -> float:
    """A property as a number. One of another kind counts as missing: Mitsuba refuses it, and names its place."""
    value = values.get(key, default)
    return float(value) if isinstance(value, (int, float)) else default


def channels(value: Any) -> NDArray[np.float64] | None:
    """The numbers of a colour or spectrum, (n,); None for anything else, which Mitsuba refuses."""
    if type(value).__name__ == "Spectrum":
        return np.array(value.values, dtype=np.float64)
    if isinstance(value, (str, bool)) or "Transform" in type(value).__name__:
        return None
    try:
        return np.array(value, dtype=np.float64).ravel()
    except (TypeError, ValueError, RuntimeError):
        return None


def vector(values: Mapping[str, Any], key: str, default: tuple[float, float, float]) -> NDArray[np.float64]:
    """A property as three numbers, (3,); one of another kind counts as missing."""
    value = values.get(key, default)
    if "Array" in type(value).__name__ or isinstance(value, tuple):
        found = np.array(value, dtype=np.float64).ravel()
        if found.size == 3:
            return found
    return np.array(default, dtype=np.float64)


def _check_text(key: str, value: str, folder: Path | None, limits: SceneLimits, place: Any, node: Any) -> None:
    if not limits.is_confined or folder is None:
        return
    is_file = key.lower().endswith("filename")
    root = limits.root or folder
    if (is_file and is_outside(value, root, [folder])) or (not is_file and leads_out(value)):
        raise SceneError(f"{place(node)}: {value[:200]!r} is outside the upload; put the file beside the scene")


def _check_metal(material: Any, folder: Path | None, place: Any, node: Any) -> None:
    """A metal is the name of a file among Mitsuba's data, which it would look for in the working folder as well."""
    if not isinstance(material, str) or material in _metals():
        return
    # One that leads elsewhere is no name of a metal: whether something is there must not show.
    data = None if folder is None or leads_out(material) else folder / "data" / "ior"
    own = [] if data is None else [data / f"{material}.{part}.spd" for part in ("eta", "k")]
    if not own or not all(path.is_file() for path in own):
        raise SceneError(
            f"{place(node)}: the material {material[:80]!r} is not known; choose one of Mitsuba's, for example "
            "Au or Al, or give eta and k"
        )
    for path in own:
        try:
            check_spectrum(path)
        except SceneError as error:
            raise SceneError(f"{place(node)}: {error}") from None


@cache
def _metals() -> frozenset[str]:
    files = (mitsuba_folder() / "data" / "ior").glob("*.eta.spd")
    return frozenset({"none", *(path.name.removesuffix(".eta.spd") for path in files)})


def _is_finite(value: Any) -> bool:
    if isinstance(value, bool):
        return True
    if isinstance(value, (int, float)):
        return math.isfinite(value)
    name = type(value).__name__
    if "Reference" in name:
        return True
    if "Transform" in name:
        return bool(np.isfinite(np.array(value.matrix)).all())
    if name == "Spectrum":
        return all(map(math.isfinite, [*value.values, *value.wavelengths]))
    if "Color" in name or "Array" in name or "Vector" in name or "Point" in name:
        return bool(np.isfinite(np.array(value, dtype=np.float64)).all())
    return True


def _shown(value: Any) -> str:
    text = " ".join(str(np.array(value.matrix).tolist() if hasattr(value, "matrix") else value).split())
    return text if len(text) < 80 else text[:77] + "…"
