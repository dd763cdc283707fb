"""How bright the lights of a scene are, by which they are chosen, and an order in which neighbours stand together."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from renderer.backend import mitsuba
from renderer.equation.mueller import intensity
from renderer.equation.tables import registry_id, table

mi: Any = mitsuba()

UNIFORM_SHARE = 0.2  # of the choice among finite lights
# Among few lights power says little (a spot shines elsewhere, a dim lamp is near): a light chosen too seldom costs
# fireflies, and halving the chance of the others costs next to nothing.
FEW_LIGHTS, UNIFORM_SHARE_OF_FEW = 8, 0.5
POWER_SAMPLES, MOST_POWER_SAMPLES = 1024, 2**20  # rays of one emitter, and of all
NO_POWERS: Mapping[int, float] = MappingProxyType({})


def choice_probabilities(emitters: list[Any], powers: Mapping[int, float] = NO_POWERS) -> NDArray[np.float64]:
    """Probability of choosing each emitter; zero only where it emits nothing. powers: those known, by registry id.
    Sums are exact: Mitsuba loads shapes side by side, and lists them in the order in which they were ready.
    """
    if not emitters:
        return np.zeros(0)
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


def side_by_side(emitters: list[Any]) -> NDArray[np.int64]:
    """An order in which neighbours in space stand beside each other, lights at infinity first (Morton 1966). It is the
    same whatever order they come in: those that have one centre follow each other by what they are.
    """
    centres = np.array([_centre(e) for e in emitters]).reshape(-1, 3)
    known = np.isfinite(centres).all(axis=1)
    codes = np.zeros(len(emitters), np.int64)
    if known.any():
        low, high = centres[known].min(axis=0), centres[known].max(axis=0)
        cells = (1023 * (centres[known] - low) / max(float(np.max(high - low)), 1e-30)).astype(np.int64)
        codes[known] = 1
        for bit in reversed(range(10)):
            for axis in range(3):
                codes[known] = codes[known] << 1 | cells[:, axis] >> bit & 1
    places = np.column_stack([codes, np.nan_to_num(centres)])
    _, place, n_there = np.unique(places, axis=0, return_inverse=True, return_counts=True)
    contents = [content(e) if n_there[at] > 1 else b"" for e, at in zip(emitters, place.ravel(), strict=True)]
    by_content = np.unique(np.array(contents, object), return_inverse=True)[1]
    return np.lexsort((by_content, *np.nan_to_num(centres).T, codes))


def content(plugin: Any) -> bytes:
    """What a light, or its shape, is made of, as one string to sort by: where it stands in the scene does not count."""
    holder = plugin.get_shape() if isinstance(plugin, mi.Emitter) else None
    made = [str(plugin.class_name()).encode()]  # no names: some are given by the order of loading
    for known in (mi.traverse(plugin), *(() if holder is None else (mi.traverse(holder),))):
        for key in sorted(known.properties):
            values = np.array(getattr(known[key], "matrix", known[key]))
            made += [str(key).encode(), str(values.shape).encode(), values.astype("<f8").tobytes()]
    return b"\0".join(made)


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
