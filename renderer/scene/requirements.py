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
from renderer.scene.asked import asked_for
from renderer.scene.colour import coloured_by, spectral_by
from renderer.scene.depth import depth_advice
from renderer.scene.features import Features
from renderer.scene.geometry import bounds, children, meters
from renderer.scene.numerics import THIN_GAP, numerical_warnings
from renderer.scene.plugins import having, of_kind
from renderer.scene.source import Parsed
from renderer.scene.vet.nodes import number, properties
from renderer.settings import STOKES

POLARISED = having("polarises")  # ask for it
DEFAULT_RR_DEPTH = 5
UNLIMITED = -1
NO_EMITTERS = "no emitters: the image will be black"
NOT_AUDITED = (
    "polarised light: light that comes by way of mirrors or glass and is hardly ever found is not looked for; render "
    "the scene without polarisation as well to be told of it"
)
_MESHES = {"rectangle": 2, "cube": 12}  # triangles of shapes that Mitsuba makes itself


@dataclass(frozen=True, slots=True, kw_only=True)
class Requirements(Features):
    """What was found, with the features that a kernel needs.

    shapes, bsdfs, emitters, textures, media, sensors: plugins by kind with their number. triangles: of meshes; in load
    mode an estimate for long text files. memory_bytes: estimate for the loaded scene, without the image.
    low, high: corners of the scene's bounds in its own units, None if not known. coloured_by: what depends on
    wavelength, None if nothing does; spectral_by: what only spectral rendering can. polarised_by: what asks for
    polarised light, None if nothing does. max_depth, rr_depth, hide_emitters: what the file asks of an integrator.
    depth_advice: what depth is worth asking for. channels: what the file asks for beside radiance: alpha by its film,
    others by its integrator. notes: what was dropped or rewritten.
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
    spectral_by: str | None
    depth_advice: str
    polarised_by: str | None = None
    channels: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    unsupported: tuple[str, ...] = ()

    @property
    def is_coloured(self) -> bool:
        """Whether anything depends on wavelength: reflectances, textures, emission."""
        return self.coloured_by is not None

    @property
    def variant(self) -> str:
        """The leanest colour model that loses nothing: mono or rgb. Spectral rendering is for those who ask, and for
        scenes that cannot do without."""
        if self.spectral_by is not None or (self.polarised_by is not None and self.is_coloured):
            return "spectral"
        return "rgb" if self.is_coloured else "mono"

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for files and messages."""
        return {**asdict(self), "is_coloured": self.is_coloured, "variant": self.variant, "features": self.features}

    @property
    def unheard(self) -> tuple[str, ...]:
        """What no audit will tell, as a warning: paths from the lights know no polarisation."""
        is_hidden = self.polarised_by is not None and self.has_delta and self.has_smooth
        return (NOT_AUDITED,) if is_hidden else ()

    @property
    def features(self) -> list[str]:
        """Names of what the kernel has to contain for this scene."""
        found = [
            f.name.removeprefix("has_").replace("_", " ")
            for f in fields(Features)
            if f.name.startswith("has_") and getattr(self, f.name)
        ]
        return found if self.polarised_by is None else [*found, "polarisation"]


def measure(parsed: Parsed, wants_stokes: bool = False) -> Requirements:
    """Counts what is there and says what is odd and what is not supported. wants_stokes: whether polarised light is
    asked for, whatever the scene says. Raises SceneError without a sensor."""
    mi = mitsuba()
    state = parsed.state
    kinds: dict[Any, Counter[str]] = {}
    unsupported: list[str] = []
    max_depth, rr_depth, hide_emitters = UNLIMITED, DEFAULT_RR_DEPTH, False
    on_shapes = meters(state)
    for index, node in enumerate(state.nodes):
        plugin = node.props.plugin_name()
        if (why := _unmetered(state, index, on_shapes)) is not None:
            unsupported.append(f"{parsed.place(node)}: {why}")
        kinds.setdefault(node.type, Counter())[plugin] += 1
        if (why := _unsupported(node, plugin)) is not None:
            unsupported.append(f"{parsed.place(node)}: {why}")
        if plugin == "shapegroup" and not any(
            state.nodes[inner].type == mi.ObjectType.Shape for _, inner in children(state, node)
        ):
            unsupported.append(f"{parsed.place(node)}: a shapegroup holds no shape; put one into it, or take it out")
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
    polarised_by, where = _polarised_by(parsed, wants_stokes)
    if polarised_by is not None and mi.ObjectType.Medium in kinds:
        unsupported.append(
            f"{where}: polarised light is not followed through participating media, and this scene has some beside "
            f"what asks for it ({polarised_by}); leave one of them out"
        )
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
        spectral_by=spectral_by(state),
        depth_advice=depth_advice(state, max_depth, found),
        polarised_by=polarised_by,
        channels=(*asked_for(state).channels, *((STOKES,) if polarised_by else ())),
        unsupported=tuple(dict.fromkeys(unsupported)),
        **asdict(found),
    )


