"""Changes to a parsed scene before it is instantiated, and its sensors at the size that is asked for.

A sensor is instantiated apart from its scene: an image size is then no reason to load the scene, build its ray-casting
structure and compile its kernel again.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from renderer.backend import mitsuba
from renderer.errors import SettingsError
from renderer.scene.geometry import children, meters
from renderer.scene.plugins import having
from renderer.scene.vet.nodes import number, properties
from renderer.scene.vet.plugins import FILMS, SENSORS
from renderer.settings import MAX_SIDE, image_size

METERS = having("meter")
PIXEL_BYTES = 250  # of moments, a snapshot's copy of them, and the arrays of a pass
_DEFAULT_FILM = {"width": 768, "height": 576}  # Mitsuba's own defaults


@dataclass(frozen=True, slots=True)
class SensorFacts:
    """A sensor to choose. index: its place among the scene's. name: its id, or "". width, height: of its image."""

    index: int
    name: str
    plugin: str
    width: int
    height: int

    @property
    def label(self) -> str:
        """What to write to choose it."""
        return repr(self.name) if self.name else str(self.index)

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for files and messages."""
        return asdict(self)


def sensors_of(state: Any) -> tuple[SensorFacts, ...]:
    """The sensors of a parsed scene that can be chosen, in its order, then those on shapes: not those of a batch."""
    found = []
    for index, node in enumerate(_sensors(state)):
        made = sensor_dict(state, None, None, index)
        film = next(part for part in made.values() if isinstance(part, dict) and part.get("type") in FILMS)
        size = (int(number(film, f"crop_{side}", film[side])) for side in ("width", "height"))
        found.append(SensorFacts(index, node.props.id(), node.props.plugin_name(), *size))
    return tuple(found)


def chosen_sensor(sensors: tuple[SensorFacts, ...], asked: str | int | None) -> int:
    """The index of the sensor asked for by name or index; the first by default. Raises SettingsError."""
    if asked is None:
        return 0
    for sensor in sensors:
        if sensor.name == asked:
            return sensor.index
    index = int(asked) if isinstance(asked, int) or asked.isdecimal() else -1
    if 0 <= index < len(sensors):
        return index
    known = ", ".join(f"{s.index} {s.name!r}" if s.name else f"{s.index}" for s in sensors)
    raise SettingsError(f"sensor is {asked!r}, and the scene has {known}; give one of these names or numbers")


def several_sensors(sensors: tuple[SensorFacts, ...]) -> str | None:
    """A warning where more than one sensor could be meant."""
    if len(sensors) < 2:
        return None
    others = ", ".join(s.label for s in sensors[1:6]) + (", …" if len(sensors) > 6 else "")
    return (
        f"{len(sensors)} sensors: the picture is the first one's, {sensors[0].label}; choose another by name: {others}"
    )


def _sensors(state: Any) -> list[Any]:
    return [state.nodes[number] for number in _sensor_numbers(state)]


def _sensor_numbers(state: Any) -> list[int]:
    """Numbers of the nodes of the sensors that can be chosen."""
    mi = mitsuba()
    own = [number for _, number in children(state, state.root)]
    found = [number for number in own if state.nodes[number].type == mi.ObjectType.Sensor]
    found += meters(state)
    # Where there is none, one that lies deeper: it is refused by name later.
    return found or [n for n, node in enumerate(state.nodes) if node.type == mi.ObjectType.Sensor][:1]


def metered_shapes(state: Any, index: int) -> list[dict[str, Any]]:
    """The bare shapes that a sensor meters, as Mitsuba dictionaries: the one that it is on, or those that the meters of
    a batch are on; none of other sensors.
    """
    on_shapes = meters(state)
    number = _sensor_numbers(state)[index]
    parts = [number, *(part for _, part in children(state, state.nodes[number]))]
    return [_bare(state, state.nodes[on_shapes[part]]) for part in parts if part in on_shapes]


def _bare(state: Any, shape: Any) -> dict[str, Any]:
    reference = mitsuba().Properties.Type.ResolvedReference
    plain = {key: value for key, value in properties(shape) if shape.props.type(key) != reference}
    return {"type": shape.props.plugin_name(), **plain}


def sensor_dict(state: Any, width: int | None, height: int | None, index: int = 0) -> dict[str, Any]:
    """A sensor of a parsed scene as a Mitsuba dictionary, its film at the given size.

    One side alone scales the other. A crop window is scaled with the film: a size changes how finely something is
    pictured, not what. Raises SettingsError outside 1 … 16384.
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

    sensor = _sensors(state)[index]
    made = to_dict(sensor)
    if not any(nodes[i].type == mi.ObjectType.Film for _, i in children(state, sensor)):
        film = {"type": "hdrfilm"}
        _resize(film, width, height)
        made["film"] = film
    parts = [part["type"] for part in made.values() if isinstance(part, dict) and part["type"] in SENSORS]
    if {made["type"]} <= METERS or (parts and set(parts) <= METERS):
        # A pixel is the mean over its part of what is metered, alike everywhere.
        film = next(part for part in made.values() if isinstance(part, dict) and part.get("type") in FILMS)
        for key in [k for k, part in film.items() if isinstance(part, dict)]:
            del film[key]
        film["rfilter"] = {"type": "box"}
    return made


def _resize(film: dict[str, Any], width: int | None, height: int | None) -> None:
    """Scales a film and its crop window so that its image has the given size."""
    full = [int(number(film, side, _DEFAULT_FILM[side])) for side in ("width", "height")]
    own = [int(number(film, f"crop_{side}", n)) for side, n in zip(("width", "height"), full, strict=True)]
    check_size(*own)
    new = image_size((own[0], own[1]), width, height)
    check_size(*new)
    for axis, side in enumerate(("width", "height")):
        scale = new[axis] / own[axis]
        offset_key = f"crop_offset_{'xy'[axis]}"
        offset = int(number(film, offset_key, 0))
        before, behind = (round(n * scale) for n in (offset, full[axis] - own[axis] - offset))
        film[side] = before + new[axis] + behind
        if f"crop_{side}" in film:
            film[f"crop_{side}"] = new[axis]
        if offset_key in film:
            film[offset_key] = before


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
