"""Furnaces over roughness, index of refraction and angle: light from everywhere, so a surface shows its own albedo.

A plane under a uniform sky of radiance 1, paths of two segments: the image is the directional albedo of the surface,
which a quadrature of its BSDF gives without any Monte Carlo. Single-scattering models lose energy at large roughness:
that is the model's, and the quadrature loses it too.
"""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
from conftest import mean_and_error, z_limit

import renderer
from renderer.backend import mitsuba

mi = mitsuba()
SPP = 4096
SIDE = 4
GRID = (2048, 512)  # of the quadrature: angle from the lobe's axis, and azimuth
DISTANCE = 1000.0  # of the camera: at a grazing angle it must still be well above the plane
every_technique = pytest.mark.parametrize("technique", ["mis", pytest.param("bsdf", marks=pytest.mark.slow)])


def plane_under_sky(bsdf: dict[str, Any], degrees: float) -> dict[str, Any]:
    """Seen at an angle to the normal, through a narrow orthographic camera."""
    angle = math.radians(degrees)
    towards = [DISTANCE * math.sin(angle), 0, DISTANCE * math.cos(angle)]
    transform = mi.ScalarTransform4f
    look = transform().look_at(towards, [0, 0, 0], [0, 1, 0]).scale([1e-5, 1e-5, 1])
    film = {"type": "hdrfilm", "width": SIDE, "height": SIDE, "rfilter": {"type": "box"}}
    return {
        "type": "scene",
        "sensor": {"type": "orthographic", "near_clip": 1e-4, "to_world": look, "film": film},
        "plane": {"type": "rectangle", "to_world": transform().scale(10 * DISTANCE), "bsdf": bsdf},
        "sky": {"type": "constant", "radiance": 1.0},
    }


def albedo(bsdf: dict[str, Any], degrees: float) -> float:
    """∫ f cosθ dω over the whole sphere: around the mirror direction above, around the refracted one below."""
    angle = math.radians(degrees)
    index = float(bsdf.get("int_ior", 1.5046)) / 1.000277
    sine = math.sin(angle)
    mirrored = [-sine, 0, math.cos(angle)]
    refracted = [-sine / index, 0, -math.sqrt(1 - (sine / index) ** 2)]
    return _lobe(bsdf, angle, np.array(mirrored), 1) + _lobe(bsdf, angle, np.array(refracted), -1)


def _lobe(bsdf: dict[str, Any], angle: float, axis: np.ndarray, side: int) -> float:
    """The part of the integral on one side, by midpoints that crowd towards the axis of the lobe."""
    import drjit as dr

    rows, columns = GRID
    t = (np.arange(rows) + 0.5) / rows
    polar, d_polar = math.pi * t**4, math.pi * 4 * t**3 / rows
    azimuth = (np.arange(columns) + 0.5) / columns * 2 * math.pi
    y = np.array([0.0, 1, 0])
    x = np.cross(y, axis)
    rim = np.cos(azimuth)[:, None] * x + np.sin(azimuth)[:, None] * y
    wo = np.cos(polar)[:, None, None] * axis + np.sin(polar)[:, None, None] * rim
    wo = wo.reshape(-1, 3)
    si = dr.zeros(mi.SurfaceInteraction3f, len(wo))
    si.wi = mi.Vector3f(math.sin(angle), 0, math.cos(angle))
    si.sh_frame = mi.Frame3f(mi.Normal3f(0, 0, 1))
    found = mi.load_dict(dict(bsdf)).eval(mi.BSDFContext(), si, mi.Vector3f(np.ascontiguousarray(wo.T, np.float32)))
    value = np.where(wo[:, 2] * side > 0, np.array(found, np.float64)[1], 0)
    return float((value.reshape(rows, columns).mean(axis=1) * 2 * math.pi * np.sin(polar) * d_polar).sum())


def seen(bsdf: dict[str, Any], degrees: float, technique: str, seed: int) -> tuple[float, float, renderer.Estimate]:
    settings = renderer.Settings(seed=seed, technique=technique, max_depth=2)
    estimate = renderer.render(plane_under_sky(bsdf, degrees), renderer.Target(spp=SPP), settings)
    assert estimate.invalid.sum() == 0
    assert np.isfinite(estimate.mean).all()
    return *mean_and_error(estimate), estimate


ROUGH = {
    "metal": {"type": "roughconductor", "distribution": "ggx"},
    "beckmann metal": {"type": "roughconductor", "distribution": "beckmann"},
    "glass": {"type": "roughdielectric", "distribution": "ggx"},
    "thick glass": {"type": "roughdielectric", "int_ior": 2.4},
    "nearly air": {"type": "roughdielectric", "int_ior": 1.05},
    "plastic": {"type": "roughplastic"},
}


