"""What a scene requires, measured on its parsed form before anything is instantiated.

Enters: Mitsuba's parser state and what its files hold. Leaves: `Requirements`; `refuse_unsupported` turns what is
missing into an error that names it and its place.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict, dataclass, fields
from typing import Any

from renderer.backend import mitsuba
from renderer.errors import SceneError, UnsupportedScene
from renderer.scene import features
from renderer.scene.colour import coloured_by
from renderer.scene.depth import depth_advice
from renderer.scene.geometry import bounds
from renderer.scene.numerics import THIN_GAP, numerical_warnings
from renderer.scene.source import Parsed
from renderer.scene.vet.nodes import number, properties

POLARISED = frozenset({"polarizer", "retarder", "circular", "measured_polarized", "stokes"})
DEFAULT_RR_DEPTH = 5
UNLIMITED = -1
NO_EMITTERS = "no emitters: the image will be black"
_MESHES = {"rectangle": 2, "cube": 12}  # triangles of shapes that Mitsuba makes itself


@dataclass(frozen=True, slots=True)
class Requirements:
    """What was found.

    shapes, bsdfs, emitters, textures, media, sensors: plugins by kind with their number. triangles: of meshes; in load
    mode an estimate for long text files. memory_bytes: estimate for the loaded scene, without the image.
    low, high: corners of the scene's bounds in its own units, None if not known. coloured_by: what depends on
    wavelength, None if nothing does. max_depth, rr_depth, hide_emitters: what the file asks of an integrator.
    has_…: see `features`. depth_advice: what depth is worth asking for. notes: what was dropped or rewritten.
    warnings: named, "tiny light: …". unsupported: what this renderer does not model, with its place.
    """

    shapes: dict[str, int]
    bsdfs: dict[str, int]
    emitters: dict[str, int]
    max_depth: int
    rr_depth: int
    hide_emitters: bool
    warnings: tuple[str, ...]
    textures: dict[str, int]
    media: dict[str, int]
    sensors: dict[str, int]
    triangles: int
    texture_pixels: int
    memory_bytes: int
    low: tuple[float, float, float] | None
    high: tuple[float, float, float] | None
    coloured_by: str | None
    has_delta: bool
    has_smooth: bool
    has_null: bool
    has_transmission: bool
    has_environment: bool
    has_point_lights: bool
    has_visible_emitters: bool
    reflects: bool
    needs_time: bool
    needs_uv: bool
    depth_advice: str
    notes: tuple[str, ...] = ()
    unsupported: tuple[str, ...] = ()

    @property
    def is_coloured(self) -> bool:
        """Whether anything depends on wavelength: reflectances, textures, emission."""
        return self.coloured_by is not None

    @property
    def variant(self) -> str:
        """The leanest colour model that loses nothing: mono or rgb. Spectral rendering is for those who ask."""
        return "rgb" if self.is_coloured else "mono"

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for files and messages."""
        return {**asdict(self), "is_coloured": self.is_coloured, "variant": self.variant, "features": self.features}

    @property
    def features(self) -> list[str]:
        """Names of what the kernel has to contain for this scene."""
        return [
            f.name.removeprefix("has_").replace("_", " ")
            for f in fields(self)
            if f.name.startswith("has_") and getattr(self, f.name)
        ]


def measure(parsed: Parsed) -> Requirements:
    """Counts what is there and says what is odd and what is not supported. Raises SceneError without a sensor."""
    mi = mitsuba()
    state = parsed.state
    kinds: dict[Any, Counter[str]] = {}
    unsupported: list[str] = []
    max_depth, rr_depth, hide_emitters = UNLIMITED, DEFAULT_RR_DEPTH, False
    for node in state.nodes:
        plugin = node.props.plugin_name()
        kinds.setdefault(node.type, Counter())[plugin] += 1
        if (why := _unsupported(node, plugin)) is not None:
            unsupported.append(f"{parsed.place(node)}: {why}")
        if node.type == mi.ObjectType.Integrator:
            asked = dict(properties(node))
            if "max_depth" in asked:
                max_depth = int(number(asked, "max_depth", UNLIMITED))
            elif plugin == "direct":
                max_depth = 2
            rr_depth = int(number(asked, "rr_depth", rr_depth))
            hide_emitters = bool(asked.get("hide_emitters", hide_emitters))
    if not kinds.get(mi.ObjectType.Sensor):
        raise SceneError(f'{parsed.name}: the scene has no sensor; add one, for example <sensor type="perspective"/>')
    count = {kind: dict(found) for kind, found in kinds.items()}
    shapes = parsed.shapes
    box = bounds(shapes)
    found = features.of(state)
    own = sum(_MESHES.get(shape.plugin, 0) for shape in shapes)
    return Requirements(
        shapes=count.get(mi.ObjectType.Shape, {}),
        bsdfs=count.get(mi.ObjectType.BSDF, {}),
        emitters=count.get(mi.ObjectType.Emitter, {}),
        textures=count.get(mi.ObjectType.Texture, {}),
        media=count.get(mi.ObjectType.Medium, {}),
        sensors=count.get(mi.ObjectType.Sensor, {}),
        max_depth=max_depth,
        rr_depth=max(rr_depth, 1),
        hide_emitters=hide_emitters,
        warnings=warnings_of(parsed),
        triangles=parsed.assets.triangles + own,
        texture_pixels=parsed.assets.texture_pixels,
        memory_bytes=parsed.assets.memory_bytes,
        low=None if box is None else tuple(map(float, box[0])),  # type: ignore[arg-type]
        high=None if box is None else tuple(map(float, box[1])),  # type: ignore[arg-type]
        coloured_by=coloured_by(state, parsed.assets),
        depth_advice=depth_advice(state, max_depth, found),
        unsupported=tuple(dict.fromkeys(unsupported)),
        **asdict(found),
    )


def refuse_unsupported(needs: Requirements) -> None:
    """Raises UnsupportedScene for the first thing that is not modelled."""
    if needs.unsupported:
        raise UnsupportedScene(needs.unsupported[0])


def _unsupported(node: Any, plugin: str) -> str | None:
    mi = mitsuba()
    if node.type in (mi.ObjectType.Medium, mi.ObjectType.PhaseFunction):
        return f"participating media are not supported yet, and this scene has one ({plugin})"
    if plugin in POLARISED:
        return f"polarised light is not supported, and this scene asks for it ({plugin})"
    if plugin == "irradiancemeter":
        return f"sensors that are part of a shape are not supported, and this scene has one ({plugin}); use a camera"
    if plugin == "timed_sunsky":
        return f"{plugin} cannot be used in a compiled kernel, by Mitsuba's own path either; use sunsky with a date"
    return None


def warnings_of(parsed: Parsed, thin_gap: float = THIN_GAP) -> tuple[str, ...]:
    """What is legal but odd about a scene. thin_gap: see `numerical_warnings`."""
    mi = mitsuba()
    found = numerical_warnings(parsed, parsed.shapes, thin_gap)
    if not any(node.type == mi.ObjectType.Emitter for node in parsed.state.nodes):
        return (NO_EMITTERS, *found)
    return found
