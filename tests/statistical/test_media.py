"""Participating media against closed forms: slabs, furnaces, single scattering, and against Mitsuba's `volpath`.

Whatever has a standard error is allowed four of them (false alarm 6e-5 each) and float32's rounding, 1e-4.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from conftest import variance_map

import renderer
from renderer.backend import mitsuba, using
from renderer.scene.source import load_part

SIDE = 4
SIGMAS, ROUNDING = 4.0, 1e-4


def rendered(scene: dict[str, Any], spp: int = 256, **settings: Any) -> renderer.Estimate:
    return renderer.render(scene, renderer.Target(spp=spp), renderer.Settings(adaptive=False, **settings))


def assert_mean(estimate: renderer.Estimate, truth: Any) -> None:
    """The image's mean is the truth, as far as its standard error tells."""
    mean, stderr = estimate.mean.mean((0, 1)), np.sqrt(variance_map(estimate)[..., :3])
    error = np.sqrt(np.sum(np.where(np.isfinite(stderr), stderr, 0) ** 2, (0, 1))) / stderr[..., 0].size
    off = np.abs(mean - truth)
    assert (off <= SIGMAS * error + ROUNDING * np.abs(truth)).all(), f"{mean} ± {error}, and the truth is {truth}"
    assert estimate.health.invalid == 0


def camera(**changes: Any) -> dict[str, Any]:
    """Looks along −z from z = 4, through a narrow field: all rays are as good as parallel."""
    look = mitsuba().ScalarTransform4f().look_at([0, 0, 4], [0, 0, 0], [0, 1, 0])
    film = {"type": "hdrfilm", "width": SIDE, "height": SIDE, "filter": {"type": "box"}}
    return {"type": "perspective", "fov": 0.1, "to_world": look, "film": film, **changes}


def transform(scale: Any = 1.0, at: Any = (0.0, 0.0, 0.0)) -> Any:
    return mitsuba().ScalarTransform4f().translate(list(at)).scale(scale)


def rgb(*values: float) -> dict[str, Any]:
    return {"type": "rgb", "value": list(values)}


def homogeneous(sigma_t: Any, albedo: Any = 0.0, **more: Any) -> dict[str, Any]:
    return {"type": "homogeneous", "sigma_t": sigma_t, "albedo": albedo, **more}


def grid(values: np.ndarray, scale: float, albedo: Any = 0.0, **more: Any) -> dict[str, Any]:
    """A grid that fills the cube from −1 to 1."""
    mi = mitsuba()
    data = mi.VolumeGrid(values.astype(np.float32))
    volume = {"type": "gridvolume", "grid": data, "to_world": transform(2.0, (-1, -1, -1))}
    return {"type": "heterogeneous", "sigma_t": volume, "albedo": albedo, "scale": scale, **more}


def cloud(medium: dict[str, Any], bsdf: str = "null", shape: str = "cube", **more: Any) -> dict[str, Any]:
    return {"type": shape, "bsdf": {"type": bsdf}, "interior": medium, **more}


def lit(scene: dict[str, Any], radiance: Any = 1.0) -> dict[str, Any]:
    sky = {"type": "constant", "radiance": radiance}
    return {"type": "scene", "integrator": {"type": "volpath"}, "sensor": camera(), "sky": sky, **scene}


# ------------------------------ Transmittance ------------------------------


@pytest.mark.parametrize("depth", [1e-6, 1e-3, 0.1, 1.0, 5.0, 20.0])
def test_a_slab_lets_pass_what_beer_and_lambert_say(depth: float) -> None:
    estimate = rendered(lit({"slab": cloud(homogeneous(depth / 2))}), spp=16)
    np.testing.assert_allclose(estimate.mean, math.exp(-depth), rtol=3e-5)


@pytest.mark.parametrize("depth", [1e-6, 0.1, 1.0, 5.0])
def test_a_slab_of_a_grid_lets_pass_the_same(depth: float) -> None:
    layers = np.array([0.5, 1.0, 0.25, 0.75])[:, None, None] * np.ones((4, 3, 3))  # along z, of equal thickness
    # Trilinear interpolation holds the outermost values to the border: the mean of the layers is that of the slab.
    estimate = rendered(lit({"slab": cloud(grid(layers, depth / (2 * layers.mean())))}), spp=1024)
    assert_mean(estimate, math.exp(-depth))


