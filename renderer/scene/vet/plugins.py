"""The plugins that a scene may use: all of Mitsuba 3.9 that only computes.

A type is the name of a shared library, which Mitsuba looks for in the scene's folder first: a name that is not on
this list never reaches it, and neither does a scene whose folder holds libraries of its own.
"""

from __future__ import annotations

from pathlib import Path

from renderer.errors import SceneError

SHAPES = frozenset(
    "bsplinecurve cube cylinder disk ellipsoids ellipsoidsmesh instance linearcurve obj ply rectangle sdfgrid "
    "serialized shapegroup sphere".split()
)
BSDFS = frozenset(
    "blendbsdf bumpmap circular conductor dielectric diffuse hair mask measured measured_polarized normalmap null "
    "plastic polarizer pplastic principled principledthin retarder roughconductor roughdielectric roughplastic "
    "thindielectric twosided".split()
)
EMITTERS = frozenset(
    "area constant directional directionalarea envmap point projector spot sunsky timed_sunsky".split()
)
TEXTURES = frozenset(
    "bitmap blackbody checkerboard d65 irregular mesh_attribute rawconstant regular srgb uniform volume".split()
)
SENSORS = frozenset(
    "batch distant irradiancemeter orthographic perspective radiancemeter thinlens".split(),
)
MEDIA = frozenset("homogeneous heterogeneous".split())
PHASE_FUNCTIONS = frozenset("blendphase hg isotropic rayleigh sggx tabphase".split())
VOLUMES = frozenset("constvolume gridvolume".split())
FILMS = frozenset("hdrfilm specfilm".split())
FILTERS = frozenset("box catmullrom gaussian lanczos mitchell tent".split())
# Replaced by ours, or never loaded: listed so that the scene may name them.
SAMPLERS = frozenset("independent ldsampler multijitter orthogonal stratified".split())
INTEGRATORS = frozenset("aov depth direct moment path ptracer stokes volpath volpathmis".split())

ALLOWED: frozenset[str] = frozenset({"scene"}).union(
    *(SHAPES, BSDFS, EMITTERS, TEXTURES, SENSORS, MEDIA, PHASE_FUNCTIONS, VOLUMES, FILMS, FILTERS, SAMPLERS)
)
_WHY = {
    "blender": "reads another program's memory by address",
    "merge": "is Mitsuba's own and is made when a scene is loaded",
}
LIBRARY_SUFFIXES = (".so", ".dll", ".dylib", ".pyd")


KINDS = {  # by Mitsuba's name for what a node is
    "Shape": SHAPES,
    "BSDF": BSDFS,
    "Emitter": EMITTERS,
    "Texture": TEXTURES,
    "Sensor": SENSORS,
    "Medium": MEDIA,
    "PhaseFunction": PHASE_FUNCTIONS,
    "Volume": VOLUMES,
    "Film": FILMS,
    "ReconstructionFilter": FILTERS,
}


def is_allowed(plugin: str) -> bool:
    """Whether a scene may use this plugin type."""
    return plugin in ALLOWED or plugin in INTEGRATORS


def is_of_kind(plugin: str, kind: str) -> bool:
    """Whether a plugin is what its place in the scene says: Mitsuba loads first and looks afterwards."""
    return kind not in KINDS or plugin in KINDS[kind]


def check_plugin(plugin: str, where: str) -> None:
    """Refuses a plugin type that is not on the list. where: place to name in the message."""
    if is_allowed(plugin):
        return
    why = _WHY.get(plugin, "is no plugin of Mitsuba 3.9 that scenes may use")
    near = _nearest(plugin)
    hint = f"; did you mean {near}?" if near else "; remove it or choose another type"
    raise SceneError(f"{where}: the type {plugin[:80]!r} {why}{hint}")


def _nearest(plugin: str) -> str | None:
    import difflib

    found = difflib.get_close_matches(plugin[:80], sorted(ALLOWED), n=1, cutoff=0.75)
    return found[0] if found else None


def refuse_libraries(folders: tuple[str, ...], own: list[str]) -> None:
    """Refuses search folders that would have Mitsuba load code from them. own: folders that it searches anyway."""
    for folder in folders:
        plugins = Path(folder) / "plugins"
        if folder in own or not plugins.is_dir():
            continue
        for path in plugins.iterdir():
            if path.suffix.lower() in LIBRARY_SUFFIXES:
                raise SceneError(
                    f"plugins/{path.name} beside the scene would be run as a part of Mitsuba; remove that file"
                )
