"""Which technique can find which light, and what none of them can.

A direction that is drawn never meets a point, nor the one direction of a distant light: such *delta* lights are found
by emitter sampling alone. A shape whose surface cannot be sampled is found by directions alone. Light of a delta light
that comes by way of a mirror or clear glass is a delta of both, which no path tracer finds.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderer.backend import mitsuba
from renderer.equation.lights.scene_lights import is_sampleable
from renderer.scene.plugins import by_class

mi: Any = mitsuba()

_MOST_NAMED = 4
NEARLY_SMOOTH = 0.012  # roughness, below which a lobe is as narrow as `light_paths.NARROW`
# The smallest α that values of a parameter stand for. Principled BSDFs square their roughness; a coat has 0.1 … 0.001.
_ALPHA: dict[str, Callable[[NDArray[np.float64]], float]] = {
    **dict.fromkeys(("alpha", "alpha_u", "alpha_v"), lambda values: float(values.min())),
    "roughness": lambda values: float(values.min()) ** 2,
    "clearcoat_gloss": lambda values: 0.1 - 0.099 * float(values.max()),
}


def cannot_see(technique: str, scene: Any, max_depth: int = -1, *, passes_null: bool = False) -> tuple[str, ...]:
    """What the technique cannot find in a Mitsuba scene: one line each, for example "point light 'lamp'".

    passes_null: whether points on lights are connected through surfaces that let light pass unchanged, as in media."""
    emitters = list(scene.emitters())
    lost = [e for e in emitters if not _finds(technique, e)]
    lines = named(lost)
    if max_depth in (0, 1, 2) or not _has_delta_surface(scene, passes_null):
        return lines
    by_surface = [e for e in emitters if e not in lost and _is_delta(e)]
    return lines + tuple(f"{line} by way of a mirror or clear glass" for line in named(by_surface))


def _finds(technique: str, emitter: Any) -> bool:
    by_emitter = is_sampleable(emitter)
    by_direction = not _is_delta(emitter)
    if technique == "mis":
        return by_emitter or by_direction
    return by_emitter if technique == "emitter" else by_direction


def _is_delta(emitter: Any) -> bool:
    return bool(mi.has_flag(emitter.flags(), mi.EmitterFlags.Delta))


def _has_delta_surface(scene: Any, passes_null: bool) -> bool:
    kinds = mi.BSDFFlags
    delta = int(kinds.DeltaReflection | kinds.DeltaTransmission) if passes_null else int(kinds.Delta)
    return any(shape.bsdf() is not None and int(shape.bsdf().flags()) & delta for shape in scene.shapes())


def is_specular(bsdf: Any) -> bool:
    """Whether a BSDF is a mirror or clear, in part at least, or so nearly that no light is found beside its lobe."""
    if bsdf is None:
        return False
    if mi.has_flag(bsdf.flags(), mi.BSDFFlags.Delta):
        return True
    if not int(bsdf.flags()) & int(mi.BSDFFlags.Glossy):
        return False
    return _least_alpha(mi.traverse(bsdf)) < NEARLY_SMOOTH


def _least_alpha(known: Any) -> float:
    """The smallest roughness of a BSDF's lobes, anywhere on it; infinite where it tells of none."""
    least = math.inf
    for key in known.properties:
        parts = str(key).split(".")
        name = parts[-2] if len(parts) > 1 and parts[-1] in ("value", "data") else parts[-1]
        if name in _ALPHA:
            least = min(least, _ALPHA[name](np.array(known[key], np.float64)))
    return least


def named(emitters: list[Any]) -> tuple[str, ...]:
    """A line for each, or for each kind where there are many."""
    if len(emitters) > _MOST_NAMED:
        return tuple(f"{n} × {kind}" if n > 1 else kind for kind, n in Counter(map(_kind, emitters)).items())
    return tuple(f"{_kind(e)} '{name}'" if (name := _name(e)) else _kind(e) for e in emitters)


def label(emitter: Any) -> str:
    """What to call a light in a sentence: its name, or its kind."""
    return f"'{name}'" if (name := _name(emitter)) else f"the {_kind(emitter)}"


def _kind(emitter: Any) -> str:
    shape = emitter.get_shape()
    loaded = str(emitter.class_name())
    kind = by_class()[loaded].label if loaded in by_class() else loaded
    return kind if shape is None or is_sampleable(emitter) else f"{kind} on a {shape.class_name()}"


def _name(emitter: Any) -> str:
    """Its shape's id, or its own; Mitsuba's made-up ones begin with an underscore."""
    shape = emitter.get_shape()
    ids = [shape.id() if shape is not None else "", emitter.id()]
    return next((str(i) for i in ids if i and not i.startswith("_")), "")