def test_each_colour_passes_by_its_own_extinction() -> None:
    sigma = np.array([0.1, 1.0, 3.0])
    estimate = rendered(lit({"slab": cloud(homogeneous(rgb(*sigma / 10), scale=10.0))}), spp=16)
    np.testing.assert_allclose(estimate.mean.mean((0, 1)), np.exp(-2 * sigma), rtol=3e-5)


def test_the_camera_may_be_in_a_medium() -> None:
    wall = {"type": "rectangle", "to_world": transform(4.0), "lamp": {"type": "area"}}
    estimate = rendered(
        {"type": "scene", "sensor": camera(medium=homogeneous(0.5), near_clip=1.0), "wall": wall}, spp=16
    )
    np.testing.assert_allclose(estimate.mean, math.exp(-0.5 * 3), rtol=3e-5)  # from the near plane on


def test_nested_media_follow_each_other() -> None:
    inner = cloud(homogeneous(2.0), shape="sphere", radius=0.5, exterior=homogeneous(0.3))
    estimate = rendered(lit({"outer": cloud(homogeneous(0.3)), "inner": inner}), spp=16)
    np.testing.assert_allclose(estimate.mean, math.exp(-0.3 * 1.0 - 2.0 * 1.0), rtol=1e-4)


@pytest.mark.parametrize("depth", [1e5, 1e6])
def test_nothing_passes_an_opaque_medium(depth: float) -> None:
    for medium in (homogeneous(depth / 2), grid(np.ones((3, 3, 3)), depth / 2)):
        estimate = rendered(lit({"slab": cloud(medium)}), spp=16)
        np.testing.assert_array_equal(estimate.mean, 0)


# ------------------------------ Furnaces ------------------------------

WHITE: dict[str, Any] = {
    "thin": homogeneous(1e-6, 1.0),
    "even": homogeneous(1.5, 1.0),
    "coloured": homogeneous(rgb(0.1, 0.4, 1.0), 1.0, scale=2.5),
    "forward": homogeneous(2.0, 1.0, phase={"type": "hg", "g": 0.7}),
    "backward": homogeneous(2.0, 1.0, phase={"type": "hg", "g": -0.4}),
    "rayleigh": homogeneous(2.0, 1.0, phase={"type": "rayleigh"}),
    "blend": homogeneous(
        2.0, 1.0, phase={"type": "blendphase", "weight": 0.3, "a": {"type": "hg", "g": 0.5}, "b": {"type": "isotropic"}}
    ),
    "table": homogeneous(2.0, 1.0, phase={"type": "tabphase", "values": "0.5, 1.0, 1.5, 2.0, 1.0"}),
}


@pytest.mark.parametrize(
    ("name", "technique"),
    [*((name, technique) for name in WHITE for technique in ("mis", "bsdf")), ("even", "emitter"), ("even", "uniform")],
)
def test_a_white_medium_in_a_furnace_is_not_seen(name: str, technique: Any) -> None:
    assert_mean(rendered(lit({"cloud": cloud(WHITE[name])}), technique=technique), 1.0)


@pytest.mark.parametrize("technique", ["mis", "bsdf"])
def test_a_white_grid_in_a_furnace_is_not_seen(technique: Any) -> None:
    values = np.random.default_rng(1).random((5, 4, 3)) * np.array([0.0, 1.0, 1.0, 0.3, 1.0])[:, None, None]
    assert_mean(rendered(lit({"cloud": cloud(grid(values, 3.0, 1.0))}), technique=technique), 1.0)


@pytest.mark.parametrize("bsdf", ["dielectric", "roughdielectric"])
def test_a_white_medium_in_glass_is_not_seen(bsdf: str) -> None:
    # Rough glass loses what its microfacets reflect more than once: so much the same glass loses without a medium.
    glass = {"type": bsdf, "int_ior": 1.3} | ({"alpha": 0.05} if bsdf == "roughdielectric" else {})
    ball = {"type": "sphere", "bsdf": glass}
    assert_mean(rendered(lit({"ball": ball | {"interior": homogeneous(1.0, 1.0)}}), spp=1024), 1.0)


