"""Refuses plugins that have no row in `scene.plugins`, and folders that would have Mitsuba load libraries from them."""

from __future__ import annotations

from pathlib import Path

from renderer.errors import SceneError
from renderer.scene.plugins import PLUGINS, of_kind

SHAPES, SENSORS, FILMS, INTEGRATORS = map(of_kind, ("Shape", "Sensor", "Film", "Integrator"))
SAMPLERS = of_kind("Sampler")
_REPLACED = ("Sampler", "Integrator")  # never loaded
_WHY = {
    "blender": "reads another program's memory by address",
    "merge": "is Mitsuba's own and is made when a scene is loaded",
}
LIBRARY_SUFFIXES = (".so", ".dll", ".dylib", ".pyd")


def is_allowed(plugin: str) -> bool:
    """Whether a scene may use this plugin type."""
    return plugin in PLUGINS or plugin == "scene"


def is_of_kind(plugin: str, kind: str) -> bool:
    """Whether a plugin is what its place in the scene says: Mitsuba loads first and looks afterwards."""
    return kind in _REPLACED or not of_kind(kind) or plugin in of_kind(kind)


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

    found = difflib.get_close_matches(plugin[:80], sorted(PLUGINS.keys() - INTEGRATORS | {"scene"}), n=1, cutoff=0.75)
    return found[0] if found else None


def refuse_libraries(folders: tuple[str, ...], own: tuple[str, ...]) -> None:
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
