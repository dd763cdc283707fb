"""Facts about polarised light: what optics says of filters and mirrors, and what Mitsuba's `stokes` says of rooms."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import renderer
from renderer import Settings, Target
from renderer.backend import mitsuba
from renderer.errors import SettingsError, UnsupportedScene
from renderer.estimate import readings
from renderer.estimate.estimate import Estimate, merge
from renderer.image.exr import STOKES_CHANNELS
from renderer.replay import differences, replay, settings_of
from tests.statistical.conftest import z_limit

FLOAT32 = 2e-6  # what a few products in single precision may be off by
GREY_CONDUCTOR = {"eta": {"type": "uniform", "value": 0.25}, "k": {"type": "uniform", "value": 3.0}}


def place() -> Any:
    return mitsuba().ScalarTransform4f()


def seen_along_z(nodes: dict[str, Any], size: int = 1) -> dict[str, Any]:
    """What an orthographic camera sees that looks along −z, y upwards. No path plays roulette."""
    camera = place().look_at(origin=[0, 0, 5], target=[0, 0, 0], up=[0, 1, 0]).scale([0.1, 0.1, 1])
    film = {"type": "hdrfilm", "width": size, "height": size, "filter": {"type": "box"}}
    return {
        "type": "scene",
        "integrator": {"type": "stokes", "inner": {"type": "path", "max_depth": 12, "rr_depth": 99}},
        "sensor": {"type": "orthographic", "to_world": camera, "film": film},
        **nodes,
    }


def filters(*bsdfs: dict[str, Any]) -> dict[str, Any]:
    """Plates across the view, the first one next to the camera."""
    return {
        f"filter{i}": {"type": "rectangle", "to_world": place().translate([0, 0, 3 - i]), "bsdf": bsdf}
        for i, bsdf in enumerate(bsdfs)
    }


def stokes_of(scene: dict[str, Any], spp: int = 16, **settings: Any) -> tuple[NDArray, NDArray]:
    """(4,) S0 to S3 of a picture's mean in green, and their standard errors."""
    estimate = renderer.render(scene, Target(spp=spp), Settings(**settings))
    assert estimate.stokes is not None
    error = np.sqrt(stokes_variance(estimate)[..., 1].sum(axis=(0, 1))) / (estimate.width * estimate.height)
    return estimate.stokes[..., 1].mean(axis=(0, 1)), error


def stokes_variance(estimate: Estimate) -> NDArray:
    """(H, W, 4, 3) variances of the means of S0 to S3: 0 of pixels that found nothing, as sums over pixels need it."""
    m = estimate.moments
    both = np.concatenate([m.variance_of_mean()[:, :3], m.stokes_variance_of_mean()], axis=1)
    return both.reshape(estimate.height, estimate.width, 4, 3)


SKY: dict[str, Any] = {"sky": {"type": "constant", "radiance": {"type": "rgb", "value": [1.0, 1.0, 1.0]}}}


# ------------------------------ What optics says ------------------------------


@pytest.mark.parametrize("colour", ["mono", "spectral"])
@pytest.mark.parametrize("angle", [0.0, 30.0, 45.0, 70.0, 90.0])
def test_two_polarisers_obey_the_law_of_malus(angle: float, colour: str) -> None:
    """Half of unpolarised light passes the first one, and cos² of the angle between them of that."""
    between = filters({"type": "polarizer", "theta": 0.0}, {"type": "polarizer", "theta": angle})
    # Of colours wavelengths are drawn, and green has its noise.
    found, error = stokes_of(seen_along_z({**between, **SKY}), spp=256 if colour == "spectral" else 4, colour=colour)
    passed = 0.5 * math.cos(math.radians(angle)) ** 2
    # What comes through the filter next to the camera swings along the picture's horizontal.
    assert (np.abs(found - [passed, passed, 0, 0]) <= z_limit(4) * error + 10 * FLOAT32).all(), (found, error)


