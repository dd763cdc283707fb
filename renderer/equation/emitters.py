"""Emitter sampling: which light, and which point on it (the area form).

Enters: the scene's emitters. Leaves: a direction sample with its solid-angle pdf and the weight radiance/pdf, and the
same pdf for a light that was hit by chance. Lights are chosen by their power, mixed with a uniform choice so that a dim
light close by is never starved; lights at infinity each get a fixed share. What they give is surveyed first, and where
that pays the choice depends on the place. An environment map is many lights: patches of sky. It is sampled by
`environment_map.py`, lights of even radiance on plates and balls by `even_lights.py`, those with textures or smooth
normals by `surface_lights.py`, all others by their plugins.
Source: pbrt-v4, section 12.6.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from renderer.backend import mitsuba
from renderer.equation.collimated import CollimatedLights, is_collimated
from renderer.equation.environment_map import ENVIRONMENT_MAP, EnvironmentMap, Spot, is_lit
from renderer.equation.even_lights import EvenLights
from renderer.equation.light_choice import LightChoice
from renderer.equation.light_survey import Seen, survey
from renderer.equation.mueller import intensity
from renderer.equation.surface_lights import SurfaceLights
from renderer.equation.tables import registry_id, table
from renderer.scene.plugins import by_class

mi: Any = mitsuba()

UNIFORM_SHARE = 0.2  # of the choice among finite lights
# Among few lights power says little (a spot shines elsewhere, a dim lamp is near): a light chosen too seldom costs
# fireflies, and halving the chance of the others costs next to nothing.
FEW_LIGHTS, UNIFORM_SHARE_OF_FEW = 8, 0.5
POWER_SAMPLES, MOST_POWER_SAMPLES = 1024, 2**20  # rays of one emitter, and of all
# By which the place lowers the second moment of a light's sample, from which it is asked: that takes a tenth of the
# time. A spot among few lights shines on a small part of the scene, where a choice without the place misses it.
LEAST_GAIN = 1.2
# Share of a sky's samples that find it, from which no place is asked: that takes a tenth of the time, and a whole map
# is stratified better than its patches.
MOSTLY_VISIBLE = 0.7
NO_POWERS: Mapping[int, float] = MappingProxyType({})
# Shapes whose surface Mitsuba cannot sample: light on them is found by direction sampling alone.
_UNSAMPLEABLE = frozenset(name for name, row in by_class().items() if row.kind == "Shape" and "area" not in row.traits)


class EmitterSampler:
    """Samples the emitters of one scene. `is_empty` where there is nothing to sample.

    What is chosen among are the patches of an environment map, if there is one, and then all other emitters.
    sensor: where paths begin, for a survey of what many lights give; without it they are chosen by their power.
    is_helped: whether direction sampling finds the same lights, weighted: the sampler need not find all of them.
    """

    def __init__(self, scene: Any, sensor: Any = None, is_helped: bool = False) -> None:
        emitters = [e for e in scene.emitters() if is_sampleable(e)]
        self.is_empty = not emitters
        if self.is_empty:
            return
        self.surfaces = SurfaceLights(scene, emitters)
        weights = choice_probabilities(emitters, self.surfaces.powers)
        emitters = [e for e, w in zip(emitters, weights, strict=True) if w > 0]
        weights = weights[weights > 0]
        self.is_empty = not emitters
        if self.is_empty:
            return
        self.samples_all = len(emitters) == len(list(scene.emitters()))
        self.only = emitters[0] if len(emitters) == 1 else None
        near = _side_by_side(emitters)
        emitters, weights = [emitters[i] for i in near], weights[near]
        self.map = EnvironmentMap.of(scene, emitters, is_helped)
        first = None if self.map is None else [e.class_name() == ENVIRONMENT_MAP for e in emitters].index(True)
        if first is not None:
            sky = emitters.pop(first)
            self.sky: Any = dr.reinterpret_array(mi.EmitterPtr, table([registry_id(sky)], mi.UInt32))
        self.n_emitters = len(emitters)
        if emitters:
            # Tables by registry id: what is known of an emitter once a ray has hit it.
            ids = np.array([registry_id(e) for e in emitters], np.uint32)
            self.pointers: Any = dr.reinterpret_array(mi.EmitterPtr, table(ids, mi.UInt32))
            by_id = np.full(int(ids.max()) + 1, len(emitters), np.uint32)
            by_id[ids] = np.arange(len(emitters))
            self.index_by_id = mi.UInt32(by_id)
            self.even = EvenLights(scene, emitters)
            self.surfaces.number(emitters)
            self.collimated = CollimatedLights(emitters, ids)
            self.no_plugins = len(self.surfaces.powers) + self.even.n_known == len(emitters)
        self._set_choice(weights, first)
        if sensor is not None and self.choice is not None:
            seen = survey(scene, sensor, self._sample_entry, self.choice.n_entries)
            if seen is not None and self._is_worth_learning(seen):
                self.choice.learn(seen)
        if self.map is not None and not self.knows_places:
            self.map = self.map.undivided()
            self._set_choice(weights, first)

    def _set_choice(self, weights: NDArray[np.float64], first: int | None) -> None:
        """Among patches of the environment map, whose weight is number `first`, and all other emitters."""
        if self.map is not None and first is not None:
            weights = np.concatenate([weights[first] * self.map.shares, np.delete(weights, first)])
        self.n_patches = 0 if self.map is None else self.map.n_patches
        self.choice = LightChoice(weights) if len(weights) > 1 else None

    def _is_worth_learning(self, seen: Seen) -> bool:
        """Whether the choice among lights should depend on the place."""
        assert self.choice is not None
        if self.n_emitters > FEW_LIGHTS:
            return True
        if self.map is not None:
            return self.choice.visible_share(seen) < MOSTLY_VISIBLE
        return self.choice.gain(seen) > LEAST_GAIN

    @property
    def knows_places(self) -> bool:
        """Whether the choice among lights depends on the place."""
        return not self.is_empty and self.choice is not None and self.choice.depth > 0

    def place(self, p: Any, n: Any, active: Any) -> Any:
        """Where p is, as far as the choice among lights depends on it. n: normal on the side that light comes from."""
        return self.choice.place(p, n, active) if self.choice is not None else mi.UInt32(0)

    def sample(self, ref: Any, u: Any, active: Any, place: Any = 0) -> tuple[Any, Any]:
        """A point on a light as seen from `ref`, visibility not tested. Returns (DirectionSample3f, radiance / pdf)."""
        u = mi.Point2f(u)
        if self.choice is None:
            return self._sample_one(ref, mi.UInt32(0), u, active)
        index, u, pmf = self.choice.sample(mi.UInt32(place), u, active)
        ds, weight = self._sample_one(ref, index, u, active)
        ds.pdf *= pmf
        return ds, weight / pmf

    def _sample_entry(self, ref: Any, entry: Any, u: Any, active: Any) -> tuple[Any, Any]:
        """A point on a light of one entry of the choice."""
        assert self.choice is not None
        index, u, share = self.choice.sample_within(entry, u, active)
        ds, weight = self._sample_one(ref, index, u, active)
        return ds, weight / share

    def _sample_one(self, ref: Any, index: Any, u: Any, active: Any) -> tuple[Any, Any]:
        if self.map is None:
            return self._sample_other(ref, index, u, active)
        if self.n_emitters == 0:
            return self.map.sample(ref, index, self.sky, u, active)
        is_patch = index < self.n_patches
        other = dr.select(is_patch, 0, index - self.n_patches)
        ds, weight = self._sample_other(ref, other, u, active & ~is_patch)
        ds_sky, weight_sky = self.map.sample(ref, dr.select(is_patch, index, 0), self.sky, u, active & is_patch)
        _take(ds, ds_sky, is_patch)
        ds.emitter = dr.select(is_patch, self.sky, ds.emitter)
        ds.delta = ~is_patch & ds.delta
        return ds, dr.select(is_patch, weight_sky, weight)

    def _sample_other(self, ref: Any, index: Any, u: Any, active: Any) -> tuple[Any, Any]:
        """Of the emitters that are no environment map."""
        if self.only is not None:
            emitter = mi.EmitterPtr(self.only)
        else:
            emitter = dr.gather(mi.EmitterPtr, self.pointers, index, active)
        if self.even.knows_all:
            return self.even.sample(ref, index, emitter, u, active)
        is_even = self.even.is_known(index, active)
        if self.surfaces.is_empty:
            ds, weight = self._asked(emitter).sample_direction(ref, u, active & ~is_even)
            weight = intensity(weight)
        else:
            ds, weight = self._sample_surface(ref, index, emitter, u, active & ~is_even)
        if not self.even.is_empty:
            ds_even, weight_even = self.even.sample(ref, index, emitter, u, is_even)
            _take(ds, ds_even, is_even)
            ds.emitter, ds.delta = emitter, ~is_even & ds.delta
            weight = dr.select(is_even, weight_even, weight)
        if not self.collimated.is_empty:
            ds, weight = self.collimated.sample(ref, emitter, ds, weight, active)
        return ds, weight

    def _sample_surface(self, ref: Any, index: Any, emitter: Any, u: Any, active: Any) -> tuple[Any, Any]:
        """Of the emitters that are not even, where some are sampled by cells of their surface."""
        is_surface = self.surfaces.is_known(index, active)
        asked = self._asked(emitter)
        ds_surface, weight_surface = self.surfaces.sample(ref, index, emitter, asked, u, is_surface)
        if self.no_plugins:
            return ds_surface, weight_surface
        ds, weight = asked.sample_direction(ref, u, active & ~is_surface)
        weight = intensity(weight)
        _take(ds, ds_surface, is_surface)
        ds.emitter, ds.delta = emitter, ~is_surface & ds.delta
        return ds, dr.select(is_surface, weight_surface, weight)

    def spot(self, direction: Any, emitter: Any, active: Any) -> Spot | None:
        """What a ray that left the scene sees of its environment map, for `emission` and `pdf`; None without one."""
        return None if self.is_empty or self.map is None else self.map.spot(direction, active & self._is_sky(emitter))

    def pdf(self, ref: Any, ds: Any, si: Any, active: Any, place: Any = 0, spot: Spot | None = None) -> Any:
        """Solid-angle density with which `sample` finds the hit `si`, which is `ds` as seen from ref."""
        index, is_known = self._index(ds.emitter, active)
        is_sky = mi.Bool(False)
        spot = self.spot(ds.d, ds.emitter, active) if spot is None else spot
        if spot is not None:
            is_sky = active & self._is_sky(ds.emitter)
            index = dr.select(is_sky, spot.patch, index + self.n_patches)
        is_listed = is_known | is_sky
        pmf = mi.Float(1) if self.choice is None else self.choice.pmf(mi.UInt32(place), index, is_listed)
        pdf = mi.Float(0) if self.n_emitters == 0 else self._pdf_of_other(ref, ds, si, index - self.n_patches, is_known)
        if spot is not None:
            pdf = dr.select(is_sky, spot.density, pdf)
        return dr.select(is_listed, pdf * pmf, 0)

    def _pdf_of_other(self, ref: Any, ds: Any, si: Any, index: Any, active: Any) -> Any:
        if self.even.knows_all:
            return self.even.pdf(ref, ds, index, active)
        is_even = self.even.is_known(index, active)
        is_surface = self.surfaces.is_known(index, active)
        pdf = mi.Float(0)
        if not self.no_plugins:
            pdf = self._asked(ds.emitter).pdf_direction(ref, ds, active & ~is_even & ~is_surface)
        if not self.surfaces.is_empty:
            pdf = dr.select(is_surface, self.surfaces.pdf(si, ds, index, is_surface), pdf)
        if not self.even.is_empty:
            pdf = dr.select(is_even, self.even.pdf(ref, ds, index, is_even), pdf)
        return pdf

    def emission(self, si: Any, emitter: Any, active: Any, spot: Spot | None = None) -> Any:
        """Radiance of a light that a ray hit, back along the ray."""
        spot = self.spot(-si.wi, emitter, active) if spot is None else spot
        if spot is None:
            return self._emission_of_other(si, emitter, active)
        is_sky = active & self._is_sky(emitter)
        radiance = dr.select(is_sky, spot.radiance, 0)
        if self.n_emitters == 0 and self.samples_all:
            return radiance
        return dr.select(is_sky, radiance, self._emission_of_other(si, emitter, active & ~is_sky))

    def _emission_of_other(self, si: Any, emitter: Any, active: Any) -> Any:
        if self.is_empty or self.n_emitters == 0:
            return intensity(emitter.eval(si, active))
        asked = self._asked(emitter) if self.samples_all else emitter
        if self.even.is_empty or mi.is_spectral:
            asked = asked if self.even.is_empty else emitter
            return dr.select(active, intensity(asked.eval(si, active)), 0)
        index, is_known = self._index(emitter, active)
        is_even = self.even.is_known(index, is_known)
        radiance = dr.select(is_even, self.even.radiance(si, index, is_even), 0)
        if not (self.even.knows_all and self.samples_all):
            radiance = dr.select(is_even, radiance, intensity(asked.eval(si, active & ~is_even)))
        return radiance

    def _asked(self, emitter: Any) -> Any:
        """What to ask about emitters that are not even: the only one of them becomes part of the code, without a call
        that could be any emitter's."""
        return emitter if self.even.other is None else self.even.other

    def _is_sky(self, emitter: Any) -> Any:
        """Whether an emitter that a ray has met is the environment map."""
        return mi.Bool(True) if self.n_emitters == 0 and self.samples_all else emitter == self.sky

    def _index(self, emitter: Any, active: Any) -> tuple[Any, Any]:
        """The index of an emitter, and whether it is one of those that are sampled; environment maps have none."""
        if self.n_emitters == 0:
            return mi.UInt32(0), mi.Bool(False)
        if self.only is not None:
            return mi.UInt32(0), active if self.samples_all else active & (emitter == mi.EmitterPtr(self.only))
        index = dr.gather(mi.UInt32, self.index_by_id, self._id(emitter), active)
        return index, active & (index < self.n_emitters)

    def _id(self, emitter: Any) -> Any:
        # An id beyond the table is an emitter that is not sampled; entry 0 is no emitter's and tells so.
        found: Any = dr.reinterpret_array(mi.UInt32, emitter)
        known: Any = found < dr.width(self.index_by_id)
        return dr.select(known, found, 0)


