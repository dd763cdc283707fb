"""Directions drawn uniformly, by the cosine or by the BSDF: their densities, and the albedo that each of them finds."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
import pytest
from conftest import p_limit, z_limit
from directions import Array, Cone, p_value

from renderer.backend import mitsuba
from renderer.equation.techniques import Directions

mi = mitsuba()
DRAWS = 2**18
SPHERE = Cone.around((0, 0, 1), np.pi)


def uniform_density(cosine: Array) -> Array:
    return np.full_like(cosine, 1 / (2 * np.pi))


def cosine_density(cosine: Array) -> Array:
    return cosine / np.pi


@pytest.mark.parametrize("technique", ["uniform", "cosine"])
@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("passes", [False, True], ids=["opaque", "transmissive"])
def test_directions_follow_their_density(technique: str, side: int, passes: bool, seed: int) -> None:
    """Over the hemisphere of wi, and half of them on the other side where light passes."""
    u = np.random.default_rng(seed).random((3, DRAWS), np.float32)
    wi = mi.Vector3f(0.6, 0, 0.8 * side)
    wo, told = Directions(technique).warp(wi, mi.Bool(passes), mi.Float(u[0]), mi.Point2f(u[1:]))
    profile = uniform_density if technique == "uniform" else cosine_density

    def density(d: Array) -> Array:
        cosine = d[:, 2] * side
        return np.where(passes, 0.5, cosine > 0) * profile(np.abs(cosine))

    drawn = np.array(wo, np.float64).T
    np.testing.assert_allclose(np.broadcast_to(np.array(told), DRAWS), density(drawn), rtol=1e-4, atol=1e-5)
    assert p_value(drawn, DRAWS, SPHERE, density) > p_limit()


BSDFS: dict[str, dict[str, Any]] = {
    "diffuse": {"type": "diffuse", "reflectance": 0.6},
    "rough conductor": {"type": "roughconductor", "alpha": 0.5},
    "plastic": {"type": "plastic"},  # a mirror over a diffuse base
    "rough plastic": {"type": "roughplastic", "alpha": 0.4},
    "rough dielectric": {"type": "roughdielectric", "alpha": 0.5, "int_ior": 1.4},
    "glass": {"type": "dielectric"},
    "thin glass": {"type": "thindielectric"},
    "mirror": {"type": "conductor"},
    "half mask": {"type": "mask", "opacity": 0.4, "nested": {"type": "diffuse"}},
    "blend of paints": {
        "type": "blendbsdf",
        "weight": 0.3,
        "a": {"type": "diffuse"},
        "b": {"type": "roughconductor", "alpha": 0.4},
    },
    "two-sided plastic": {"type": "twosided", "nested": {"type": "plastic"}},
    "principled": {"type": "principled", "roughness": 0.5, "metallic": 0.3, "clearcoat": 0.5},
    "translucent principled": {"type": "principledthin", "roughness": 0.6, "diff_trans": 0.8, "spec_trans": 0.2},
}


@pytest.mark.parametrize("name", BSDFS)
def test_every_technique_finds_the_same_albedo(name: str, seed: int) -> None:
    """E[f cosθ / pdf] is the share of light that leaves, however directions are drawn; mirrors included.

    Weighted by a function of the direction as well, so that light sent to the wrong side would show.
    """
    bsdf = mi.load_dict(BSDFS[name])
    found: dict[str, tuple[Array, Array]] = {}
    for i, technique in enumerate(("uniform", "cosine", "bsdf")):
        u = np.random.default_rng([seed, i]).random((3, DRAWS), np.float32)
        si = surface_seen_from(mi.Vector3f(0.48, -0.36, 0.8))
        ctx = mi.BSDFContext()
        bs, weight = Directions(technique).sample(bsdf, ctx, si, mi.Float(u[0]), mi.Point2f(u[1:]), mi.Bool(True))
        value = np.broadcast_to(np.array(weight, np.float64)[1], DRAWS)
        value = np.where(np.broadcast_to(np.array(bs.pdf), DRAWS) > 0, value, 0)
        wo = np.array(bs.wo, np.float64)
        parts = np.stack([value, value * (1 + wo[0]) * (1 + 0.5 * wo[2])])
        found[technique] = parts.mean(axis=1), parts.var(axis=1, ddof=1) / DRAWS
    assert found["bsdf"][0][0] > 0.1
    for first, second in combinations(found, 2):
        (a, va), (b, vb) = found[first], found[second]
        z = (a - b) / np.sqrt(va + vb + (1e-6 * a) ** 2)
        assert np.abs(z).max() < z_limit(6), f"{first} {a}, {second} {b}, z {z}"


def surface_seen_from(wi: Any) -> Any:
    import drjit as dr

    si = dr.zeros(mi.SurfaceInteraction3f)
    si.wi = wi
    si.n = mi.Normal3f(0, 0, 1)
    si.sh_frame = mi.Frame3f(si.n)
    si.dp_du, si.dp_dv = mi.Vector3f(1, 0, 0), mi.Vector3f(0, 1, 0)
    return si