@pytest.mark.parametrize("depth", [100.0, 1e6])
def test_a_dense_white_medium_ends(depth: float) -> None:
    """Unlimited depth and no light lost: what is not reflected near the border goes on for a very long time."""
    estimate = rendered(lit({"cloud": cloud(homogeneous(depth / 2, 1.0))}), spp=16, max_depth=-1)
    assert estimate.health.invalid == 0
    assert 0.9 < estimate.mean.mean() < 1.1  # roulette's ceiling costs and gives: see `roulette`


# ------------------------------ Single scattering ------------------------------


def singly_scattered(sigma_t: float, albedo: float, phase: float) -> float:
    """A ray through the middle of a ball of radius 1, lit from the side by parallel rays of irradiance π."""
    t = (np.arange(20000) + 0.5) / 20000 * 2  # along the ray, from the border
    aside = np.sqrt(np.maximum(1 - (t - 1) ** 2, 0))  # that the light goes through the ball
    return float(np.mean(np.exp(-sigma_t * (t + aside))) * 2 * sigma_t * albedo * phase * math.pi)


@pytest.mark.parametrize(("g", "phase"), [(0.0, 1 / (4 * math.pi)), (0.6, 0.64 / (4 * math.pi * 1.36**1.5))])
@pytest.mark.parametrize("kind", ["even", "grid"])
def test_single_scattering_in_a_ball_is_its_integral(g: float, phase: float, kind: str) -> None:
    scattering = {"type": "hg", "g": g}
    medium = homogeneous(0.8, 0.7, phase=scattering)
    if kind == "grid":
        medium = grid(np.ones((2, 2, 2)), 0.8, 0.7, phase=scattering)
    sun = {"type": "directional", "direction": mitsuba().ScalarPoint3f(0, -1, 0), "irradiance": math.pi}
    scene = {"type": "scene", "sensor": camera(), "sun": sun, "ball": cloud(medium, shape="sphere")}
    # At right angles to the ray: cosθ = 0 in the phase function.
    assert_mean(rendered(scene, spp=1024, max_depth=2), singly_scattered(0.8, 0.7, phase))


# ------------------------------ Against volpath ------------------------------


def assert_like_volpath(scene: dict[str, Any], spp: int = 512, runs: int = 8, **settings: Any) -> None:
    """Our image's mean is that of Mitsuba's `volpath` on the same scene."""
    ours = rendered(scene, spp, **settings)
    loaded = renderer.load_scene(scene, settings=renderer.Settings(**settings))
    with using(loaded.variant):
        needs = loaded.requirements
        asked = {"max_depth": needs.max_depth, "rr_depth": needs.rr_depth, "hide_emitters": needs.hide_emitters}
        theirs = load_part(loaded._parsed, {"type": "volpath", **asked})
        images = [np.array(theirs.render(loaded.mitsuba_scene, loaded.sensor, run + 1, spp)) for run in range(runs)]
    assert_same_mean(ours, images)


def assert_same_mean(ours: renderer.Estimate, images: list[np.ndarray]) -> None:
    """Images are Mitsuba's, each of its own seed."""
    runs = len(images)
    means = np.array([image[..., :3].mean((0, 1)) for image in images])
    stderr = np.sqrt(variance_map(ours)[..., :3])
    error = np.sqrt(
        np.sum(np.where(np.isfinite(stderr), stderr, 0) ** 2, (0, 1)) / stderr[..., 0].size ** 2
        + means.var(0, ddof=1) / runs
    )
    z = (ours.mean.mean((0, 1)) - means.mean(0)) / error
    assert (np.abs(z) < 5).all(), f"ours {ours.mean.mean((0, 1))}, volpath {means.mean(0)}, {z} standard errors apart"


