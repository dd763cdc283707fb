"""What a scene requires, measured on its parsed form before anything is instantiated.

Enters: Mitsuba's parser state. Leaves: `Requirements`, or an error that names what is missing, and where.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any

from renderer.backend import mitsuba
from renderer.errors import SceneError, UnsupportedScene
from renderer.scene.source import Parsed

POLARISED = frozenset({"polarizer", "retarder", "circular", "measured_polarized", "stokes"})
DEFAULT_RR_DEPTH = 5
UNLIMITED = -1


@dataclass(frozen=True, slots=True)
class Requirements:
    """What was found: plugins by kind with their number, what the file asks of an integrator, and named warnings."""

    shapes: dict[str, int]
    bsdfs: dict[str, int]
    emitters: dict[str, int]
    max_depth: int
    rr_depth: int
    hide_emitters: bool
    warnings: tuple[str, ...]
    is_coloured: bool = True


def measure(parsed: Parsed) -> Requirements:
    """Counts what is there, refuses what is not supported, warns of what is odd."""
    mi = mitsuba()
    kinds: dict[Any, Counter[str]] = {}
    max_depth, rr_depth, hide_emitters = UNLIMITED, DEFAULT_RR_DEPTH, False
    for node in parsed.state.nodes:
        plugin = node.props.plugin_name()
        where = mi.parser.file_location(parsed.state, node)
        kinds.setdefault(node.type, Counter())[plugin] += 1
        if node.type in (mi.ObjectType.Medium, mi.ObjectType.Volume, mi.ObjectType.PhaseFunction):
            raise UnsupportedScene(
                f"{where}: participating media are not supported yet, and this scene has one ({plugin})"
            )
        if plugin in POLARISED:
            raise UnsupportedScene(f"{where}: polarised light is not supported, and this scene asks for it ({plugin})")
        if node.type == mi.ObjectType.Integrator:
            props = node.props
            if "max_depth" in props:
                max_depth = int(props["max_depth"])
            elif plugin == "direct":
                max_depth = 2
            if "rr_depth" in props:
                rr_depth = int(props["rr_depth"])
            if "hide_emitters" in props:
                hide_emitters = bool(props["hide_emitters"])
    if not kinds.get(mi.ObjectType.Sensor):
        raise SceneError(f'{parsed.name}: the scene has no sensor; add one, for example <sensor type="perspective"/>')
    emitters = dict(kinds.get(mi.ObjectType.Emitter, {}))
    warnings = [] if emitters else ["no emitters: the image will be black"]
    return Requirements(
        shapes=dict(kinds.get(mi.ObjectType.Shape, {})),
        bsdfs=dict(kinds.get(mi.ObjectType.BSDF, {})),
        emitters=emitters,
        max_depth=max_depth,
        rr_depth=max(rr_depth, 1),
        hide_emitters=hide_emitters,
        warnings=tuple(warnings),
    )
