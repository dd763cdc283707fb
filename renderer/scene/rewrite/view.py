"""A sensor that is set from outside the scene: its dictionary with another place, view or angle."""

from __future__ import annotations

from typing import Any

from renderer.backend import mitsuba
from renderer.camera import Camera, to_world
from renderer.errors import SettingsError
from renderer.scene.geometry import matrix_of
from renderer.scene.rewrite.similarity import Similarity

MOVABLE = ("perspective", "thinlens")


def set_camera(sensor: dict[str, Any], camera: Camera | None, similarity: Similarity, label: str) -> dict[str, Any]:
    """A sensor's dictionary, of a scene under a similarity, as the camera says. label: of the sensor, to be shown.

    Raises SettingsError for a sensor that is no camera with a lens or a pinhole, and where no view follows.
    """
    if camera is None:
        return sensor
    if sensor["type"] not in MOVABLE:
        raise SettingsError(
            f"camera is given, and sensor {label} is of the type {sensor['type']}; only {' and '.join(MOVABLE)} "
            "sensors can be set so: leave camera out, or choose another sensor"
        )
    made = dict(sensor)
    if camera.origin is not None or camera.is_turned:
        origin, target = (None if at is None else similarity.moved(at) for at in (camera.origin, camera.target))
        matrix = to_world(matrix_of(sensor.get("to_world")), origin, target, camera.up)
        made["to_world"] = mitsuba().ScalarAffineTransform4d(matrix)
    if camera.fov is not None:
        made.pop("focal_length", None)
        made["fov"] = camera.fov
    return made