def _polarised_by(parsed: Parsed, wants_stokes: bool) -> tuple[str | None, str]:
    """What asks for polarised light, and its place."""
    for node in parsed.state.nodes:
        if (plugin := node.props.plugin_name()) in POLARISED:
            return plugin, parsed.place(node)
    return (f"channel {STOKES}", parsed.name) if wants_stokes else (None, parsed.name)


def refuse_unsupported(needs: Requirements) -> None:
    """Raises UnsupportedScene for the first thing that is not modelled."""
    if needs.unsupported:
        raise UnsupportedScene(needs.unsupported[0])


def _unsupported(node: Any, plugin: str) -> str | None:
    mi = mitsuba()
    if plugin == "specfilm":
        return "bands of a spectral film are not rendered (specfilm); use hdrfilm, and colour spectral for its light"
    if node.type == mi.ObjectType.Sensor and "srf" in dict(properties(node)):
        return f"a sensor's response to wavelengths is not modelled, and this one has an srf ({plugin}); leave it out"
    if plugin == "volprim_rf_basic":
        return f"radiance fields are not supported, and this scene's integrator renders one ({plugin}); use path"
    if plugin == "timed_sunsky":
        return f"{plugin} cannot be used in a compiled kernel, by Mitsuba's own path either; use sunsky with a date"
    return None


def _unmetered(state: Any, index: int, on_shapes: dict[int, int]) -> str | None:
    """Why a sensor cannot meter what it is on. on_shapes: as of `meters`."""
    plugin = state.nodes[index].props.plugin_name()
    if plugin == "batch" and (why := _unbatched(state, index, on_shapes)) is not None:
        return why
    if index not in on_shapes:
        wanted = "put it inside a shape of the scene itself"
        return f"a sensor of the type {plugin} belongs to no shape; {wanted}" if plugin == "irradiancemeter" else None
    if plugin != "irradiancemeter":
        return f"a sensor of the type {plugin} is part of a shape, which only an irradiancemeter can be; take it out"
    shape = state.nodes[on_shapes[index]].props.plugin_name()
    if shape in of_kind("Shape") - having("area"):
        return f"points on a shape of the type {shape} cannot be drawn evenly; put the {plugin} on a mesh"
    return None


def _unbatched(state: Any, index: int, on_shapes: dict[int, int]) -> str | None:
    """Why the sensors of a batch are not rendered side by side: some are meters on shapes, and others are not, or they
    are in media, each in one of its own."""
    mi = mitsuba()
    parts = [part for _, part in children(state, state.nodes[index]) if state.nodes[part].type == mi.ObjectType.Sensor]
    metered = sum(part in on_shapes for part in parts)
    if not metered:
        return None
    way = "take each by --sensor, or all one after the other by --sensor all"
    if metered < len(parts):
        return f"a batch has irradiance meters and other sensors, which have no picture together; {way}"
    if any(node.type == mi.ObjectType.Medium for node in state.nodes):
        return f"a batch of irradiance meters knows no participating media; {way}"
    return None


def warnings_of(parsed: Parsed, thin_gap: float = THIN_GAP) -> tuple[str, ...]:
    """What is legal but odd about a scene. thin_gap: see `numerical_warnings`."""
    mi = mitsuba()
    found = (*numerical_warnings(parsed, parsed.shapes, thin_gap), *asked_for(parsed.state).notes)
    if not any(node.type == mi.ObjectType.Emitter for node in parsed.state.nodes):
        return (NO_EMITTERS, *found)
    return found