@pytest.mark.parametrize("angle", [0.0, 20.0, 45.0, 110.0])
def test_the_frame_is_that_of_the_picture(angle: float) -> None:
    """A camera that is turned about its axis sees light swing the other way."""
    scene = seen_along_z({**filters({"type": "polarizer", "theta": 0.0}), **SKY})
    camera = place().look_at(origin=[0, 0, 5], target=[0, 0, 0], up=[0, 1, 0]).rotate([0, 0, 1], angle)
    scene["sensor"]["to_world"] = camera.scale([0.1, 0.1, 1])
    found, _ = stokes_of(scene)
    turned = math.radians(2 * angle)
    assert found[:2] == pytest.approx([0.5, 0.5 * math.cos(turned)], abs=10 * FLOAT32)
    assert abs(found[2]) == pytest.approx(abs(0.5 * math.sin(turned)), abs=10 * FLOAT32)


@pytest.mark.parametrize(("axis", "sign"), [(45.0, 1), (-45.0, -1)])
def test_a_quarter_wave_retarder_makes_circular_light_of_linear_light(axis: float, sign: int) -> None:
    wave = {"type": "retarder", "theta": axis, "delta": 90.0}
    found, _ = stokes_of(seen_along_z({**filters(wave, {"type": "polarizer", "theta": 0.0}), **SKY}))
    assert found == pytest.approx([0.5, 0, 0, sign * 0.5], abs=10 * FLOAT32)


def test_a_circular_polariser_lets_its_own_light_pass_and_stops_the_other() -> None:
    left, right = {"type": "circular", "left_handed": True}, {"type": "circular", "left_handed": False}
    same, _ = stokes_of(seen_along_z({**filters(left, left), **SKY}))
    crossed, _ = stokes_of(seen_along_z({**filters(right, left), **SKY}))
    assert np.abs(same) == pytest.approx([0.5, 0, 0, 0.5], abs=10 * FLOAT32)
    assert crossed == pytest.approx(np.zeros(4), abs=10 * FLOAT32)


def reflected(degrees: float, bsdf: dict[str, Any], radiance: float = 1.0) -> dict[str, Any]:
    """Light of a lamp by way of a plate that the camera sees so many degrees from its normal; nothing is behind it."""
    turn = place().rotate([0, 1, 0], degrees)
    away = math.radians(2 * degrees)  # of the reflected ray from the line of sight
    towards = np.array([math.sin(away), 0, math.cos(away)])
    lamp = place().look_at(origin=(4 * towards).tolist(), target=[0, 0, 0], up=[0, 1, 0])
    return {
        "plate": {"type": "rectangle", "to_world": turn.scale(3), "bsdf": bsdf},
        "lamp": {
            "type": "rectangle",
            "to_world": lamp.scale(0.5),
            "bsdf": {"type": "diffuse", "reflectance": {"type": "uniform", "value": 0.0}},
            "emitter": {"type": "area", "radiance": {"type": "uniform", "value": radiance}},
        },
    }


@pytest.mark.parametrize("ior", [1.33, 1.5, 2.4])
def test_light_reflected_at_the_angle_of_brewster_swings_one_way_alone(ior: float) -> None:
    """Along the surface, across the plane of incidence: for a plate that turns about the vertical, the vertical."""
    glass = {"type": "dielectric", "int_ior": ior, "ext_ior": 1.0}
    angle = math.degrees(math.atan(ior))
    found, error = stokes_of(seen_along_z({**reflected(angle, glass)}), spp=4096)
    share = 0.5 * ((ior**2 - 1) / (ior**2 + 1)) ** 2  # rs² is all that is left, of half of the light
    assert abs(found[0] - share) <= 4 * error[0] + 1e-5
    assert found[1] / found[0] == pytest.approx(-1, abs=1e-4)
    assert found[2:] / found[0] == pytest.approx([0, 0], abs=1e-4)


@pytest.mark.parametrize("degrees", [10.0, 40.0, 70.0, 85.0])
def test_a_metal_reflects_by_the_equations_of_fresnel(degrees: float) -> None:
    """Against amplitudes in complex numbers: S0 and S1 of unpolarised light."""
    found, _ = stokes_of(seen_along_z({**reflected(degrees, {"type": "conductor", **GREY_CONDUCTOR})}))
    cos_i = math.cos(math.radians(degrees))
    eta = 0.25 + 3.0j
    cos_t = np.sqrt(1 - (1 - cos_i**2) / eta**2 + 0j)
    rs, rp = (cos_i - eta * cos_t) / (cos_i + eta * cos_t), (eta * cos_i - cos_t) / (eta * cos_i + cos_t)
    along, across = abs(rp) ** 2, abs(rs) ** 2
    assert found == pytest.approx([0.5 * (along + across), 0.5 * (along - across), 0, 0], abs=3e-5)


