"""What only shows once a scene is loaded: rays tell whether the camera sits in a closed room with the light outside."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from renderer.backend import mitsuba, using
from renderer.scene.plugins import having

if TYPE_CHECKING:
    from renderer.scene.compile import Scene

_DIRECTIONS = 4096


def closed_room_warning(scene: Scene) -> str | None:
    """A named warning if all light comes from far away and no way out of the camera's room is seen."""
    needs = scene.requirements
    if not needs.emitters or set(needs.emitters) - having("far") or needs.has_transmission or needs.has_null:
        return None
    mi = mitsuba()
    origin = None if scene.is_meter else _camera_origin(scene.sensor)
    if origin is None:
        return None
    i = np.arange(_DIRECTIONS) + 0.5
    z, phi = 1 - 2 * i / _DIRECTIONS, i * np.pi * (3 - np.sqrt(5))  # a Fibonacci lattice
    r = np.sqrt(1 - z * z)
    d = np.stack([r * np.cos(phi), r * np.sin(phi), z]).astype(np.float32)
    with using(scene.variant):
        is_blocked = scene.mitsuba_scene.ray_test(mi.Ray3f(mi.Point3f(*origin), mi.Vector3f(d)))
    if not np.array(is_blocked).all():
        return None
    return (
        "closed room with light outside: all light comes from far away, and the camera sees no opening; "
        "the image will be black, put a light inside"
    )


def _camera_origin(sensor: Any) -> list[float] | None:
    try:
        matrix = np.array(mitsuba().traverse(sensor)["to_world"].matrix, dtype=np.float64).reshape(4, 4)
    except (KeyError, RuntimeError):
        return None
    return [float(x) for x in matrix[:3, 3]]
