"""Changes to a parsed scene before it is instantiated. Each is a pure function, and can be switched off."""

from renderer.scene.rewrite.film import (
    SensorFacts,
    check_memory,
    check_size,
    chosen_sensor,
    metered_shapes,
    neutralise_unused,
    sensor_dict,
    sensors_of,
    several_sensors,
)
from renderer.scene.rewrite.lights import NO_AREA_TO_METER
from renderer.scene.rewrite.view import MOVABLE, set_camera

__all__ = [
    "MOVABLE",
    "NO_AREA_TO_METER",
    "SensorFacts",
    "check_memory",
    "check_size",
    "chosen_sensor",
    "metered_shapes",
    "neutralise_unused",
    "sensor_dict",
    "sensors_of",
    "set_camera",
    "several_sensors",
]
