"""Which technique can find which light, and what none of them can.

A direction that is drawn never meets a point, nor the one direction of a distant light: such *delta* lights are found
by emitter sampling alone. A shape whose surface cannot be sampled is found by directions alone. Light of a delta light
that comes by way of a mirror or clear glass is a delta of both, which no path tracer finds.
"""

from __future__ import annotations

from collections import Counter
from typing import Any

from renderer.backend import mitsuba
from renderer.equation.emitters import is_sampleable

mi: Any = mitsuba()

_KINDS = {
    "PointLight": "point light",
    "SpotLight": "spot light",
    "DirectionalEmitter": "directional light",
    "DirectionalArea": "directional area light",
    "Projector": "projector",
    "AreaLight": "area light",
    "ConstantBackgroundEmitter": "constant sky",
    "EnvironmentMapEmitter": "environment map",
    "SunskyEmitter": "sun and sky",
}
_MOST_NAMED = 4


def cannot_see(technique: str, scene: Any, max_depth: int = -1) -> tuple[str, ...]:
    """What the technique cannot find in a Mitsuba scene: one line each, for example "point light 'lamp'"."""
    emitters = list(scene.emitters())
    lost = [e for e in emitters if not _finds(technique, e)]
    lines = _named(lost)
    if max_depth in (0, 1, 2) or not _has_delta_surface(scene):
        return lines
    by_surface = [e for e in emitters if e not in lost and _is_delta(e)]
    return lines + tuple(f"{line} by way of a mirror or clear glass" for line in _named(by_surface))


def _finds(technique: str, emitter: Any) -> bool:
    by_emitter = is_sampleable(emitter)
    by_direction = not _is_delta(emitter)
    if technique == "mis":
        return by_emitter or by_direction
    return by_emitter if technique == "emitter" else by_direction


def _is_delta(emitter: Any) -> bool:
    return bool(mi.has_flag(emitter.flags(), mi.EmitterFlags.Delta))


def _has_delta_surface(scene: Any) -> bool:
    return any(
        shape.bsdf() is not None and mi.has_flag(shape.bsdf().flags(), mi.BSDFFlags.Delta) for shape in scene.shapes()
    )


def _named(emitters: list[Any]) -> tuple[str, ...]:
    """A line for each, or for each kind where there are many."""
    if len(emitters) > _MOST_NAMED:
        return tuple(f"{n} × {kind}" if n > 1 else kind for kind, n in Counter(map(_kind, emitters)).items())
    return tuple(f"{_kind(e)} '{name}'" if (name := _name(e)) else _kind(e) for e in emitters)


def _kind(emitter: Any) -> str:
    shape = emitter.get_shape()
    kind = _KINDS.get(str(emitter.class_name()), str(emitter.class_name()))
    return kind if shape is None or is_sampleable(emitter) else f"{kind} on a {shape.class_name()}"


def _name(emitter: Any) -> str:
    """Its shape's id, or its own; Mitsuba's made-up ones begin with an underscore."""
    shape = emitter.get_shape()
    ids = [shape.id() if shape is not None else "", emitter.id()]
    return next((str(i) for i in ids if i and not i.startswith("_")), "")