@every_technique
@pytest.mark.parametrize("alpha", [0.1, pytest.param(0.4, marks=pytest.mark.slow), 1.0])
@pytest.mark.parametrize("name", ROUGH)
def test_rough_surface_shows_its_albedo(name: str, alpha: float, technique: str, seed: int) -> None:
    for degrees in (0.0, 75.0):
        bsdf = ROUGH[name] | {"alpha": alpha}
        exact = albedo(bsdf, degrees)
        found, error, _ = seen(bsdf, degrees, technique, seed)
        # 1e-3: the quadrature, and Mitsuba's tabulated plastic. Its Beckmann lobe inverts the slopes by an
        # approximation: at 75° and alpha 0.4 its own draws, without any renderer, weigh 0.9009 ± 0.0001 in the mean.
        slack = 3e-3 if name == "beckmann metal" else 1e-3
        assert abs(found - exact) < z_limit(72) * error + slack * exact, f"{found} ± {error:.1g}, exact {exact:.5f}"
        assert found < 1 + z_limit(72) * error + 1e-5


@every_technique
@pytest.mark.parametrize("alpha", [0.0, 1e-7, 1e-4, 1e-3])
def test_nearly_smooth_metal_is_a_mirror(alpha: float, technique: str, seed: int) -> None:
    """A metal of reflectance 1 in a furnace vanishes; its pdf at these roughnesses exceeds 1e6."""
    for degrees in (0.0, 80.0):
        bsdf = {"type": "roughconductor", "material": "none", "alpha": alpha}
        found, error, _ = seen(bsdf, degrees, technique, seed)
        assert abs(found - 1) < z_limit(16) * error + 2e-3


GRAZING = (89.0, 89.99, 89.9999)


@every_technique
def test_grazing_diffuse_surface_keeps_its_albedo(technique: str, seed: int) -> None:
    for degrees in GRAZING:
        found, error, _ = seen({"type": "diffuse", "reflectance": 0.6}, degrees, technique, seed)
        assert abs(found - 0.6) < z_limit(10) * error + 1e-5, degrees


@every_technique
@pytest.mark.parametrize(
    "bsdf",
    [
        {"type": "dielectric"},
        {"type": "conductor", "material": "Cu"},
        {"type": "plastic"},
        {"type": "roughconductor", "material": "none", "alpha": 0.1},
        {"type": "roughplastic", "alpha": 0.05},
    ],
    ids=lambda bsdf: bsdf["type"],
)
def test_grazing_angles_stay_finite_and_below_one(bsdf: dict[str, Any], technique: str, seed: int) -> None:
    values = []
    for degrees in GRAZING:
        found, error, estimate = seen(bsdf, degrees, technique, seed)
        values.append((found, error))
        assert (estimate.mean >= 0).all()
        assert found < 1 + z_limit(10) * error + 1e-4, degrees
    # Smooth surfaces reflect more and more towards the horizon, up to everything.
    if not bsdf["type"].startswith("rough"):
        for (low, e_low), (high, e_high) in itertools.pairwise(values):
            assert high > low - z_limit(50) * math.hypot(e_low, e_high) - 1e-4


@pytest.mark.parametrize("ior", [1.0, 1 + 1e-7, 1 + 1e-4, 1.01, 1.33, 2.4, 1e3])
@pytest.mark.parametrize("plugin", ["dielectric", "thindielectric", "roughdielectric"])
def test_glass_of_any_index_vanishes_in_a_furnace(plugin: str, ior: float, seed: int) -> None:
    """A lossless ball in an emitting black shell: every path ends in the shell, so the image is 1 everywhere."""
    transform = mi.ScalarTransform4f
    bsdf: dict[str, Any] = {"type": plugin, "int_ior": ior, "ext_ior": 1.0}
    if plugin == "roughdielectric":
        bsdf["alpha"] = 1e-3  # rougher, the model itself loses energy
        if ior == 1:
            with pytest.raises(renderer.errors.SceneError, match="must be positive and differ"):
                renderer.load_scene(
                    {"type": "scene", "sensor": {"type": "perspective"}, "x": {"type": "sphere", "b": bsdf}}
                )
            return
    film = {"type": "hdrfilm", "width": 16, "height": 16, "rfilter": {"type": "box"}}
    scene = {
        "type": "scene",
        "sensor": {"type": "perspective", "fov": 40, "to_world": transform().look_at([0, 0, 4], [0, 0, 0], [0, 1, 0])},
        "ball": {"type": "sphere", "bsdf": bsdf},
        "shell": {
            "type": "sphere",
            "radius": 5.0,
            "flip_normals": True,
            "bsdf": {"type": "diffuse", "reflectance": 0.0},
            "emitter": {"type": "area", "radiance": 1.0},
        },
    }
    scene["sensor"]["film"] = film
    # Light caught in glass of index 1e3 needs some 1e6 bounces to leave: it is found by roulette, not by waiting.
    depth = -1 if ior < 100 else 64
    estimate = renderer.render(scene, renderer.Target(spp=256), renderer.Settings(seed=seed, max_depth=depth))
    assert estimate.invalid.sum() == 0
    found, error = mean_and_error(estimate)
    assert np.isfinite(estimate.mean).all()
    if ior < 100:
        assert abs(found - 1) < z_limit(21) * error + (2e-3 if plugin == "roughdielectric" else 1e-5)
    else:
        assert 0 < found <= 1 + z_limit(21) * error
