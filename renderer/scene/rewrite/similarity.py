"""Re-centre and rescale: the scene's float32 coordinates get the digits that its details need.

Rays start a hair off a surface, a hair of 9e-5·(1 + largest coordinate) in Mitsuba: in a scene much smaller than one
unit, or far from the origin, that hair is longer than the scene's details. A power of two loses no bit.

    p′ = s·(p − c)

What a quantity becomes follows from its power of length: a position is moved, a distance grows by s, an intensity
(W·sr⁻¹) and a projector's irradiance at one unit by s², an extinction by 1/s; radiance, irradiance and directions stay.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderer.backend import mitsuba
from renderer.scene.geometry import Box, children, matrix_of
from renderer.scene.plugins import having
from renderer.scene.rewrite.emission import Unscalable, scale_emission
from renderer.scene.vet.nodes import number, properties, value_of, vector

Vector = tuple[float, float, float]
SMALL_RADIUS, LARGE_RADIUS = 2.0**12, 2.0**30  # of a scene that is left at its scale
# Distance of the bounds' centre from the origin, in radii, from which a scene is re-centred. Nearer, something small
# might lie at the origin, where its digits are, and something large elsewhere: moving would cost the small its digits.
_FAR = 8.0
_CENTRE_STEPS = 16  # per radius: the centre has few digits, so that subtracting it is exact
_CLIPS = (("near_clip", 1e-2), ("far_clip", 1e4))  # Mitsuba's own defaults
MODERATE_SCALE = 2.0**20  # that point lights bear
_MAX_GROWTH = MODERATE_SCALE**2  # of an intensity: float32 must hold it and its products


@dataclass(frozen=True, slots=True)
class Similarity:
    """p′ = scale·(p − centre): from the scene as it was written to the scene as it is rendered."""

    scale: float = 1.0
    centre: Vector = (0.0, 0.0, 0.0)

    @property
    def is_identity(self) -> bool:
        """Whether it changes nothing."""
        return self == Similarity()

    def moved(self, point: Any) -> NDArray[np.float64]:
        """Rendered coordinates of original ones. point: (…, 3)."""
        return self.scale * (np.asarray(point, np.float64) - np.asarray(self.centre))

    def original_position(self, point: Any) -> NDArray[np.float64]:
        """Original coordinates of rendered ones. point: (…, 3)."""
        return np.asarray(point, np.float64) / self.scale + np.asarray(self.centre)

    def original_distance(self, distance: Any) -> NDArray[np.float64]:
        """Original length of a rendered one."""
        return np.asarray(distance, np.float64) / self.scale


def choose(box: Box | None) -> Similarity:
    """The similarity that suits a scene of these bounds. Scenes of one shape at any scale 2^k become the same one."""
    if box is None or not np.isfinite(box).all():
        return Similarity()
    low, high = box
    radius = float(np.linalg.norm(high - low)) / 2
    if not 0 < radius < math.inf:
        return Similarity()
    centre = (low + high) / 2
    if float(np.linalg.norm(centre)) > _FAR * radius:
        step = _power_below(radius) / _CENTRE_STEPS
        moved = np.round(centre / step) * step
        place: Vector = (float(moved[0]), float(moved[1]), float(moved[2]))
    else:
        place = (0.0, 0.0, 0.0)
    scale = 1.0
    if radius < SMALL_RADIUS:
        scale = SMALL_RADIUS / _power_below(radius)
    elif radius > LARGE_RADIUS:
        scale = LARGE_RADIUS / _power_below(radius)
    return Similarity(scale, place)


def _power_below(x: float) -> float:
    """The largest power of two that is not above x."""
    return 2.0 ** math.floor(math.log2(x))


def apply(state: Any, similarity: Similarity) -> Any:
    """A copy of a parsed scene under a similarity. Raises Unscalable, saying what stands in the way."""
    mi = mitsuba()
    made = mi.parser.ParserState(state)
    if similarity.is_identity:
        return made
    top = {index for _, index in children(made, made.root)}
    for index, node in enumerate(list(made.nodes)):
        rule = _RULES.get(node.props.plugin_name())
        if node.type == mi.ObjectType.Shape:
            if index in top and node.props.plugin_name() != "shapegroup":
                _shape(made, node, similarity)
        elif rule is not None:
            rule(made, node, similarity)
        elif node.type in (mi.ObjectType.Sensor, mi.ObjectType.Medium) or (
            node.type == mi.ObjectType.Emitter and node.props.plugin_name() not in having("lengthless")
        ):
            raise Unscalable(f"{node.props.plugin_name()} has lengths that are not known")
    return made


# ------------------------------ Rules by plugin ------------------------------


def _shape(state: Any, node: Any, similarity: Similarity) -> None:
    plugin = node.props.plugin_name()
    if plugin not in having("grows") and similarity.scale != 1:
        raise Unscalable(f"{plugin} has radii that do not grow with its transform")
    _transform(node, similarity)


def _transform(node: Any, similarity: Similarity) -> None:
    """Moves and scales: to_world ← M·to_world."""
    matrix = matrix_of(value_of(node, "to_world"))
    # s·(t − c) at once: the sum of s·t and −s·c would lose the digits that all this is for.
    matrix[:3, 3] = similarity.moved(matrix[:3, 3])
    matrix[:3, :3] *= similarity.scale
    node.props["to_world"] = mitsuba().ScalarAffineTransform4d(matrix)


def _move(node: Any, similarity: Similarity) -> None:
    """Moves only: Mitsuba's cameras and spots take no scale, and need none."""
    matrix = matrix_of(value_of(node, "to_world"))
    matrix[:3, 3] = similarity.moved(matrix[:3, 3])
    node.props["to_world"] = mitsuba().ScalarAffineTransform4d(matrix)


