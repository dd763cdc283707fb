"""Emitter sampling: which light, and which point on it (the area form).

Enters: the lights of a scene and, where the choice among them is to depend on the place, a survey of what they give.
Leaves: a direction sample with its solid-angle pdf and the weight radiance/pdf, and the same pdf for a light that was
hit by chance. Lights are chosen by their power, mixed with a uniform choice so that a dim light close by is never
starved; lights at infinity each get a fixed share. An environment map is many lights: patches of sky.
Source: pbrt-v4, section 12.6.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np

from renderer.backend import mitsuba
from renderer.equation.lights.choice import LightChoice
from renderer.equation.lights.group import Hit, LightGroup, take
from renderer.equation.lights.powers import FEW_LIGHTS
from renderer.equation.lights.scene_lights import SceneLights
from renderer.equation.lights.survey import Seen, survey
from renderer.equation.mueller import intensity
from renderer.equation.tables import registry_id, table

mi: Any = mitsuba()

# By which the place lowers the second moment of a light's sample, from which it is asked: that takes a tenth of the
# time. A spot among few lights shines on a small part of the scene, where a choice without the place misses it.
LEAST_GAIN = 1.2
# Share of a sky's samples that find it, from which no place is asked: that takes a tenth of the time, and a whole map
# is stratified better than its patches.
MOSTLY_VISIBLE = 0.7


class EmitterSampler:
    """Samples the emitters of one scene. `is_empty` where there is nothing to sample.

    seen: where lights give what; without it they are chosen by their power, and a sky is one light, unless
    `divides_sky`.
    """

    def __init__(self, lights: SceneLights, seen: Seen | None = None, *, divides_sky: bool = False) -> None:
        knows_places = seen is not None and seen.depth > 0
        sky = lights.sky if knows_places or divides_sky or lights.sky is None else lights.sky.undivided()
        self.is_empty = lights.is_empty
        self.sky = sky
        self.n_patches = 0 if sky is None else sky.n_patches
        self._groups: tuple[LightGroup, ...] = lights.groups if sky is None else (*lights.groups, sky)
        self._is_complete = lights.is_complete
        weights = lights.of_entries(sky)
        self.n_entries = len(weights)
        self.choice = LightChoice(weights) if self.n_entries > 1 else None
        if self.choice is not None and seen is not None and (sky is None or knows_places):
            self.choice = self.choice.informed(seen)
        if not self.is_empty:
            self._set_tables(lights)

    def _set_tables(self, lights: SceneLights) -> None:
        """What is known of an entry of the choice, and of an emitter that a ray has hit, by its registry id."""
        group = np.concatenate([np.full(self.n_patches, len(lights.groups), np.uint32), lights.group])
        row = np.concatenate([np.arange(self.n_patches, dtype=np.uint32), lights.row])
        is_plain = len(self._groups) == 1 and bool((row == np.arange(self.n_entries)).all())
        self._rows = None if is_plain else table(np.stack([group, row], axis=1).ravel(), mi.UInt32)
        ids = np.array([registry_id(e) for e in lights.emitters], np.uint32)
        of_sky = np.array([] if self.sky is None else [registry_id(lights.sky_plugin)], np.uint32)
        pointers = table(np.concatenate([np.repeat(of_sky, self.n_patches), ids]), mi.UInt32)
        self._pointers: Any = dr.reinterpret_array(mi.EmitterPtr, pointers)
        self._sky_pointer: Any = None
        if self.sky is not None:
            self._sky_pointer = dr.reinterpret_array(mi.EmitterPtr, table(of_sky, mi.UInt32))
        self._only = lights.emitters[0] if len(ids) == 1 and self.sky is None else None
        self._has_emitters = len(ids) > 0
        by_id = np.full(int(ids.max(initial=0)) + 1, self.n_entries, np.uint32)
        by_id[ids] = self.n_patches + np.arange(len(ids))
        self._index_by_id = mi.UInt32(by_id)
        # Whose radiance only plugins know: one alone becomes part of the code.
        told = {n for n, one in enumerate(self._groups) if one.tells_radiance}
        others = [e for e, n in zip(lights.emitters, lights.group, strict=True) if int(n) not in told]
        self._tells_all = self._is_complete and not others
        self._other = others[0] if self._is_complete and len(others) == 1 else None

    @property
    def knows_places(self) -> bool:
        """Whether the choice among lights depends on the place."""
        return self.choice is not None and self.choice.depth > 0

    def place(self, p: Any, n: Any, active: Any) -> Any:
        """Where p is, as far as the choice among lights depends on it. n: normal on the side that light comes from."""
        return self.choice.place(p, n, active) if self.choice is not None else mi.UInt32(0)

    def entries_of(self, emitter: Any) -> range:
        """The numbers of an emitter in the choice among all: of a map, its patches; none if it is not sampled."""
        registry = registry_id(emitter)
        found = np.flatnonzero(np.array(dr.reinterpret_array(mi.UInt32, self._pointers)) == registry)
        return range(int(found[0]), int(found[-1]) + 1) if len(found) else range(0)

    # ------------------------------ Samples ------------------------------

    def sample(self, ref: Any, u: Any, active: Any, place: Any = 0) -> tuple[Any, Any]:
        """A point on a light as seen from `ref`, visibility not tested. Returns (DirectionSample3f, radiance / pdf)."""
        u = mi.Point2f(u)
        if self.choice is None:
            return self.sample_light(ref, mi.UInt32(0), u, active)
        index, u, pmf = self.choice.sample(mi.UInt32(place), u, active)
        ds, weight = self.sample_light(ref, index, u, active)
        ds.pdf *= pmf
        return ds, weight / pmf

    def sample_within(self, ref: Any, entry: Any, u: Any, active: Any) -> tuple[Any, Any]:
        """The same of lights that share an entry of the survey's table."""
        assert self.choice is not None
        index, u, share = self.choice.sample_within(entry, u, active)
        ds, weight = self.sample_light(ref, index, u, active)
        return ds, weight / share

    def sample_light(self, ref: Any, index: Any, u: Any, active: Any) -> tuple[Any, Any]:
        """The same of one light, whose number in the choice among all is known."""
        emitter = self._emitter(index, active)
        group, row = self._place_in_groups(index, active)
        mine = _in_group(group, 0, active)
        ds, weight = self._groups[0].sample(ref, row, emitter, u, mine)
        for number, one in enumerate(self._groups[1:], 1):
            mine = _in_group(group, number, active)
            ds_mine, weight_mine = one.sample(ref, row, emitter, u, mine)
            take(ds, ds_mine, mine)
            weight = dr.select(mine, weight_mine, weight)
        ds.emitter = emitter
        return ds, weight

    # ------------------------------ Hits ------------------------------

    def hit(self, direction: Any, emitter: Any, active: Any) -> Hit:
        """What is known of the light that a ray along `direction` has met, for `emission` and `pdf`."""
        if self.is_empty:
            return Hit(emitter, mi.UInt32(0), mi.Bool(False), None, mi.UInt32(0), None)
        index, is_listed = self._index(emitter, active)
        spot = None
        if self.sky is not None:
            is_sky = active & self._is_sky(emitter)
            spot = self.sky.spot(direction, is_sky)
            index, is_listed = dr.select(is_sky, spot.patch, index), is_sky | is_listed
        return Hit(emitter, index, is_listed, *self._place_in_groups(index, is_listed), spot)

    def pdf(self, ref: Any, ds: Any, si: Any, active: Any, place: Any = 0, hit: Hit | None = None) -> Any:
        """Solid-angle density with which `sample` at ref finds the hit `si`, which is `ds` as seen from there."""
        hit = self.hit(ds.d, ds.emitter, active) if hit is None else hit
        listed = active & hit.is_listed
        pmf = mi.Float(1) if self.choice is None else self.choice.pmf(mi.UInt32(place), hit.index, listed)
        pdf = mi.Float(0)
        for number, one in enumerate(self._groups):
            mine = _in_group(hit.group, number, listed)
            pdf = dr.select(mine, one.pdf(ref, ds, si, hit, mine), pdf)
        return dr.select(listed, pdf * pmf, 0)

    def emission(self, si: Any, hit: Hit, active: Any) -> Any:
        """Radiance of a light that a ray hit, back along the ray."""
        if self.is_empty:
            return intensity(hit.emitter.eval(si, active))
        radiance, left = mi.UnpolarizedSpectrum(0), active
        for number, one in enumerate(self._groups):
            if one.tells_radiance:
                mine = _in_group(hit.group, number, active & hit.is_listed)
                radiance = dr.select(mine, one.emission(si, hit, mine), radiance)
                left = left & ~mine
        if self._tells_all:
            return radiance
        asked = hit.emitter if self._other is None else self._other
        return dr.select(left, intensity(asked.eval(si, left)), radiance)

    # ------------------------------ Which light ------------------------------

    def _emitter(self, index: Any, active: Any) -> Any:
        if self._only is not None:
            return mi.EmitterPtr(self._only)
        return dr.gather(mi.EmitterPtr, self._pointers, index, active) if self._has_emitters else self._sky_pointer

    def _is_sky(self, emitter: Any) -> Any:
        """Whether an emitter that a ray has met is the environment map."""
        return emitter == self._sky_pointer if self._has_emitters or not self._is_complete else mi.Bool(True)

    def _index(self, emitter: Any, active: Any) -> tuple[Any, Any]:
        """The number of an emitter in the choice among all, and whether it has one; environment maps have none."""
        if not self._has_emitters:
            return mi.UInt32(0), mi.Bool(False)
        if self._only is not None:
            return mi.UInt32(0), active if self._is_complete else active & (emitter == mi.EmitterPtr(self._only))
        # An id beyond the table is an emitter that is not sampled; entry 0 is no emitter's and tells so.
        found: Any = dr.reinterpret_array(mi.UInt32, emitter)
        known: Any = found < dr.width(self._index_by_id)
        index = dr.gather(mi.UInt32, self._index_by_id, dr.select(known, found, 0), active)
        return index, active & (index < self.n_entries)

    def _place_in_groups(self, index: Any, active: Any) -> tuple[Any, Any]:
        """The number of a light's group, None where there is just one, and its row there."""
        if self._rows is None:
            return None, index
        found = dr.gather(mi.Vector2u, self._rows, index, active)
        return (found.x if len(self._groups) > 1 else None), found.y


def _in_group(group: Any, number: int, active: Any) -> Any:
    return active if group is None else active & (group == number)


def useful_survey(scene: Any, sensor: Any, lights: SceneLights, has_media: bool = False) -> Seen | None:
    """What lights give where paths from the sensor come; None where a choice by the place would gain little."""
    sampler = EmitterSampler(lights, divides_sky=True)
    choice = sampler.choice
    if choice is None:
        return None
    seen = survey(scene, sensor, sampler.sample_within, choice.n_entries, has_media)
    if seen is None or len(lights.emitters) > FEW_LIGHTS:
        return seen
    if lights.sky is not None:
        return seen if choice.visible_share(seen) < MOSTLY_VISIBLE else None
    return seen if choice.gain(seen) > LEAST_GAIN else None