def _take(ds: Any, other: Any, where: Any) -> None:
    """Fills in a direction sample from another one."""
    for name in ("p", "n", "d", "dist", "pdf"):
        setattr(ds, name, dr.select(where, getattr(other, name), getattr(ds, name)))


def choice_probabilities(emitters: list[Any], powers: Mapping[int, float] = NO_POWERS) -> NDArray[np.float64]:
    """Probability of choosing each emitter; zero only where it emits nothing. powers: those known, by registry id.
    Sums are exact: Mitsuba loads shapes side by side, and lists them in the order in which they were ready.
    """
    infinite = np.array([bool(mi.has_flag(e.flags(), mi.EmitterFlags.Infinite)) for e in emitters])
    probability = np.zeros(len(emitters))
    shares = int(infinite.sum()) + int((~infinite).any())
    probability[infinite] = 1 / shares
    if (~infinite).any():
        near = [e for e, is_infinite in zip(emitters, infinite, strict=True) if not is_infinite]
        others = [e for e in near if registry_id(e) not in powers] if powers else near
        found = dict(zip(map(registry_id, others), _powers(others), strict=True)) if others else {}
        known_powers = {**found, **powers}
        finite = np.array([known_powers[registry_id(e)] for e in near])
        told = finite[~np.isnan(finite)]
        known = np.where(np.isnan(finite), math.fsum(told) / len(told) if np.isfinite(finite).any() else 1.0, finite)
        lit = known > 0
        if lit.any():
            share = UNIFORM_SHARE_OF_FEW if lit.sum() <= FEW_LIGHTS else UNIFORM_SHARE
            mixed = share * lit / lit.sum() + (1 - share) * known / math.fsum(known)
            probability[~infinite] = mixed / shares
    total = math.fsum(probability)
    return probability / total if total > 0 else probability


