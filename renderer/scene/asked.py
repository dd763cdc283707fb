"""What a scene's own integrator and film ask for beside radiance, and what of it we have.

Enters: parsed nodes. Leaves: `Asked`. Every integrator of Mitsuba's that estimates radiance is answered by ours; those
that ask for something else get it as channels, or are told that they do not.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from renderer.backend import mitsuba
from renderer.scene.plugins import having
from renderer.scene.vet.nodes import value_of

# Of the integrator `aov`: what each of its names is here. Others (uv, dp_du, prim_index, …) we have not.
_AOVS = {
    "albedo": "albedo",
    "depth": "depth",
    "position": "position",
    "sh_normal": "normal",
    "shape_index": "shape_index",
}
_WITHOUT_MEDIA = having("radiance") - having("volume")
_WITH_ALPHA = frozenset({"rgba", "luminance_alpha", "xyza"})


@dataclass(frozen=True, slots=True)
class Asked:
    """channels: names of ours, to be rendered beside radiance. notes: what is answered otherwise than asked."""

    channels: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def asked_for(state: Any) -> Asked:
    """What the parsed nodes ask for."""
    mi = mitsuba()
    channels: list[str] = []
    notes: list[str] = []
    has_media = any(node.type == mi.ObjectType.Medium for node in state.nodes)
    for node in state.nodes:
        if has_media and node.type == mi.ObjectType.Integrator and node.props.plugin_name() in _WITHOUT_MEDIA:
            notes.append(
                f"integrator {node.props.plugin_name()!r}: Mitsuba leaves media out with it; here they are rendered, "
                "as by 'volpath'; remove them from the scene to do without"
            )
        if node.type == mi.ObjectType.Film:
            if str(value_of(node, "pixel_format", "rgb")).lower() in _WITH_ALPHA:
                channels.append("alpha")
        elif node.type == mi.ObjectType.Integrator and (plugin := node.props.plugin_name()) not in having("radiance"):
            found, told = _of_integrator(plugin, str(value_of(node, "aovs", "")))
            channels += found
            notes.append(told)
    return Asked(tuple(dict.fromkeys(channels)), tuple(notes))


def _of_integrator(plugin: str, aovs: str) -> tuple[list[str], str]:
    """The channels that answer an integrator that asks for more or other than radiance, and what to say of that."""
    if plugin == "depth":
        return ["depth"], "integrator 'depth': distances are in the channel 'depth'; R, G and B are radiance"
    if plugin == "moment":
        return [], "integrator 'moment': R, G and B are radiance, and standard errors are in stderr.R, G, B and Y"
    if plugin != "aov":
        return [], f"integrator {plugin[:40]!r}: not known here; R, G and B are radiance as 'path' estimates it"
    pairs = [entry.split(":", 1) for entry in aovs.replace(" ", "").split(",") if ":" in entry]
    given = {name: _AOVS[kind] for name, kind in pairs if kind in _AOVS}
    missing = [f"{name}:{kind}" for name, kind in pairs if kind not in _AOVS]
    told = ", ".join(f"{name!r} is the channel {channel!r}" for name, channel in given.items()) or "no channel is given"
    lacks = f"; not available: {', '.join(missing)} (available: {', '.join(_AOVS)})" if missing else ""
    return list(given.values()), f"integrator 'aov': {told}{lacks}; R, G and B are radiance"