def _scale(node: Any, key: str, default: float, factor: float) -> None:
    node.props[key] = number(dict(properties(node)), key, default) * factor


def _move_point(node: Any, key: str, similarity: Similarity) -> None:
    node.props[key] = mitsuba().ScalarPoint3d(
        *map(float, similarity.moved(vector(dict(properties(node)), key, (0.0, 0.0, 0.0))))
    )


def _clip(node: Any, similarity: Similarity) -> None:
    for key, default in _CLIPS:
        _scale(node, key, default, similarity.scale)


def _perspective(state: Any, node: Any, similarity: Similarity) -> None:
    _move(node, similarity)
    _clip(node, similarity)


def _thin_lens(state: Any, node: Any, similarity: Similarity) -> None:
    _scale(node, "focus_distance", number(dict(properties(node)), *_CLIPS[1]), similarity.scale)
    if value_of(node, "aperture_radius") is not None:
        _scale(node, "aperture_radius", 0.0, similarity.scale)
    _perspective(state, node, similarity)


def _orthographic(state: Any, node: Any, similarity: Similarity) -> None:
    _transform(node, similarity)  # here the scale is the width of the picture, and it scales the near plane too
    near, far = (number(dict(properties(node)), key, default) for key, default in _CLIPS)
    node.props["far_clip"] = near + similarity.scale * (far - near)


def _radiance_meter(state: Any, node: Any, similarity: Similarity) -> None:
    if value_of(node, "origin") is not None:
        _move_point(node, "origin", similarity)
        if value_of(node, "target") is not None:
            _move_point(node, "target", similarity)
    else:
        _move(node, similarity)


def _distant(state: Any, node: Any, similarity: Similarity) -> None:
    target = value_of(node, "target")
    if target is None:
        return
    if mitsuba().Properties.Type.ResolvedReference == node.props.type("target"):
        _shape(state, state.nodes[target.index()], similarity)
    else:
        _move_point(node, "target", similarity)


def _nothing(state: Any, node: Any, similarity: Similarity) -> None:
    pass


def _point(state: Any, node: Any, similarity: Similarity) -> None:
    if value_of(node, "position") is not None:
        _move_point(node, "position", similarity)
    else:
        _move(node, similarity)
    scale_emission(state, node, "intensity", _square(similarity))


def _spot(state: Any, node: Any, similarity: Similarity) -> None:
    _move(node, similarity)
    scale_emission(state, node, "intensity", _square(similarity))


def _projector(state: Any, node: Any, similarity: Similarity) -> None:
    _move(node, similarity)
    _scale(node, "scale", 1.0, _square(similarity))


def _bump_map(state: Any, node: Any, similarity: Similarity) -> None:
    _scale(node, "scale", 1.0, similarity.scale)  # heights are lengths


def _grid(state: Any, node: Any, similarity: Similarity) -> None:
    _transform(node, similarity)


def _medium(state: Any, node: Any, similarity: Similarity) -> None:
    _scale(node, "scale", 1.0, 1 / similarity.scale)


def _square(similarity: Similarity) -> float:
    factor = similarity.scale**2
    if not 1 / _MAX_GROWTH <= factor <= _MAX_GROWTH:
        raise Unscalable("a point light would need an intensity beyond float32")
    return factor


_RULES: dict[str, Callable[[Any, Any, Similarity], None]] = {
    "perspective": _perspective,
    "thinlens": _thin_lens,
    "orthographic": _orthographic,
    "radiancemeter": _radiance_meter,
    "distant": _distant,
    "irradiancemeter": _nothing,
    "batch": _nothing,
    "point": _point,
    "spot": _spot,
    "projector": _projector,
    "bumpmap": _bump_map,
    "gridvolume": _grid,
    "constvolume": _grid,  # in a heterogeneous medium it fills its own unit cube, and nothing else
    "homogeneous": _medium,
    "heterogeneous": _medium,
}
