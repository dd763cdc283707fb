"""Changes to a parsed scene before it is instantiated, and the sensor at the size that is asked for.

A sensor is instantiated apart from its scene: an image size is then no reason to load the scene, build its ray-casting
structure and compile its kernel again.
"""

from __future__ import annotations

from typing import Any

from renderer.backend import mitsuba
from renderer.errors import SettingsError
from renderer.scene.geometry import children
from renderer.scene.vet.nodes import number, properties
from renderer.scene.vet.plugins import FILMS
from renderer.settings import MAX_SIDE

PIXEL_BYTES = 250  # of moments, a snapshot's copy of them, and the arrays of a pass
_CROP = ("crop_offset_x", "crop_offset_y", "crop_width", "crop_height")
_DEFAULT_FILM = {"width": 768, "height": 576}  # Mitsuba's own defaults


def sensor_dict(state: Any, width: int | None, height: int | None) -> dict[str, Any]:
    """The first sensor of a parsed scene as a Mitsuba dictionary, its film at the given size.

    One side alone scales the other; a new size drops the film's crop window. Raises SettingsError outside 1 … 16384.
    """
    mi = mitsuba()
    nodes = state.nodes

    def to_dict(node: Any) -> dict[str, Any]:
        made: dict[str, Any] = {"type": node.props.plugin_name()}
        for key, value in properties(node):
            if node.props.type(key) == mi.Properties.Type.ResolvedReference:
                child = nodes[value.index()]
                if child.type in (mi.ObjectType.Film, mi.ObjectType.ReconstructionFilter, mi.ObjectType.Texture):
                    made[f"{key}_nested"] = to_dict(child)
                elif child.type in (mi.ObjectType.Sensor, mi.ObjectType.Shape):  # of a batch; what `distant` looks at
                    made[key] = to_dict(child)
            else:
                made[key] = value
        if node.type == mi.ObjectType.Film:
            _resize(made, width, height)
        return made

    sensor = next(node for node in nodes if node.type == mi.ObjectType.Sensor)
    made = to_dict(sensor)
    if not any(nodes[i].type == mi.ObjectType.Film for _, i in children(state, sensor)):
        film = {"type": "hdrfilm"}
        _resize(film, width, height)
        made["film"] = film
    return made


def film_size(state: Any) -> tuple[int, int]:
    """Width and height of the first sensor's image."""
    made = sensor_dict(state, None, None)
    film = next(part for part in made.values() if isinstance(part, dict) and part.get("type") in FILMS)
    width, height = (int(number(film, f"crop_{side}", film[side])) for side in ("width", "height"))
    return width, height


def _resize(film: dict[str, Any], width: int | None, height: int | None) -> None:
    own_width, own_height = (int(number(film, side, _DEFAULT_FILM[side])) for side in ("width", "height"))
    if width is None and height is None:
        check_size(own_width, own_height)
        film["width"], film["height"] = own_width, own_height
        return
    new_width = width if width is not None else max(1, round(own_width * (height or 1) / own_height))
    new_height = height if height is not None else max(1, round(own_height * (width or 1) / own_width))
    check_size(new_width, new_height)
    for key in _CROP:
        film.pop(key, None)
    film["width"], film["height"] = new_width, new_height


def check_size(width: int, height: int) -> None:
    """Refuses image sizes outside 1 … 16384."""
    if not (1 <= width <= MAX_SIDE and 1 <= height <= MAX_SIDE):
        raise SettingsError(f"image size is {width}×{height}; each side must be from 1 to {MAX_SIDE}")


def check_memory(width: int, height: int, available_bytes: int | None = None) -> None:
    """Refuses images whose moments and snapshots this machine cannot hold. Samples need none: memory does not grow."""
    needed = width * height * PIXEL_BYTES
    available = available_memory() if available_bytes is None else available_bytes
    if needed > available:
        raise SettingsError(
            f"image size is {width}×{height}, which needs {needed / 2**30:.1f} GiB of memory, and "
            f"{available / 2**30:.1f} GiB are free; ask for at most {int(available // PIXEL_BYTES)} pixels"
        )


def available_memory() -> int:
    """Bytes that this process can still take; without limit where the system does not say."""
    try:
        with open("/proc/meminfo") as told:
            found = next(line for line in told if line.startswith("MemAvailable:"))
        return int(found.split()[1]) * 1024
    except (OSError, StopIteration, ValueError):
        return 1 << 62


def neutralise_unused(state: Any) -> None:
    """Replaces integrators and samplers by plain ones: they are never used, and nobody vets the names of theirs."""
    mi = mitsuba()
    plain = {mi.ObjectType.Integrator: "path", mi.ObjectType.Sampler: "independent"}
    for node in state.nodes:
        if node.type not in plain:
            continue
        for key in list(node.props.keys()):
            del node.props[key]
        node.props.set_plugin_name(plain[node.type])
