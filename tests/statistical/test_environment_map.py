"""Environment maps: what they radiate, where they are divided into patches, and that none of it changes a picture."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from conftest import z_limit

import renderer
from renderer.backend import mitsuba, using
from renderer.equation.lights import environment_map
from renderer.equation.lights.environment_map import EnvironmentMap
from renderer.equation.path import PathKernel

mi = mitsuba()
T = mi.ScalarTransform4f
WIDTH, HEIGHT = 32, 24


def sky(rows: int = 24, columns: int = 40, seed: int = 4) -> Any:
    """A bitmap with a bright upper half, a bright spot and a dark band."""
    image = np.random.default_rng(seed).uniform(0.2, 1, (rows, columns, 3)).astype(np.float32)
    image[rows // 2 :] *= 0.2
    image[rows // 3 - 1 : rows // 3] = 0
    image[rows // 4, columns // 3] = 60
    return mi.Bitmap(image)


def scene_of(indoors: bool, bitmap: Any = None) -> dict[str, Any]:
    """A ball on a floor under a sky; indoors the sky is seen through a window alone."""
    grey = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.6, 0.5, 0.4]}}
    contents: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 4},
        "sensor": {
            "type": "perspective",
            "fov": 50,
            "to_world": T().look_at([0, 1.2, 3.5], [0, 0.6, 0], [0, 1, 0]),
            "film": {"type": "hdrfilm", "width": WIDTH, "height": HEIGHT, "rfilter": {"type": "box"}},
        },
        "sky": {"type": "envmap", "bitmap": bitmap or sky(), "scale": 0.7, "to_world": T().rotate([0.6, 0.8, 0], 33)},
        "floor": {"type": "rectangle", "to_world": T().rotate([1, 0, 0], -90).scale(4), "bsdf": grey},
        "ball": {"type": "sphere", "center": [0, 0.5, 0], "radius": 0.5, "bsdf": {"type": "plastic"}},
    }
    if indoors:
        walls = {
            "ceiling": T().translate([0, 3, 0]).rotate([1, 0, 0], 90).scale(4),
            "back": T().translate([0, 0, -4]).scale(4),
            "front": T().translate([0, 0, 4]).rotate([0, 1, 0], 180).scale(4),
            "right": T().translate([4, 0, 0]).rotate([0, 1, 0], -90).scale(4),
            "sill": T().translate([-4, -3, 0]).rotate([0, 1, 0], 90).scale(4),
        }
        contents |= {name: {"type": "rectangle", "to_world": at, "bsdf": grey} for name, at in walls.items()}
    return contents


def loaded(contents: dict[str, Any], colour: str = "rgb") -> renderer.Scene:
    return renderer.load_scene(contents, settings=renderer.Settings(WIDTH, HEIGHT, colour=colour))


def kernel_of(scene: renderer.Scene, technique: str = "mis", **changes: Any) -> PathKernel:
    settings = renderer.Settings(technique=technique, colour=scene.colour)  # type: ignore[arg-type]
    model = dataclasses.replace(scene.model(scene.resolved(settings, 16)), **changes)
    with using(scene.variant):
        return PathKernel(scene.mitsuba_scene, scene.sensor, (scene.width, scene.height), model)


@pytest.mark.parametrize("colour", ["rgb", "mono"])
@pytest.mark.parametrize("size", [(24, 40), (3, 3), (17, 64)])
def test_a_direction_has_the_radiance_that_the_plugin_says(colour: str, size: tuple[int, int]) -> None:
    import drjit as dr

    scene = loaded(scene_of(False, sky(*size)), colour)
    with using(scene.variant):
        emitter = scene.mitsuba_scene.environment()
        ours = EnvironmentMap.of(scene.mitsuba_scene, [emitter], False)
        assert ours is not None
        d = np.random.default_rng(3).normal(size=(3, 4096))
        si = dr.zeros(mi.SurfaceInteraction3f, d.shape[1])
        si.wi = -mi.Vector3f(*(d / np.linalg.norm(d, axis=0)).astype(np.float32))
        found = np.array(ours.spot(-si.wi, mi.Bool(True)).radiance)
        expected = np.array(emitter.eval(si))
    np.testing.assert_allclose(found, expected, rtol=2e-3, atol=2e-3)


@pytest.mark.parametrize("is_compensated", [False, True])
def test_densities_add_up_to_one_in_each_patch_and_in_all(is_compensated: bool, seed: int) -> None:
    with using("llvm_ad_rgb" if not str(mi.variant()).startswith("cuda") else "cuda_ad_rgb"):
        scene = mi.load_dict(scene_of(False))
        patched = EnvironmentMap.of(scene, [scene.environment()], is_compensated)
        assert patched is not None
        n = 2**21
        u = np.random.default_rng(seed).random((2, n), np.float32)
        d = mi.warp.square_to_uniform_sphere(mi.Point2f(u))
        for found in (patched, patched.undivided()):
            spot = found.spot(d, mi.Bool(True))
            density = np.array(spot.density, np.float64) * 4 * np.pi
            patch = np.broadcast_to(np.array(spot.patch), n)
            each = np.bincount(patch, density, found.n_patches) / n
            squares = np.bincount(patch, density**2, found.n_patches) / n
            error = np.sqrt((squares - each**2) / n)
            is_lit = found.shares > 1e-9
            assert found.shares.sum() == pytest.approx(1)
            assert (np.abs(each - 1)[is_lit] <= 6 * error[is_lit] + 1e-4).all()
            assert (each[~is_lit] < 1e-3).all()


@pytest.mark.parametrize("indoors", [False, True])
def test_patches_are_asked_by_the_place_only_where_much_of_the_sky_is_hidden(indoors: bool) -> None:
    emitters = kernel_of(loaded(scene_of(indoors))).emitters
    assert emitters.sky is not None
    assert emitters.knows_places is indoors
    assert (emitters.n_patches > 1) is emitters.knows_places


@pytest.mark.parametrize("colour", ["rgb", "mono"])
@pytest.mark.parametrize("indoors", [False, True])
def test_pictures_agree_with_those_by_direction_sampling_and_by_the_plugin(
    indoors: bool, colour: str, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = loaded(scene_of(indoors), colour)
    ours = [kernel_of(scene), kernel_of(scene, "emitter"), kernel_of(scene, surveys_lights=False)]
    monkeypatch.setattr(environment_map, "MOST_TEXELS", 100)  # of a larger one, a smaller says where to look
    ours += [kernel_of(scene), kernel_of(scene, "emitter")]
    assert all(kernel.emitters.sky is not None for kernel in ours)
    monkeypatch.setattr(EnvironmentMap, "of", lambda *_: None)
    others = [kernel_of(scene, "bsdf"), kernel_of(scene)]
    found = [mean_of(kernel, seed + i) for i, kernel in enumerate(ours + others)]
    expected, error = found.pop()
    for mean, own_error in found:
        assert np.abs(mean - expected) <= z_limit(len(found)) * np.hypot(error, own_error)


def test_an_even_map_is_sampled_as_a_whole() -> None:
    image = np.ones((8, 16, 3), np.float32)
    assert kernel_of(loaded(scene_of(False, mi.Bitmap(image)))).emitters.sky is not None


def mean_of(kernel: PathKernel, seed: int, replicates: int = 192) -> tuple[float, float]:
    """Mean luminance of the picture and its standard error."""
    n = WIDTH * HEIGHT
    pixels = np.tile(np.arange(n, dtype=np.uint32), replicates)
    lanes = np.repeat(np.arange(replicates, dtype=np.uint32), n)
    radiance, invalid, _ = kernel.launch(pixels, lanes, seed)
    assert not np.array(invalid).any()
    means = np.array(radiance, np.float64)[1].reshape(replicates, n).mean(axis=1)
    return float(means.mean()), float(means.std(ddof=1) / np.sqrt(replicates))