def _side_by_side(emitters: list[Any]) -> NDArray[np.int64]:
    """An order in which neighbours in space stand beside each other, lights at infinity first (Morton 1966). It is the
    same whatever order they come in, as long as their centres differ.
    """
    centres = np.array([_centre(e) for e in emitters])
    known = np.isfinite(centres).all(axis=1)
    codes = np.zeros(len(emitters), np.int64)
    if known.any():
        low, high = centres[known].min(axis=0), centres[known].max(axis=0)
        cells = (1023 * (centres[known] - low) / max(float(np.max(high - low)), 1e-30)).astype(np.int64)
        codes[known] = 1
        for bit in reversed(range(10)):
            for axis in range(3):
                codes[known] = codes[known] << 1 | cells[:, axis] >> bit & 1
    return np.lexsort((*np.nan_to_num(centres).T, codes))


def _centre(emitter: Any) -> list[float]:
    """Of the emitter's bounds; NaN at infinity."""
    if mi.has_flag(emitter.flags(), mi.EmitterFlags.Infinite):
        return [float("nan")] * 3
    bounds = emitter.get_shape().bbox() if emitter.get_shape() is not None else emitter.bbox()
    return [float(x) for x in bounds.center()]


def _powers(emitters: list[Any]) -> NDArray[np.float64]:
    """Emitted powers, from rays that the emitters draw themselves; NaN where one cannot draw any."""
    n = min(POWER_SAMPLES, max(MOST_POWER_SAMPLES // len(emitters), 16))
    try:
        values = _rays(emitters, n)
    except RuntimeError:
        if len(emitters) == 1:
            return np.array([np.nan])
        return np.concatenate([_powers([e]) for e in emitters])
    known = np.isfinite(values)
    mean = np.where(known, values, 0).sum(axis=(0, 2)) / np.maximum(known.sum(axis=(0, 2)), 1)
    return np.where(known.any(axis=(0, 2)), np.maximum(mean, 0), np.nan)


def _rays(emitters: list[Any], n: int) -> NDArray[np.float64]:
    """(channels, emitters, n) weights of n rays from each emitter."""
    i = np.tile(np.arange(n), len(emitters))
    u = [table((i * step + 0.5) % 1, mi.Float) for step in (0.8191725, 0.6710436, 0.5497004, 0.4503, 0.3689)]
    pointer: Any = emitters[0]  # one alone is traced itself, without a call that could be any emitter's
    if len(emitters) > 1:
        ids = np.repeat(np.array([registry_id(e) for e in emitters], np.uint32), n)
        pointer = dr.reinterpret_array(mi.EmitterPtr, table(ids, mi.UInt32))
    _, weight = pointer.sample_ray(mi.Float(0), u[0], mi.Point2f(u[1], u[2]), mi.Point2f(u[3], u[4]))
    found = np.array(intensity(weight), np.float64)
    found = found.reshape(len(found) if found.ndim > 1 else 1, -1)
    return np.broadcast_to(found, (len(found), len(i))).reshape(-1, len(emitters), n)


def is_sampleable(emitter: Any) -> bool:
    """Whether emitter sampling can find an emitter: not on shapes whose surface Mitsuba cannot sample, nor on a black
    map."""
    shape = emitter.get_shape()
    if emitter.class_name() == ENVIRONMENT_MAP:
        return is_lit(emitter)
    if emitter.class_name() == "DirectionalArea":
        return is_collimated(emitter)
    return shape is None or shape.class_name() not in _UNSAMPLEABLE
