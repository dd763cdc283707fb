"""Changes to a parsed scene before it is instantiated. Each is a pure function, and can be switched off."""

from renderer.scene.rewrite.film import check_memory, check_size, film_size, neutralise_unused, sensor_dict

__all__ = ["check_memory", "check_size", "film_size", "neutralise_unused", "sensor_dict"]