def test_glass_in_an_even_sky_cannot_be_seen_nor_polarises_it() -> None:
    ball = {"type": "sphere", "radius": 0.08, "bsdf": {"type": "dielectric", "int_ior": 1.5}}
    scene = seen_along_z({"ball": ball, **SKY}, 8)
    scene["integrator"]["inner"] = {"type": "path"}
    found, error = stokes_of(scene, spp=512)
    assert found[0] == pytest.approx(1, abs=1e-3)
    assert (np.abs(found[1:]) <= 4 * error[1:] + FLOAT32).all(), (found, error)


# ------------------------------ What it has in common with unpolarised light ------------------------------


def grey_room(integrator: dict[str, Any]) -> dict[str, Any]:
    """Diffuse grey surfaces in a grey sky, with a lamp."""
    grey = lambda value: {"type": "uniform", "value": value}  # noqa: E731
    camera = place().look_at(origin=[0, 1.5, 5], target=[0, 0.5, 0], up=[0, 1, 0])
    film = {"type": "hdrfilm", "width": 24, "height": 24, "filter": {"type": "gaussian"}}
    return {
        "type": "scene",
        "integrator": integrator,
        "sensor": {"type": "perspective", "fov": 45, "to_world": camera, "film": film},
        "floor": {
            "type": "rectangle",
            "to_world": place().rotate([1, 0, 0], -90).scale(4),
            "bsdf": {"type": "diffuse", "reflectance": grey(0.6)},
        },
        "ball": {"type": "sphere", "center": [0, 0.8, 0], "radius": 0.8, "bsdf": {"type": "diffuse"}},
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": [0.5, 0.5, 0.5]}},
        "lamp": {
            "type": "sphere",
            "center": [1.5, 2.5, 1],
            "radius": 0.2,
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [20, 20, 20]}},
        },
    }


@pytest.mark.parametrize("apart", [True, False], ids=["apart", "shared"])
def test_a_diffuse_room_has_the_intensity_of_the_unpolarised_kernel_and_nothing_else(apart: bool) -> None:
    path = {"type": "path", "max_depth": 5}
    target, settings = Target(spp=64), Settings(replicate_size=4, independent_pixels=apart, adaptive=False)
    plain = renderer.render(grey_room(path), target, settings)
    polarised = renderer.render(grey_room({"type": "stokes", "inner": path}), target, settings)
    assert plain.stokes is None
    assert polarised.stokes is not None
    assert not polarised.moments.stokes.any()
    assert not polarised.moments.stokes_m2.any()
    # The same paths: only the order of products differs.
    assert polarised.mean == pytest.approx(plain.mean, rel=1e-4)
    assert polarised.stderr == pytest.approx(plain.stderr, rel=1e-3, abs=1e-9, nan_ok=True)
    assert polarised.stokes[..., 0, :] == pytest.approx(polarised.mean)


def test_any_scene_is_polarised_by_asking_for_the_channel() -> None:
    path = {"type": "path", "max_depth": 5}
    asked = Settings(channels=("stokes",), replicate_size=4)
    estimate = renderer.render(grey_room(path), Target(spp=16), asked)
    assert estimate.stokes is not None
    loaded = renderer.load_scene(grey_room(path))
    assert not loaded.is_polarised
    again = renderer.render(loaded, Target(spp=16), asked)
    assert again.moments.mean.tobytes() == estimate.moments.mean.tobytes()
    assert not differences(estimate, (3, 20), replay(grey_room(path), settings_of(estimate), (3, 20), range(4)))


# ------------------------------ Refusals, extremes ------------------------------


def test_red_green_and_blue_alone_are_refused_with_the_way_out() -> None:
    with pytest.raises(SettingsError, match=r"colour is 'rgb'.*stokes.*spectral, mono or auto"):
        renderer.load_scene(seen_along_z({**filters({"type": "polarizer"}), **SKY}), settings=Settings(colour="rgb"))


def test_polarised_light_in_fog_is_refused() -> None:
    with pytest.raises(UnsupportedScene, match="media"):
        renderer.load_scene("fog", settings=Settings(channels=("stokes",)))


