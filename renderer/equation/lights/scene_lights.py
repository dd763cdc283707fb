"""The lights of a scene in groups, each sampled in one way."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderer.backend import mitsuba
from renderer.equation.lights.collimated_lights import CollimatedLights, is_collimated
from renderer.equation.lights.environment_map import ENVIRONMENT_MAP, EnvironmentMap, is_lit
from renderer.equation.lights.group import LightGroup
from renderer.equation.lights.plugin_lights import PluginLights
from renderer.equation.lights.powers import choice_probabilities, side_by_side
from renderer.equation.lights.surface_lights import SurfaceLights
from renderer.equation.lights.uniform_lights import UniformLights, UniformShape
from renderer.equation.tables import registry_id
from renderer.scene.plugins import by_class

mi: Any = mitsuba()

# Shapes whose surface Mitsuba cannot sample: light on them is found by direction sampling alone.
_UNSAMPLEABLE = frozenset(name for name, row in by_class().items() if row.kind == "Shape" and "area" not in row.traits)


@dataclass(frozen=True)
class SceneLights:
    """What is chosen among: the patches of `sky`, an environment map, and then `emitters`, neighbours side by side.

    weights: (n,) probabilities by power of the map (the first one, where there is one) and of the emitters. groups: of
    the emitters; group, row: for each of them the number of its group and its row there. is_complete: whether there is
    no light in the scene besides these.
    """

    sky: EnvironmentMap | None
    sky_plugin: Any
    emitters: tuple[Any, ...]
    weights: NDArray[np.float64]
    groups: tuple[LightGroup, ...]
    group: NDArray[np.uint32]
    row: NDArray[np.uint32]
    is_complete: bool

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing to sample."""
        return self.sky is None and not self.emitters

    def of_entries(self, sky: EnvironmentMap | None) -> NDArray[np.float64]:
        """Probabilities of the patches of `sky`, in the map's place, and of the emitters."""
        if sky is None:
            return self.weights
        return np.concatenate([self.weights[0] * sky.shares, self.weights[1:]])


def lights_of(scene: Any, is_helped: bool = False) -> SceneLights:
    """The lights of a Mitsuba scene that emitter sampling can find.

    is_helped: whether direction sampling finds the same lights, weighted: the sampler need not find all of them.
    """
    emitters = [e for e in scene.emitters() if is_sampleable(e)]
    # An emitter tells its shape without telling that it is a mesh.
    shapes = {registry_id(shape.emitter()): shape for shape in scene.shapes() if shape.emitter() is not None}
    surfaces = SurfaceLights.among(emitters, shapes)
    powers = {} if surfaces is None else surfaces.powers
    weights = choice_probabilities(emitters, powers)
    emitters = [e for e, w in zip(emitters, weights, strict=True) if w > 0]
    weights = weights[weights > 0]
    is_complete = len(emitters) == len(list(scene.emitters()))
    near = side_by_side(emitters)
    emitters, weights = [emitters[i] for i in near], weights[near]
    sky, plugin = EnvironmentMap.of(scene, emitters, is_helped), None
    if sky is not None:
        first = [e.class_name() == ENVIRONMENT_MAP for e in emitters].index(True)
        plugin = emitters.pop(first)
        weights = np.concatenate([weights[first : first + 1], np.delete(weights, first)])
    groups, group, row = _grouped(emitters, shapes, surfaces)
    return SceneLights(sky, plugin, tuple(emitters), weights, groups, group, row, is_complete)


def _grouped(
    emitters: list[Any], shapes: dict[int, Any], surfaces: SurfaceLights | None
) -> tuple[tuple[LightGroup, ...], NDArray[np.uint32], NDArray[np.uint32]]:
    """The groups of emitters, and for each emitter the number of its group and its row there."""
    rows_of_surfaces = {} if surfaces is None else {registry: row for row, registry in enumerate(surfaces.powers)}
    uniform: list[UniformShape] = []
    collimated: list[Any] = []
    others: list[Any] = []
    found = []
    for emitter in emitters:
        registry = registry_id(emitter)
        if registry in rows_of_surfaces:
            found.append((surfaces, rows_of_surfaces[registry]))
        elif (shape := UniformShape.of(emitter, shapes.get(registry))) is not None:
            found.append((uniform, len(uniform)))
            uniform.append(shape)
        else:
            mine = collimated if is_collimated(emitter) else others
            found.append((mine, len(mine)))
            mine.append(emitter)
    made: list[tuple[Any, LightGroup]] = []
    if others:
        made.append((others, PluginLights(others)))
    if surfaces is not None and any(members is surfaces for members, _ in found):
        made.append((surfaces, surfaces))
    if uniform:
        made.append((uniform, UniformLights(uniform)))
    if collimated:
        made.append((collimated, CollimatedLights(collimated)))
    number = {id(members): n for n, (members, _) in enumerate(made)}
    group = np.array([number[id(members)] for members, _ in found], np.uint32)
    return tuple(one for _, one in made), group, np.array([row for _, row in found], np.uint32)


def is_sampleable(emitter: Any) -> bool:
    """Whether emitter sampling can find an emitter: not on shapes whose surface Mitsuba cannot sample, nor on a black
    map."""
    shape = emitter.get_shape()
    if emitter.class_name() == ENVIRONMENT_MAP:
        return is_lit(emitter)
    if emitter.class_name() == "DirectionalArea":
        return is_collimated(emitter)
    return shape is None or shape.class_name() not in _UNSAMPLEABLE
