"""Participating media: where a ray is scattered on its way, and how much of it passes.

Enters: rays, and the key of the medium that each is in. Leaves: collisions with their weights, transmittances, phase
functions. Along a ray in a medium, the volume term is added to what the surface at its end sends:

    L(o, ω) = ∫₀ᵈ T(o, t) σs(t) ∫ fp(t, ω, ωi) Li(t, ωi) dωi dt  +  T(o, d) L(surface),   T(o, t) = exp −∫₀ᵗ σt

*Distances* are drawn analytically in homogeneous media, and by delta tracking in grids: *tentative* collisions come at
the rate of a majorant σ̄ ≥ σt, and are real with probability σt/σ̄. Where extinction has colour, no distance suits all
channels. One is drawn from a mixture of the channels' own densities q_i, so each channel's weight is

    throughput_i · f_i / Σ_j w_j q_j,   w_j half even, and half by what channel j still carries

(the balance heuristic of all channels for one sample): a channel grows at most 2n times, and none beyond twice what
they carry together. *Transmittance* is analytic in homogeneous media, and estimated by residual ratio tracking in
grids: exp −∫ of a control σc, times the product of 1 − (σt − σc)/ρ over tentative collisions at the rate ρ ≥ |σt − σc|.
Majorants, controls and their rates are those of the cells of a coarse lattice (`lattice.py`): where nothing is, nothing
is asked.

Sources: Woodcock et al. 1965 (delta tracking); Novák et al. 2014 (ratio tracking); Kutz et al. 2017 and Miller et al.
2019 (colour); pbrt-v4, sections 11.2 and 14.2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from renderer.backend import mitsuba
from renderer.equation.lattice import Evenly, Lattices
from renderer.equation.sequence import mix, unit
from renderer.equation.tables import table

mi: Any = mitsuba()

NO_MEDIUM = 0  # the key of empty space
STEPS = 128  # tentative collisions after which a ray waits for the next turn of the kernel's loop
FAINT = 0.1  # transmittance below which a shadow ray plays roulette
LONG_WALK = 512  # tentative collisions of a shadow ray after which it plays again, with a chance of one half
EVEN_SHARE = 0.5  # of the choice among channels: see above


class Stream:
    """Random numbers of one sample, as many as are asked for, each by its number alone.

    key_a, key_b: of the lane, index: of the sample. `drawn` is how many were taken, and part of the lane's state.
    """

    def __init__(self, key_a: Any, key_b: Any, index: Any) -> None:
        self.base = mix(key_a ^ (index * 0xC2B2AE35 + 0x1B873593)) + key_b

    def at(self, drawn: Any) -> Any:
        """The number after `drawn` others, in [0, 1)."""
        return unit(mix(self.base + drawn * 0x9E3779B9), mi.Float)


@dataclass(frozen=True, slots=True)
class Collision:
    """interaction: MediumInteraction3f. is_real: light is scattered there. is_under_way: neither a real collision nor
    the end was reached within `STEPS`; the ray goes on from `interaction.p`. weight: of the throughput. drawn: random
    numbers taken so far. steps: tentative collisions.
    """

    interaction: Any
    is_real: Any
    is_under_way: Any
    weight: Any
    drawn: Any
    steps: Any


class Media:
    """All media of one scene, by key: the number that Dr.Jit's pointers name them by.

    sensor_medium: the one that the camera is in, or None.
    """

    def __init__(self, scene: Any, sensor_medium: Any) -> None:
        found = [medium for shape in scene.shapes() for medium in (shape.interior_medium(), shape.exterior_medium())]
        media = {_key(medium): medium for medium in (*found, sensor_medium) if medium is not None}
        # Shapes of a group are not listed: where there are any, media are asked by pointer.
        is_known = not any(shape.class_name() == "Instance" for shape in scene.shapes())
        self.only = next(iter(media.values())) if len(media) == 1 and is_known else None
        self.has_homogeneous = not is_known or any(medium.is_homogeneous() for medium in media.values())
        self.has_grids = not is_known or not all(medium.is_homogeneous() for medium in media.values())
        self.lattices = Lattices(media) if is_known and self.has_grids else None
        self.sensor_key = table(NO_MEDIUM if sensor_medium is None else _key(sensor_medium), mi.UInt32)

    # ------------------------------ Asking the plugins ------------------------------

    def _asked(self, key: Any) -> Any:
        """What to ask: the only medium itself becomes part of the code, without a call that could be any medium's."""
        return dr.reinterpret_array(mi.MediumPtr, mi.UInt32(key)) if self.only is None else self.only

    def target(self, si: Any, direction: Any, key: Any, active: Any) -> Any:
        """The medium behind a surface, for a ray that leaves it in some direction; `key` where it is no border."""
        crosses = active & si.is_medium_transition()
        behind: Any = dr.reinterpret_array(mi.UInt32, si.target_medium(direction))
        return dr.select(crosses, behind, key)

    def samples_emitters(self, key: Any, active: Any) -> Any:
        """Whether points on lights are to be sampled in a medium."""
        return active & self._asked(key).use_emitter_sampling()

    def eval_phase(self, key: Any, interaction: Any, wo: Any, active: Any) -> tuple[Any, Any]:
        """Phase function of a direction wo (world space), and the density with which it is drawn."""
        phase = self._asked(key).phase_function()
        return phase.eval_pdf(mi.PhaseFunctionContext(None), interaction, wo, active)

    def sample_phase(self, key: Any, interaction: Any, u_lobe: Any, u: Any, active: Any) -> tuple[Any, Any, Any]:
        """A direction drawn from the phase function: wo (world space), weight and pdf."""
        phase = self._asked(key).phase_function()
        return phase.sample(mi.PhaseFunctionContext(None), interaction, u_lobe, u, active)

    def is_homogeneous(self, key: Any) -> Any:
        """Whether a medium is the same everywhere."""
        if not (self.has_homogeneous and self.has_grids):
            return mi.Bool(self.has_homogeneous)
        return self._asked(key).is_homogeneous()

    def _interaction(self, ray: Any) -> Any:
        made = dr.zeros(mi.MediumInteraction3f)
        made.wi = -ray.d
        made.sh_frame = mi.Frame3f(made.wi)
        made.time, made.wavelengths = ray.time, ray.wavelengths
        made.p, made.t = ray.o, mi.Float(0)
        return made

    # ------------------------------ Distances ------------------------------

    def free_path(self, ray: Any, key: Any, throughput: Any, u: Any, active: Any) -> Any:
        """In homogeneous media: the distance to the next collision, drawn with u (Point2f); infinite elsewhere."""
        active = active & self.is_homogeneous(key)
        _, _, sigma_t = _coefficients(self._asked(key), self._interaction(ray), active)
        rate = _chosen(sigma_t, channel_weights(throughput), u.y)
        return dr.select(active & (rate > 0), -dr.log(1 - u.x) / rate, dr.inf)

    def collide_evenly(self, ray: Any, key: Any, throughput: Any, t: Any, end: Any, active: Any) -> tuple[Any, Any]:
        """What follows from a distance of `free_path`: the interaction there if it is before `end`, and the weight."""
        active = active & self.is_homogeneous(key)
        is_real = active & (t < end)
        reached = dr.minimum(t, end)
        interaction = self._interaction(ray)
        interaction.t = reached
        interaction.p = dr.select(is_real, dr.fma(ray.d, t, ray.o), ray.o)
        sigma_s, _, sigma_t = _coefficients(self._asked(key), interaction, active)
        weights = channel_weights(throughput)
        # Relative to the thinnest channel, so that none underflows that matters; what is not there passes any length.
        least = dr.min(sigma_t)
        passes = mi.Spectrum(dr.select(sigma_t > least, dr.exp((least - sigma_t) * reached), 1))
        density = dr.select(is_real, dr.sum(weights * sigma_t * passes), dr.sum(weights * passes))
        weight = dr.select(is_real, sigma_s, 1) * passes / density
        return interaction, dr.select(active, weight, 1)

    @dr.syntax
    def collide(self, ray: Any, key: Any, throughput: Any, end: Any, stream: Stream, drawn: Any, active: Any) -> Any:
        """Delta tracking in grids, up to the distance `end`: a `Collision`."""
        medium = self._asked(key)
        active = active & ~self.is_homogeneous(key)
        interaction = self._interaction(ray)
        walk, t, end = self._within(medium, key, ray, interaction, end, active)
        cell = walk.begin(t)
        steps = mi.UInt32(0)
        weight = mi.Spectrum(1)
        is_real = mi.Bool(False)
        going = active & (t < end)
        while dr.hint(going, label="delta tracking"):
            t, cell, rate, _, _ = walk.on(t, cell, -dr.log(1 - stream.at(drawn)), end, False, going)
            u = stream.at(drawn + 1)
            drawn += 2
            steps += 1
            at = mi.MediumInteraction3f(interaction)
            at.p, at.t = dr.fma(ray.d, t, ray.o), t
            is_inside = t < end
            sigma_s, _, sigma_t = _coefficients(medium, at, is_inside)
            weights = channel_weights(throughput * weight)
            sigma_n = rate - sigma_t
            real, null = dr.sum(weights * sigma_t), dr.sum(weights * dr.abs(sigma_n))
            chance = real / (real + null)
            is_real = is_inside & (u < chance)
            event = dr.select(is_real, sigma_s / chance, sigma_n / (1 - chance)) / rate
            weight[is_inside] = weight * event
            going = is_inside & ~is_real & (steps < STEPS) & dr.any(weight != 0)
        is_under_way = active & (t < end) & ~is_real & dr.any(weight != 0)
        interaction.t = t
        interaction.p = dr.select(is_real | is_under_way, dr.fma(ray.d, t, ray.o), ray.o)
        return Collision(interaction, is_real, is_under_way, weight, drawn, steps)

    def _within(self, medium: Any, key: Any, ray: Any, interaction: Any, end: Any, active: Any) -> tuple[Any, Any, Any]:
        """How to walk through a grid, and where along a ray the grid begins and ends, or the ray does."""
        is_met, near, far = medium.intersect_aabb(ray)
        near = dr.maximum(near, 0)
        far = dr.select(is_met, dr.minimum(far, end), near)
        if self.lattices is not None:
            return self.lattices.line(key, ray, active), near, far
        return Evenly(dr.max(medium.get_majorant(interaction, active))), near, far

    # ------------------------------ Transmittance ------------------------------

    @dr.syntax
    def transmittance(self, ray: Any, key: Any, end: Any, stream: Stream, drawn: Any, active: Any) -> Any:
        """An unbiased estimate of T(o, end), and how many random numbers are taken now."""
        active = active & (key != NO_MEDIUM)
        medium = self._asked(key)
        passed = mi.Spectrum(1)
        if dr.hint(self.has_homogeneous, mode="scalar"):
            even = active & self.is_homogeneous(key)
            _, _, sigma_t = _coefficients(medium, self._interaction(ray), even)
            passed[even] = mi.Spectrum(dr.select(sigma_t > 0, dr.exp(-sigma_t * end), 1))
        if dr.hint(self.has_grids, mode="scalar"):
            is_grid = active & ~self.is_homogeneous(key)
            interaction = self._interaction(ray)
            walk, t, end = self._within(medium, key, ray, interaction, end, is_grid)
            cell = walk.begin(t)
            ratio = mi.Spectrum(1)
            steps = mi.UInt32(0)
            going = is_grid & (t < end)
            while dr.hint(going, label="residual ratio tracking"):
                t, cell, rate, control, thinned = walk.on(t, cell, -dr.log(1 - stream.at(drawn)), end, True, going)
                is_inside = t < end
                ratio *= dr.select(going, dr.exp(-thinned), 1)
                at = mi.MediumInteraction3f(interaction)
                at.p, at.t = dr.fma(ray.d, t, ray.o), t
                _, _, sigma_t = _coefficients(medium, at, is_inside)
                ratio[is_inside] = ratio * (1 - (sigma_t - control) / rate)
                steps += 1
                most = dr.max(dr.abs(ratio))
                survival = dr.minimum(most / FAINT, 1) * dr.select(steps % LONG_WALK == 0, 0.5, 1)
                survives = stream.at(drawn + 1) < survival
                drawn += 2
                ratio[is_inside] = dr.select(survives, ratio / survival, 0)
                going = is_inside & survives
            passed[is_grid] = ratio
        return passed, drawn


def channel_weights(throughput: Any) -> Any:
    """Shares of the channels in the density that all of them are sampled with; they sum to one."""
    n = dr.size_v(mi.Spectrum)
    carried = dr.abs(throughput)
    total = dr.sum(carried)
    return dr.select(total > 0, (1 - EVEN_SHARE) * carried / total, (1 - EVEN_SHARE) / n) + EVEN_SHARE / n


def _coefficients(medium: Any, interaction: Any, active: Any) -> tuple[Any, ...]:
    """σs, σn and σt."""
    return tuple(mi.Spectrum(one) for one in medium.get_scattering_coefficients(interaction, active))


def _chosen(values: Any, weights: Any, u: Any) -> Any:
    """One of the channels' values, drawn with these weights."""
    found = mi.Float(values[0])
    below = mi.Float(0)
    for i in range(1, dr.size_v(mi.Spectrum)):
        below += weights[i - 1]
        found = dr.select(u >= below, values[i], found)
    return found


def _key(medium: Any) -> int:
    number: Any = dr.reinterpret_array(mi.UInt32, mi.MediumPtr(medium))
    return int(np.array(number)[0])
