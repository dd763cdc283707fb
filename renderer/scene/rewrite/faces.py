"""Drops triangles of zero area from loaded meshes: no ray can hit them, and no point on them can be drawn."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderer.backend import mitsuba


def kept_faces(positions: NDArray[np.float32], faces: NDArray[np.uint32]) -> NDArray[np.bool_]:
    """Which triangles have an area. positions: (n, 3); faces: (m, 3) vertex indices."""
    corners = positions[faces].astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    kept: NDArray[np.bool_] = np.einsum("ij,ij->i", normals, normals) > 0
    return kept


def without_flat_faces(scene: Any, least_share: float = 0.0) -> tuple[int, int]:
    """Drops the triangles of zero area from a loaded scene's meshes, in place.

    They cost memory and nothing else, and dropping them builds the ray-casting structure again: done only where they
    are more than `least_share` of all triangles. A mesh with nothing else keeps them: Mitsuba has no empty mesh.
    Returns the numbers found and dropped.
    """
    mi = mitsuba()
    parameters = mi.traverse(scene)
    kept_of: dict[str, NDArray[np.uint32]] = {}
    found = dropped = total = 0
    for key in [key for key in parameters.keys() if key.endswith("faces")]:  # noqa: SIM118 (no mapping)
        faces = np.array(parameters[key]).reshape(-1, 3)
        positions = np.array(parameters[f"{key.removesuffix('faces')}vertex_positions"]).reshape(-1, 3)
        kept = kept_faces(positions, faces)
        missing = int(len(kept) - kept.sum())
        total += len(kept)
        found += missing
        if missing and kept.any():
            kept_of[key] = faces[kept]
            dropped += missing
    if dropped <= least_share * total:
        return found, 0
    for key, faces in kept_of.items():
        parameters[key] = mi.UInt32(faces.ravel())
    parameters.update()
    return found, dropped
