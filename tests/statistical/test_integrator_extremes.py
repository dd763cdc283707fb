"""Extremes of the integrator: huge densities, tiny throughput, deep paths, not finite samples, very many samples."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from conftest import mean_and_error, z_limit
from test_furnace import furnace

import renderer
from renderer.backend import mitsuba
from renderer.estimate.moments import Moments

mi = mitsuba()


def over_a_floor(lights: dict[str, Any], albedo: float = 0.5) -> dict[str, Any]:
    """A small patch of floor at the origin, seen from above."""
    transform = mi.ScalarTransform4f
    return {
        "type": "scene",
        "sensor": {
            "type": "orthographic",
            "to_world": transform().look_at([0, 0, 0.5], [0, 0, 0], [0, 1, 0]).scale([1e-3, 1e-3, 1]),
            "film": {"type": "hdrfilm", "width": 8, "height": 8, "rfilter": {"type": "box"}},
        },
        "floor": {"type": "rectangle", "bsdf": {"type": "diffuse", "reflectance": albedo}},
        **lights,
    }


@pytest.mark.parametrize("technique", ["mis", "emitter"])
@pytest.mark.parametrize("distance", [1e2, 1e5, 1e8, 1e10, 1e12])
def test_a_light_however_far_away_gives_the_analytic_irradiance(distance: float, technique: str, seed: int) -> None:
    """A light of 1×1 at 1e10 has a solid-angle density of 1e20: its square overflows, and the weight was inf/inf."""
    transform = mi.ScalarTransform4f
    lamp = {
        "type": "rectangle",
        "to_world": transform().translate([0, 0, distance]).rotate([1, 0, 0], 180).scale(0.5),
        "emitter": {"type": "area", "radiance": distance**2},
    }
    settings = renderer.Settings(seed=seed, technique=technique, max_depth=2)
    estimate = renderer.render(over_a_floor({"lamp": lamp}), renderer.Target(spp=64), settings)
    assert float(estimate.mean.mean()) == pytest.approx(0.5 / math.pi, rel=1e-3)


@pytest.mark.parametrize("radiance", [1e-20, 1e-10, 1e10, 1e20])
def test_radiance_of_any_size_keeps_its_digits(radiance: float, seed: int) -> None:
    settings = renderer.Settings(seed=seed, max_depth=3)
    estimate = renderer.render(furnace(0.5, radiance), renderer.Target(spp=64), settings)
    assert float(estimate.mean.mean()) == pytest.approx(1.75 * radiance, rel=1e-3)
    assert (estimate.stderr >= 0).all()
    assert estimate.stderr.max() < 0.05 * radiance


@pytest.mark.parametrize(
    ("albedo", "depth", "spp"),
    [(1e-6, 10_000, 1024), (0.99, 10_000, 256), (0.99, -1, 256), (0.9999999, 1000, 64), (0.9999999, 10_000, 32)],
)
def test_roulette_keeps_the_mean_of_deep_paths(albedo: float, depth: int, spp: int, seed: int) -> None:
    """Tiny throughput must not underflow the chance to survive, and bright paths must not grow without bound."""
    estimate = renderer.render(furnace(albedo), renderer.Target(spp=spp), renderer.Settings(seed=seed, max_depth=depth))
    albedo = float(np.float32(albedo))  # as the kernel has it
    exact = (1 - (albedo**depth if depth > 0 else 0)) / (1 - albedo)
    found, error = mean_and_error(estimate)
    assert np.isfinite(estimate.mean).all()
    assert estimate.invalid.sum() == 0
    assert abs(found - exact) < z_limit(5) * error + 1e-4 * exact, f"{found} ± {error}, exact {exact}"
    assert error < 0.02 * exact


@pytest.mark.parametrize("albedo", [1e-3, 1e-6, 1e-9, 1e-20])
def test_light_that_arrives_after_a_dark_bounce_is_not_lost(albedo: float, seed: int) -> None:
    """A nearly black floor under a sky of radiance 1 has radiance ρ, and every path that brings it has played.

    Without a floor the chance to survive falls below what a float32 number can draw, and the image is black.
    """
    scene = over_a_floor({"sky": {"type": "constant", "radiance": 1.0}}, albedo)
    scene["integrator"] = {"type": "path", "rr_depth": 1, "max_depth": 2}
    settings = renderer.Settings(seed=seed, technique="bsdf")
    estimate = renderer.render(scene, renderer.Target(spp=4096), settings)
    found, error = mean_and_error(estimate)
    assert abs(found - albedo) < z_limit(4) * error + 1e-5 * albedo
    assert error < 0.02 * albedo
    assert estimate.invalid.sum() == 0


def test_samples_that_are_not_finite_are_counted_and_never_in_the_image(seed: int) -> None:
    """A texture with NaN and Inf texels: their samples are counted per pixel, and the rest of the pixel is right."""
    texels = np.full((4, 4, 3), 0.25, np.float32)
    texels[1, 2], texels[3, 0] = np.nan, np.inf
    radiance = {"type": "bitmap", "bitmap": mi.Bitmap(texels), "raw": True, "filter_type": "nearest"}
    scene = {
        "type": "scene",
        "sensor": {
            "type": "orthographic",
            "to_world": mi.ScalarTransform4f().look_at([0, 0, 1], [0, 0, 0], [0, 1, 0]),
            "film": {"type": "hdrfilm", "width": 6, "height": 6, "rfilter": {"type": "box"}},
        },
        "screen": {"type": "rectangle", "emitter": {"type": "area", "radiance": radiance}},
    }
    estimate = renderer.render(scene, renderer.Target(spp=64), renderer.Settings(seed=seed))
    assert np.isfinite(estimate.mean).all()
    np.testing.assert_allclose(estimate.mean[estimate.count > 0], 0.25, rtol=1e-6)
    lost = int(estimate.invalid.sum())
    # Two of sixteen texels; a (0,2) net puts 64 samples of a pixel evenly, so the share is nearly exact.
    assert lost == pytest.approx(estimate.samples * 2 / 16, rel=0.02)
    assert (estimate.invalid == 0).sum() >= 20  # only pixels that see these texels


@pytest.mark.slow
def test_a_hundred_million_samples_of_a_constant_keep_their_mean(seed: int) -> None:
    """1e8 samples added up in float32 are 9 % off by 1e7 samples; short replicates folded into float64 are not."""
    scene = furnace(0.0, 0.7)
    scene["sensor"]["film"] |= {"width": 128, "height": 128}
    settings = renderer.Settings(seed=seed, max_depth=1, replicate_size=64)
    estimate = renderer.render(scene, renderer.Target(spp=6144), settings)
    assert estimate.samples > 1e8
    truth = float(np.float32(0.7))
    assert np.abs(estimate.mean / truth - 1).max() < 1e-6
    assert (estimate.stderr >= 0).all()
    assert estimate.stderr.max() < 1e-6 * truth


def test_one_pixel_takes_a_hundred_million_samples() -> None:
    """The same in the moments alone, where a naive sum of squares would give a variance below zero."""
    moments = Moments.empty(1)
    value = np.full((1, 3), np.float32(0.7))
    nothing = np.zeros(1, np.int64)
    for _ in range(14):  # doubled by merging: 2^14 · 64 · 100 replicates of one sample
        moments.add(slice(None), value, nothing, 1)
    for _ in range(23):
        moments = moments.merge(moments)
    assert moments.count[0] > 1e8
    assert abs(moments.mean[0, 0] / float(np.float32(0.7)) - 1) < 1e-12
    assert 0 <= moments.variance_of_mean()[0, 0] < 1e-24


@pytest.mark.parametrize("gap", [4e-5, 4e-6])
def test_light_reaches_a_ball_through_a_shell_that_nearly_touches_it(gap: float, seed: int) -> None:
    """A ball of albedo 0.6 in a bubble of nothing, under a white sky: 0.6 wherever it is seen."""
    film = {"type": "hdrfilm", "width": 8, "height": 8}
    look = mi.ScalarTransform4f().look_at([0, 0, 5], [0, 0, 0], [0, 1, 0])
    scene = renderer.load_scene(
        {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 8},
            "sensor": {"type": "perspective", "fov": 14, "to_world": look, "film": film},
            "ball": {"type": "sphere", "radius": 1, "bsdf": {"type": "diffuse", "reflectance": 0.6}},
            "bubble": {"type": "sphere", "radius": 1 + gap, "bsdf": {"type": "null"}},
            "sky": {"type": "constant"},
        }
    )
    assert not any("thin gap" in warning for warning in scene.warnings)
    found, error = mean_and_error(renderer.render(scene, renderer.Target(spp=256), renderer.Settings(seed=seed)))
    assert abs(found - 0.6) < z_limit(2) * error + 1e-2 * 0.6