@pytest.mark.parametrize("radiance", [1e-20, 1e20])
def test_extreme_radiance_survives(radiance: float) -> None:
    sky = {"sky": {"type": "constant", "radiance": {"type": "uniform", "value": radiance}}}
    found, _ = stokes_of(seen_along_z({**filters({"type": "polarizer", "theta": 0.0}), **sky}))
    assert found / radiance == pytest.approx([0.5, 0.5, 0, 0], abs=10 * FLOAT32)


def test_samples_that_are_not_finite_are_counted_and_left_out() -> None:
    mirror = {"type": "conductor", "eta": 0.0, "k": 1.0, "specular_reflectance": {"type": "uniform", "value": 1e10}}
    estimate = renderer.render(seen_along_z({**reflected(40.0, mirror, 3e38)}), Target(spp=16))
    assert estimate.moments.invalid.sum() == 16
    assert estimate.health.status == "degraded"
    assert not estimate.moments.stokes.any()


@pytest.mark.parametrize("ior", [1.0, 1.0 + 1e-7, 1e3])
def test_any_index_of_refraction_is_finite(ior: float) -> None:
    ball = {"type": "sphere", "radius": 0.08, "bsdf": {"type": "dielectric", "int_ior": ior, "ext_ior": 1.0}}
    found, error = stokes_of(seen_along_z({"ball": ball, **SKY}, 4), spp=64)
    assert found[0] == pytest.approx(1, abs=0.05)
    assert np.isfinite(error).all()


# ------------------------------ Estimates that merge ------------------------------


def glossy_corner(size: int = 12) -> dict[str, Any]:
    """Metal and glass over a floor: all of S0 to S3 are there."""
    scene = grey_room({"type": "stokes", "inner": {"type": "path", "max_depth": 6}})
    scene["ball"]["bsdf"] = {"type": "roughconductor", "alpha": 0.3, **GREY_CONDUCTOR}
    scene["glass"] = {"type": "sphere", "center": [1.2, 0.4, 1.5], "radius": 0.4, "bsdf": {"type": "dielectric"}}
    scene["sensor"]["film"] |= {"width": size, "height": size}
    return scene


def test_parts_resumed_replayed_and_read_back_have_the_same_bits(tmp_path: Path) -> None:
    scene, settings = renderer.load_scene(glossy_corner()), Settings(replicate_size=4, adaptive=False)
    whole = renderer.render(scene, Target(spp=32), settings)
    assert np.abs(whole.moments.stokes).max(axis=0).min() > 0
    renderer.render(scene, Target(spp=16), settings).write(tmp_path / "half.exr")
    resumed = renderer.render(scene, Target(spp=32), settings, start=Estimate.read(tmp_path / "half.exr"))
    renderer.passes(scene, range(4, 8), settings).write(tmp_path / "late.exr")
    merged = merge(Estimate.read(tmp_path / "late.exr"), renderer.passes(scene, range(4), settings))
    for other in (resumed, merged):
        for name in ("count", "mean", "m2", "m3", "stokes", "stokes_m2"):
            assert getattr(other.moments, name).tobytes() == getattr(whole.moments, name).tobytes(), name
    assert not differences(whole, (6, 7), replay(scene, settings_of(whole), (6, 7), range(8)))
    other = renderer.render(scene, Target(spp=32), Settings(seed=1, replicate_size=4, adaptive=False))
    both = merge(whole, other).moments
    assert both.stokes == pytest.approx((whole.moments.stokes + other.moments.stokes) / 2, abs=1e-12)


def test_lanes_that_are_suspended_again_and_again_have_the_same_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    from renderer.equation import launch, path

    def launched() -> tuple[int, tuple[NDArray, ...]]:
        scene = renderer.load_scene(glossy_corner(8))
        kernel = scene.kernel(scene.resolved(Settings(), 4))
        begun, n = kernel.begin(np.arange(64, dtype=np.uint32), np.zeros(64, np.uint32), 1), 1
        while not begun.step():
            n += 1
        return n, begun.results()

    whole, calm = launched()
    monkeypatch.setattr(path, "SEGMENTS_PER_SAMPLE", 1)
    for name in ("FIRST_SEGMENTS", "LEAST_SEGMENTS", "MOST_SEGMENTS"):
        monkeypatch.setattr(launch, name, 3)
    parts, cut = launched()
    assert whole == 1
    assert parts > 2
    assert calm[0].shape == (12, 64)
    assert np.array_equal(calm[0], cut[0])
    assert np.array_equal(calm[1], cut[1])


