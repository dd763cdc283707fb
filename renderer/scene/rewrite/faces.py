"""Drops triangles of zero area from loaded meshes: no ray can hit them, and no point on them can be drawn."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderer.backend import mitsuba


def kept_faces(positions: NDArray[np.float32], faces: NDArray[np.uint32]) -> NDArray[np.bool_]:
    """Which triangles have an area. positions: (n, 3); faces: (m, 3) vertex indices."""
    x, y, z = np.ascontiguousarray(positions.T, np.float64)
    a, b, c = np.ascontiguousarray(faces.T)
    # The normal's components, without the sum of their squares, which would vanish for small faces.
    (xb, yb, zb), (xc, yc, zc) = ([axis[end] - axis[a] for axis in (x, y, z)] for end in (b, c))
    kept: NDArray[np.bool_] = np.abs(yb * zc - zb * yc) + np.abs(zb * xc - xb * zc) + np.abs(xb * yc - yb * xc) > 0
    return kept


def without_flat_faces(scene: Any, least_share: float = 0.0) -> tuple[int, int]:
    """Drops the triangles of zero area from a loaded scene's meshes, in place.

    They cost memory and nothing else, and dropping them builds the ray-casting structure again: done only where they
    are more than `least_share` of all triangles. A mesh with nothing else keeps them: Mitsuba has no empty mesh.
    Returns the numbers found and dropped.
    """
    shapes = scene.shapes()
    if not any(shape.class_name() == "Instance" for shape in shapes):  # naming all parameters is slow: look first
        meshes = [shape for shape in shapes if shape.is_mesh()]
        found = sum(map(_missing, _kept_of_all([(m.vertex_positions_buffer(), m.faces_buffer()) for m in meshes])))
        if not found:
            return 0, 0
    mi = mitsuba()
    parameters = mi.traverse(scene)
    keys = [key for key in parameters.keys() if key.endswith("faces")]  # noqa: SIM118 (no mapping)
    kept = _kept_of_all([(parameters[f"{key.removesuffix('faces')}vertex_positions"], parameters[key]) for key in keys])
    found = sum(map(_missing, kept))
    droppable = {key: mask for key, mask in zip(keys, kept, strict=True) if _missing(mask) and mask.any()}
    dropped = sum(map(_missing, droppable.values()))
    if dropped <= least_share * sum(map(len, kept)):
        return found, 0
    names, normals = list(parameters.keys()), {}
    for key, mask in droppable.items():
        mesh = key.removesuffix("faces")
        for name in names:
            if name == f"{mesh}vertex_normals":
                normals[name] = np.array(parameters[name])
            elif name == key or name.startswith(f"{mesh}face_"):
                rows = np.array(parameters[name]).reshape(len(mask), -1)
                parameters[name] = type(parameters[name])(rows[mask].ravel())
    parameters.update()
    if normals:  # Mitsuba has made new ones for the new faces
        for name, kept_normals in normals.items():
            parameters[name] = mi.Float(kept_normals)
        parameters.update()
    return found, dropped


def _missing(mask: NDArray[np.bool_]) -> int:
    return int(len(mask) - mask.sum())


def _kept_of_all(meshes: list[tuple[Any, Any]]) -> list[NDArray[np.bool_]]:
    """`kept_faces` of each mesh, told for all of them at once: a scene may have thousands of small ones.

    meshes: vertex positions and faces of each, flat.
    """
    if not meshes:
        return []
    positions = [found.numpy().reshape(-1, 3) for found, _ in meshes]
    faces = [found.numpy().reshape(-1, 3) for _, found in meshes]
    first = np.cumsum([0, *map(len, positions)])
    joined = np.concatenate([mine + n for mine, n in zip(faces, first, strict=False)])
    return np.split(kept_faces(np.concatenate(positions), joined), np.cumsum([len(mine) for mine in faces])[:-1])
