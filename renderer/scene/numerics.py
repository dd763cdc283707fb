"""Named warnings of what is numerically risky in a scene, told from its parsed form.

A warning is "name: sentence". The names are fixed: scale, distance from origin, tiny light, zero-area light, flat
shape, thin gap. What `rewrite` mends is told as a note there and does not appear here.
"""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any

import numpy as np

from renderer.backend import mitsuba
from renderer.scene.geometry import Placed, bounds, children
from renderer.scene.vet.nodes import number, properties, vector

if TYPE_CHECKING:
    from renderer.scene.source import Parsed

SMALL, LARGE = 1e-7, 1e7  # sizes beyond which even a rescaled scene loses digits
FAR = 1e6  # distance from the origin in sizes of the scene: its coordinates have no digits left for details
TINY_LIGHT = 1e-4  # of the scene's size
THIN_GAP = 5e-5  # of the scene's size: rays start 9e-5 of a coordinate off a surface,
THIN_GAP_LISTED = 1e-6  # but on it where a scene has so few primitives that all are tried (`equation/rays.py`)
_MAX_PAIRS = 400  # shapes to compare with each other


def numerical_warnings(parsed: Parsed, shapes: list[Placed], thin_gap: float = THIN_GAP) -> tuple[str, ...]:
    """The warnings of a scene, in the order of the list above. thin_gap: what rays cannot tell apart, of its size."""
    box = bounds(shapes)
    if box is None:
        return ()
    size = float(np.linalg.norm(box[1] - box[0]))
    warnings = []
    if size and not SMALL < size < LARGE:
        warnings.append(f"scale: the scene is {size:.3g} across; sizes from 0.001 to 10000 keep most digits")
    distance = float(np.linalg.norm((box[0] + box[1]) / 2))
    if size and distance > FAR * size:
        warnings.append(
            f"distance from origin: the scene lies {distance:.3g} away and is {size:.3g} across; "
            "move it to the origin, its coordinates have hardly any digits left"
        )
    warnings += _small_lights(parsed, shapes, size)
    warnings += _thin_gaps(parsed, shapes, thin_gap * size)
    return tuple(warnings)


def emits(state: Any, index: int) -> bool:
    """Whether a shape is a light."""
    kind = mitsuba().ObjectType.Emitter
    return any(state.nodes[inner].type == kind for _, inner in children(state, state.nodes[index]))


def _small_lights(parsed: Parsed, shapes: list[Placed], size: float) -> list[str]:
    warnings = []
    tiny = []
    for shape in shapes:
        if shape.box is None or not size or not emits(parsed.state, shape.index):
            continue
        if sorted((shape.box[1] - shape.box[0]).tolist())[1] < TINY_LIGHT * size:
            tiny.append(shape)
    if tiny:
        place = parsed.place(parsed.state.nodes[tiny[0].index])
        others = f" and {len(tiny) - 1} more" if len(tiny) > 1 else ""
        warnings.append(
            f"tiny light: {place}{others} is less than {TINY_LIGHT:g} of the scene across; only emitter sampling "
            "finds it, so keep technique mis or emitter"
        )
    return warnings


def _thin_gaps(parsed: Parsed, shapes: list[Placed], thin: float) -> list[str]:
    """Concentric spheres and parallel plates closer than rays can tell apart."""
    spheres = [(shape, *_sphere(parsed.state, shape)) for shape in shapes if shape.plugin == "sphere"]
    plates = [shape for shape in shapes if shape.plugin in ("rectangle", "disk")]
    for (a, centre_a, radius_a), (b, centre_b, radius_b) in itertools.combinations(spheres[:_MAX_PAIRS], 2):
        gap = abs(radius_a - radius_b) - float(np.linalg.norm(centre_a - centre_b))
        if 0 < gap < thin:
            return [_gap(parsed, a, b, gap)]
    for a, b in itertools.combinations(plates[:_MAX_PAIRS], 2):
        normal = np.linalg.inv(a.to_world)[:3, :3].T @ [0.0, 0.0, 1.0] if _is_regular(a) else np.zeros(3)
        length = float(np.linalg.norm(normal))
        if not length or not _overlap(a, b, thin):
            continue
        normal /= length
        heights = [abs(float(normal @ (corner - a.to_world[:3, 3]))) for corner in _corners(b)]
        if 0 < max(heights) < thin:
            return [_gap(parsed, a, b, max(heights))]
    return []


def _gap(parsed: Parsed, a: Placed, b: Placed, gap: float) -> str:
    places = " and ".join(parsed.place(parsed.state.nodes[shape.index]) for shape in (a, b))
    return f"thin gap: {places} are {gap:.2g} apart; light may pass through or leak there, move them apart"


def _sphere(state: Any, shape: Placed) -> tuple[np.ndarray, float]:
    values = dict(properties(state.nodes[shape.index]))
    centre = shape.to_world @ [*vector(values, "center", (0.0, 0.0, 0.0)), 1.0]
    scale = float(np.linalg.norm(shape.to_world[:3, 0]))
    return centre[:3], abs(number(values, "radius", 1.0)) * scale


def _corners(plate: Placed) -> np.ndarray:
    flat = np.array([[x, y, 0.0, 1.0] for x in (-1, 1) for y in (-1, 1)])
    return (flat @ plate.to_world.T)[:, :3]


def _is_regular(shape: Placed) -> bool:
    return abs(float(np.linalg.det(shape.to_world[:3, :3]))) > 0


def _overlap(a: Placed, b: Placed, margin: float) -> bool:
    if a.box is None or b.box is None:
        return False
    return bool((a.box[0] - margin <= b.box[1]).all() and (b.box[0] - margin <= a.box[1]).all())