def room(**more: Any) -> dict[str, Any]:
    """A coloured cloud with a ball in it, above a floor, with a lamp and a dim sky."""
    mi = mitsuba()
    look = mi.ScalarTransform4f().look_at([0, 1, 5], [0, 0, 0], [0, 1, 0])
    film = {"type": "hdrfilm", "width": 12, "height": 12, "filter": {"type": "gaussian"}}
    down = mi.ScalarTransform4f().translate([0, -1.2, 0]).rotate([1, 0, 0], -90).scale(3.0)
    above = mi.ScalarTransform4f().translate([0, 2.5, 0]).rotate([1, 0, 0], 90).scale(0.5)
    return {
        "type": "scene",
        "integrator": {"type": "volpath", "max_depth": 8},
        "sensor": {"type": "perspective", "fov": 40, "to_world": look, "film": film},
        "floor": {"type": "rectangle", "to_world": down, "bsdf": {"type": "diffuse"}},
        "lamp": {"type": "rectangle", "to_world": above, "light": {"type": "area", "radiance": rgb(8.0, 6.0, 5.0)}},
        "sky": {"type": "constant", "radiance": 0.2},
        **more,
    }


def lamp_inside() -> dict[str, Any]:
    bulb = {"type": "sphere", "radius": 0.2, "light": {"type": "area", "radiance": 5.0}}
    return {"cloud": cloud(homogeneous(0.6, 0.8)), "bulb": bulb}


SCENES: dict[str, Any] = {
    "coloured grid": lambda: {
        "cloud": cloud(grid(np.random.default_rng(2).random((4, 4, 4, 3)), 2.0, rgb(0.9, 0.6, 0.3)))
    },
    "lamp inside": lamp_inside,
    "ball inside": lambda: {
        "cloud": cloud(homogeneous(rgb(0.2, 0.4, 0.8), rgb(0.9, 0.8, 0.5), scale=2.0)),
        "ball": {"type": "sphere", "radius": 0.5, "bsdf": {"type": "diffuse", "reflectance": rgb(0.8, 0.2, 0.2)}},
    },
    "cloudy glass": lambda: {
        "glass": cloud(homogeneous(rgb(0.25, 0.5, 1.0), 0.9, scale=4.0), "dielectric", "sphere", radius=0.8),
    },
    "masked cloud": lambda: {
        "cloud": {
            "type": "sphere",
            "bsdf": {"type": "mask", "opacity": 0.4, "inner": {"type": "twosided", "bsdf": {"type": "diffuse"}}},
            "interior": homogeneous(0.7, 0.8),
        }
    },
    "camera in fog": lambda: {"sensor": room()["sensor"] | {"medium": homogeneous(0.1, 0.9)}},
    # Not with a lamp inside: behind a hidden one, Mitsuba leaves out what there is of the medium.
    "hidden lights": lambda: {
        "integrator": {"type": "volpath", "max_depth": 6, "hide_emitters": True},
        "cloud": cloud(homogeneous(0.6, 0.8)),
    },
    "point and sun": lambda: {
        "cloud": cloud(homogeneous(0.6, 0.8, phase={"type": "hg", "g": 0.5})),
        "point": {"type": "point", "position": mitsuba().ScalarPoint3f(0.2, 0.3, 0.4), "intensity": 1.0},
        "sun": {"type": "directional", "direction": mitsuba().ScalarPoint3f(0.2, -1, 0.1), "irradiance": 1.0},
    },
    "grids and even ones": lambda: {
        "cloud": cloud(
            grid(np.random.default_rng(3).random((4, 4, 4)), 1.0, 0.9), to_world=transform(0.6, (-0.8, 0, 0))
        ),
        "other": cloud(homogeneous(1.0, 0.7), to_world=transform(0.5, (0.9, 0, 0))),
    },
    "no emitter sampling": lambda: {"cloud": cloud(homogeneous(0.6, 0.8, sample_emitters=False))},
}


@pytest.mark.parametrize("name", SCENES)
def test_scenes_with_media_are_those_of_volpath(name: str) -> None:
    assert_like_volpath(room(**SCENES[name]()))


def test_spectral_media_are_those_of_volpath() -> None:
    assert_like_volpath(room(**SCENES["ball inside"]()), colour="spectral")


def nested_in_rough_glass() -> dict[str, Any]:
    outer = homogeneous(rgb(0.5, 0.3, 1.0), rgb(0.8, 0.9, 0.5))
    inner = homogeneous(rgb(1.0, 0.7, 0.3), rgb(0.5, 0.9, 0.9), scale=3.0, phase={"type": "hg", "g": 0.5})
    return {
        "glass": cloud(outer, "roughdielectric", "sphere", radius=0.9),
        "core": cloud(inner, "null", "sphere", radius=0.4, exterior=outer),
    }