def test_the_file_names_the_components_as_mitsuba_does_with_errors_beside_them(tmp_path: Path) -> None:
    import OpenImageIO as oiio

    estimate = renderer.render(glossy_corner(), Target(spp=32), Settings(replicate_size=4))
    estimate.write_picture(tmp_path / "picture.exr")
    source: Any = oiio.ImageInput.open(str(tmp_path / "picture.exr"))
    names, pixels = list(source.spec().channelnames), source.read_image(0, 0, 0, source.spec().nchannels, "float")
    source.close()
    assert estimate.stokes is not None
    assert estimate.stokes_stderr is not None
    values = np.stack([pixels[..., names.index(name)] for name in STOKES_CHANNELS], axis=-1)
    errors = np.stack([pixels[..., names.index(f"stderr.{name}")] for name in STOKES_CHANNELS], axis=-1)
    assert values.reshape(12, 12, 4, 3) == pytest.approx(estimate.stokes, rel=1e-6, abs=1e-12)
    known = np.isfinite(estimate.stokes_stderr)
    found = errors.reshape(12, 12, 4, 3)
    assert (found[~known] == np.inf).all()
    assert found[known] == pytest.approx(estimate.stokes_stderr[known], rel=2e-3, abs=1e-7)


def test_a_component_that_was_never_found_has_no_error_in_the_file(tmp_path: Path) -> None:
    """Circular light comes off the metal by way of two bounces alone: most pixels have met none of it."""
    import OpenImageIO as oiio

    estimate = renderer.render(glossy_corner(), Target(spp=8), Settings(replicate_size=4))
    estimate.write(tmp_path / "a.exr")
    source: Any = oiio.ImageInput.open(str(tmp_path / "a.exr"))
    names, pixels = list(source.spec().channelnames), source.read_image(0, 0, 0, source.spec().nchannels, "float")
    source.close()
    for name in STOKES_CHANNELS:
        value, error = (pixels[..., names.index(n)] for n in (name, f"stderr.{name}"))
        assert (error[value == 0] == np.inf).all(), name
        assert (error > 0).all(), name
    circular = pixels[..., names.index("stderr.S3.R")]
    assert 0 < np.isfinite(circular).mean() < 1  # it is found by some


def test_where_light_is_well_known_the_component_that_is_not_in_it_is_known_to_be_nothing() -> None:
    seen = seen_along_z({**filters({"type": "polarizer", "theta": 0.0}), **SKY}, size=9)
    estimate = renderer.render(seen, Target(spp=64))
    assert estimate.trust.all()
    assert estimate.stokes_stderr is not None
    assert (estimate.stokes_stderr[..., 3, :] == 0).all()


def test_the_readings_of_a_few_pixels_have_all_components() -> None:
    seen = seen_along_z({**filters({"type": "polarizer", "theta": 0.0}), **SKY})
    (few,) = readings.readings(renderer.render(seen, Target(spp=16), Settings(replicate_size=4))) or []
    assert (few["trusted"], few["half_width"]["S3.B"]) == (False, None)
    one = renderer.render(seen, Target(spp=64), Settings(replicate_size=4))
    (found,) = readings.readings(one) or []
    assert found["value"]["S1.G"] == pytest.approx(0.5, abs=10 * FLOAT32)
    assert (found["trusted"], found["half_width"]["S3.B"]) == (True, 0)
    assert "S1 0.5 ± " in readings.lines(one)[0]


# ------------------------------ What Mitsuba says ------------------------------


def by_mitsuba(scene: dict[str, Any], variant: str, spp: int, seeds: int) -> tuple[NDArray, NDArray]:
    """(H, W, 12) mean of S0 to S3 by Mitsuba's own `stokes`, and the variance of that mean, over runs."""
    from tests.statistical.test_colour_models import process_variant

    with process_variant(variant) as mi:
        loaded = mi.load_dict(scene)
        runs = np.array([np.array(mi.render(loaded, spp=spp, seed=seed))[..., -12:] for seed in range(seeds)])
    return runs.mean(axis=0, dtype=np.float64), runs.var(axis=0, ddof=1, dtype=np.float64) / seeds


