"""What makes two scenes the same: the digest of everything that a scene is made of."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderer.backend import mitsuba
from renderer.scene.assets import Assets
from renderer.scene.vet.nodes import properties

_NOT_OF_THE_FILM = ("width", "height", "file_format", "component_format")


def digest_of(state: Any, assets: Assets) -> str:
    """SHA-256 over all nodes, in order, and the contents of every file they name; hexadecimal."""
    h = hashlib.sha256()
    mi = mitsuba()
    hashed: dict[Any, bytes] = {}
    not_pictured, film = (mi.ObjectType.Integrator, mi.ObjectType.Sampler), mi.ObjectType.Film
    for index, node in enumerate(state.nodes):
        if node.type in not_pictured:
            continue
        h.update(f"\n{node.type}:{node.props.plugin_name()}".encode())
        for key, value in properties(node):
            if node.type == film and key in _NOT_OF_THE_FILM:
                continue
            h.update(f"\n {key}={_fingerprint(value)}".encode())
        if found := assets.digests.get(index):
            h.update(found)
        elif path := assets.paths.get(index):
            if path not in hashed:
                with open(path, "rb") as contents:
                    hashed[path] = hashlib.file_digest(contents, "sha256").digest()
            h.update(hashed[path])
    return h.hexdigest()


def _fingerprint(value: Any) -> str:
    """Text that changes when a property's value does."""
    if isinstance(value, (bool, int, float, str)):
        return repr(value)
    if "Transform" in type(value).__name__:
        return _array_text(np.array(value.matrix))  # its text has six digits only
    if type(value).__name__ == "Spectrum":  # its text has six digits, or the number of values alone
        return _array_text(np.array([*value.wavelengths, *value.values], np.float64))
    mi = mitsuba()
    if isinstance(value, mi.Object) and not isinstance(value, (mi.Bitmap, mi.VolumeGrid)):
        parameters = mi.traverse(value)
        parts = [f"{k}:{_fingerprint(parameters[k])}" for k in sorted(parameters.keys())]
        return f"{type(value).__name__}({','.join(parts)})"
    try:
        array = np.asarray(value)
    except (TypeError, ValueError, RuntimeError):
        array = None
    if array is not None and array.dtype != object and array.size:
        return _array_text(array)
    return str(value)


def _array_text(array: NDArray[Any]) -> str:
    return f"{array.dtype}{array.shape}{hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest()}"