def instances() -> dict[str, Any]:
    cube = cloud(homogeneous(rgb(1.0, 0.5, 0.7), rgb(0.7, 0.9, 0.5)), to_world=transform(0.5))
    turned = transform(1.0, (0.8, 0.1, 0)).rotate([0, 1, 0], 20)
    return {
        "group": {"type": "shapegroup", "cube": cube},
        "left": {"type": "instance", "of": {"type": "ref", "id": "group"}, "to_world": transform(1.0, (-0.8, 0, 0))},
        "right": {"type": "instance", "of": {"type": "ref", "id": "group"}, "to_world": turned},
    }


def turned_grid() -> dict[str, Any]:
    """A coloured grid, smaller than its cloud and turned in it, with colours of another resolution."""
    mi, random = mitsuba(), np.random.default_rng(1)
    to_world = mi.ScalarTransform4f().rotate([0.6, 0.8, 0], 30).translate([0.1, 0, 0]).scale(0.7)
    medium = grid(random.random((6, 5, 4, 3)), 4.0)
    colours = mi.VolumeGrid((0.9 * random.random((3, 4, 5, 3))).astype(np.float32))
    medium["sigma_t"] |= {"to_world": to_world}
    return {"cloud": cloud(medium | {"albedo": {"type": "gridvolume", "grid": colours, "to_world": to_world}})}


@pytest.mark.parametrize("made", [nested_in_rough_glass, instances, turned_grid])
def test_scenes_with_media_are_as_they_were_written(made: Any) -> None:
    """Against the scene that Mitsuba makes of it, not the one that was moved and scaled to be rendered."""
    scene = room(**made())
    scene["sensor"]["film"]["filter"] = {"type": "box"}  # with another, borders of pictures differ in how they are made
    ours = rendered(scene, 512)
    with using(renderer.load_scene(scene).variant):
        theirs: Any = mitsuba().load_dict(scene)
        images = [np.array(mitsuba().render(theirs, seed=run + 1, spp=512))[..., :3] for run in range(8)]
    assert_same_mean(ours, images)


@pytest.mark.parametrize("name", ["fog", "smoke", "cloudy-glass"])
def test_built_in_scenes_with_media_are_those_of_volpath(name: str) -> None:
    entry = renderer.gallery.find(name)
    scene = entry.build()
    scene["sensor"]["film"] |= {"width": 16, "height": round(16 * entry.height / entry.width)}
    assert_like_volpath(scene)


@pytest.mark.parametrize("kind", ["homogeneous", "grid"])
def test_alpha_is_the_share_that_does_not_pass_straight(kind: str) -> None:
    """A cube of optical depth 0.8 along the camera's rays, behind a border that lets light pass."""
    mi = mitsuba()
    medium: dict[str, Any] = {"type": "homogeneous", "sigma_t": 0.4, "albedo": 0.3}
    if kind == "grid":
        grid = mi.VolumeGrid(np.full((4, 4, 4, 1), 0.4, np.float32))
        to_world = mi.ScalarTransform4f().translate([-1, -1, -1]).scale(2)
        medium |= {"type": "heterogeneous", "sigma_t": {"type": "gridvolume", "grid": grid, "to_world": to_world}}
    towards = mi.ScalarTransform4f().look_at([0, 0, -5], [0, 0, 0], [0, 1, 0])
    film = {"type": "hdrfilm", "width": 24, "height": 24, "pixel_format": "rgba", "rfilter": {"type": "box"}}
    contents = {
        "type": "scene",
        "integrator": {"type": "volpath"},
        "sensor": {"type": "orthographic", "to_world": towards @ mi.ScalarTransform4f().scale(0.5), "film": film},
        "lamp": {"type": "point", "position": [0, 3, -3], "intensity": 5.0},
        "cube": {"type": "cube", "bsdf": {"type": "null"}, "interior": medium},
    }
    alpha = renderer.render(contents, renderer.Target(spp=4)).channels["alpha"]
    # At least four samples each of 576 pixels: 0.01 of standard error, for the grid alone.
    assert abs(float(alpha.mean()) - (1 - math.exp(-0.8))) < (0.05 if kind == "grid" else 1e-4)