def assert_agree(ours: Estimate, mean: NDArray, variance: NDArray) -> None:
    """By the Z-test: the image's mean, and each pixel, of each of S0 to S3."""
    assert ours.stokes is not None
    h, w = mean.shape[:2]
    off = ours.stokes.reshape(h, w, 12) - mean
    spread = stokes_variance(ours).reshape(h, w, 12) + variance
    whole = off.mean(axis=(0, 1)) / np.sqrt(spread.mean(axis=(0, 1)) / (h * w))
    assert np.abs(whole).max() < z_limit(12), whole
    floor = 1e-6 * float(mean[..., 0].mean()) ** 2
    z = off / np.sqrt(spread + floor)
    # Variances of few runs have heavy tails: a share of pixels, as Mitsuba's own render tests allow.
    assert (np.abs(z) < 4).mean(axis=(0, 1)).min() > 0.985, (np.abs(z) < 4).mean(axis=(0, 1))


def test_metal_and_glass_agree_with_mitsuba() -> None:
    scene = glossy_corner(16)
    scene["sensor"]["film"]["filter"] = {"type": "box"}
    mean, variance = by_mitsuba(scene, "llvm_ad_mono_polarized", 256, 8)
    ours = renderer.render(scene, Target(spp=1024), Settings(replicate_size=16, adaptive=False))
    assert_agree(ours, mean, variance)


@pytest.mark.slow
def test_coloured_metal_plastic_and_filters_agree_with_mitsuba() -> None:
    scene = glossy_corner(24)
    scene["sensor"]["film"]["filter"] = {"type": "box"}
    gold = {"type": "conductor", "material": "Au"}
    red = {"type": "rgb", "value": [0.7, 0.2, 0.1]}
    scene["ball"]["bsdf"] = {"type": "pplastic", "diffuse_reflectance": red, "alpha": 0.15}
    scene["mirror"] = {"type": "sphere", "center": [-1.4, 0.5, 1.2], "radius": 0.5, "bsdf": gold}
    wave = {"type": "retarder", "theta": 30.0, "delta": 70.0}
    for i, (x, bsdf) in enumerate([(-0.6, wave), (0.6, {"type": "polarizer", "theta": 25.0})]):
        at = place().translate([x, 0.7, 2.5]).scale(0.4)
        scene[f"filter{i}"] = {"type": "rectangle", "to_world": at, "bsdf": bsdf}
    mean, variance = by_mitsuba(scene, "llvm_ad_spectral_polarized", 1024, 16)
    ours = renderer.render(scene, Target(spp=8192), Settings(seed=11, adaptive=False))
    assert ours.identity.settings["colour"] == "spectral"
    assert_agree(ours, mean, variance)


SHARED = Path(__file__).resolve().parents[3] / "shared" / "scenes" / "cbox-polarized" / "scene.xml"


@pytest.mark.slow
@pytest.mark.oracle
@pytest.mark.skipif(not SHARED.is_file(), reason="there is no folder of shared scenes beside the checkout")
@pytest.mark.parametrize("colour", ["mono", "spectral"])
def test_the_shared_room_agrees_with_mitsuba(colour: str, tmp_path: Path) -> None:
    from tests.statistical.test_colour_models import process_variant

    path = tmp_path / "scene.xml"
    path.write_text(SHARED.read_text().replace('type="gaussian"', 'type="box"'))
    (tmp_path / "meshes").symlink_to(SHARED.parent / "meshes")
    with process_variant(f"llvm_ad_{colour}_polarized") as mi:
        loaded = mi.load_file(str(path), res=48)
        runs = np.array([np.array(mi.render(loaded, spp=512, seed=seed))[..., -12:] for seed in range(16)])
    mean, variance = runs.mean(axis=0, dtype=np.float64), runs.var(axis=0, ddof=1, dtype=np.float64) / len(runs)
    ours = renderer.render(path, Target(spp=4096), Settings(width=48, height=48, colour=colour, seed=3))
    assert_agree(ours, mean, variance)
