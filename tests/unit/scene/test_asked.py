"""What a scene asks for beside radiance: alpha by its film, depth and others by its integrator. Given, or said."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest

import renderer
from renderer.backend import mitsuba, using
from renderer.errors import UnsupportedScene
from renderer.settings import Settings, Target

REPORTS = Path(__file__).resolve().parents[4] / "shared" / "reports"
needs_reports = pytest.mark.skipif(not REPORTS.is_dir(), reason="the public reports are not here")
MASK = {"type": "mask", "opacity": 0.3, "inner": {"type": "diffuse"}}
BALL = {"type": "sphere", "radius": 0.6}
LAMP = {"type": "sphere", "center": [0.3, 0.2, 1], "radius": 0.3, "emitter": {"type": "area"}}
SKY = {"type": "constant"}


def scene(pixel_format: str = "rgba", hides: bool = False, integrator: Any = None, **parts: Any) -> dict[str, Any]:
    mi = mitsuba()
    film = {"type": "hdrfilm", "width": 32, "height": 32, "pixel_format": pixel_format, "rfilter": {"type": "box"}}
    to_world = mi.ScalarTransform4f().look_at([0, 0, 4], [0, 0, 0], [0, 1, 0])
    sensor = {"type": "perspective", "fov": 30, "to_world": to_world, "film": film}
    asked = integrator or {"type": "path", "hide_emitters": hides, "max_depth": 8}
    return {"type": "scene", "integrator": asked, "sensor": sensor, **parts}


@pytest.mark.parametrize("hides", [False, True])
@pytest.mark.parametrize(
    "parts",
    [
        {"ball": BALL, "sky": SKY},
        {"ball": BALL, "lamp": {"type": "point", "position": [0, 2, 2]}},
        {"leaf": BALL | {"bsdf": MASK}, "lamp": LAMP},
        {"leaf": BALL | {"bsdf": MASK}, "sky": SKY},
        {"ball": BALL, "lamp": LAMP},
        {"glass": BALL | {"bsdf": {"type": "thindielectric"}}, "lamp": {"type": "point", "position": [0, 2, 2]}},
    ],
    ids=["sky", "point", "mask-lamp", "mask-sky", "lamp", "thin-glass"],
)
def test_alpha_is_that_of_mitsubas_path(parts: dict[str, Any], hides: bool) -> None:
    """Both estimate it by samples; means of 1024 pixels differ by less than 1 % of the image."""
    if hides and "leaf" in parts and "lamp" in parts:
        pytest.skip("Mitsuba 3.9.1 calls a mask opaque where a hidden lamp lies before it; we say what passes it")
    source = scene(hides=hides, **parts)
    found = renderer.render(source, Target(spp=2)).channels["alpha"]
    mi = mitsuba()
    with using("llvm_ad_rgb" if "llvm" in mi.variant() else "cuda_ad_rgb"):
        right = np.array(mitsuba().render(mitsuba().load_dict(source), spp=64, seed=1))
    assert found.shape == (32, 32, 1)
    assert found.mean() == pytest.approx(right[..., 3].mean(), abs=0.01)
    assert np.abs(found[..., 0] - right[..., 3]).mean() < 0.12  # sixteen samples of one half: 0.1


@pytest.mark.parametrize("size", [1, 2, 16])
def test_channels_have_sixteen_samples_whatever_the_size_of_replicates(size: int) -> None:
    """With replicates of one sample, the sixteen were one and the same: alpha behind a mask was 0 or 1."""
    source = scene(hides=True, leaf=BALL | {"bsdf": MASK}, sky=SKY)
    alpha = renderer.render(source, Target(spp=16), Settings(replicate_size=size)).channels["alpha"][14:18, 14:18, 0]
    assert alpha.min() > 0.2  # both sides of the ball: 1 − 0.7² = 0.51
    assert alpha.max() < 0.8


def test_alpha_is_the_channel_a_of_both_files_and_of_a_png(tmp_path: Path) -> None:
    estimate = renderer.render(scene(ball=BALL, lamp={"type": "point", "position": [0, 2, 2]}), Target(spp=4))
    estimate.write(tmp_path / "all.exr")
    estimate.write_picture(tmp_path / "small.exr")
    for name in ("all.exr", "small.exr"):
        image = oiio.ImageBuf(str(tmp_path / name))
        pixels = image.get_pixels()
        assert pixels is not None
        assert np.array_equal(pixels[..., image.spec().channelnames.index("A")], estimate.channels["alpha"][..., 0])
    again = renderer.Estimate.read(tmp_path / "all.exr")
    assert np.array_equal(again.channels["alpha"], estimate.channels["alpha"])
    picture = estimate.picture()
    assert picture.shape == (32, 32, 4)
    assert (picture[0, 0, 3], picture[16, 16, 3]) == (0, 255)


def test_films_without_alpha_have_none_and_those_who_ask_get_it() -> None:
    for pixel_format in ("rgb", "luminance"):
        assert renderer.render(scene(pixel_format, ball=BALL), Target(spp=1)).channels == {}
    asked = renderer.render(scene("rgb", ball=BALL), Target(spp=1), Settings(channels=("alpha",)))
    assert 0.05 < asked.channels["alpha"].mean() < 0.6


@pytest.mark.parametrize(
    ("integrator", "channels", "said"),
    [
        ({"type": "depth"}, {"depth"}, "integrator 'depth': distances are in the channel 'depth'"),
        (
            {"type": "aov", "aovs": "dd:depth, n:sh_normal,u:uv", "inner": {"type": "path", "max_depth": 3}},
            {"depth", "normal"},
            "'dd' is the channel 'depth', 'n' is the channel 'normal'; not available: u:uv",
        ),
        ({"type": "aov", "aovs": "x:dp_du"}, set(), "no channel is given; not available: x:dp_du"),
        ({"type": "moment", "inner": {"type": "path"}}, set(), "standard errors are in stderr.R"),
        ({"type": "path"}, set(), None),
        ({"type": "prb", "max_depth": 3}, set(), None),
        ({"type": "ptracer"}, set(), None),
    ],
)
def test_integrators_that_ask_for_more_get_it_or_are_told(
    integrator: dict[str, Any], channels: set[str], said: str | None
) -> None:
    """`depth` and `aov` gave radiance in silence; `prb` was taken in XML and refused in a dictionary."""
    loaded = renderer.load_scene(scene("rgb", integrator=integrator, ball=BALL, sky=SKY))
    assert set(loaded.requirements.channels) == channels
    told = [warning for warning in loaded.warnings if warning.startswith("integrator")]
    assert (len(told) == 1 and said in told[0]) if said else not told
    assert set(renderer.render(loaded, Target(spp=1)).channels) == channels
    if "max_depth" in str(integrator):
        assert loaded.requirements.max_depth == 3


def test_radiance_fields_are_refused_by_name(tmp_path: Path) -> None:
    for source in (scene(integrator={"type": "volprim_rf_basic"}, ball=BALL), tmp_path / "a.xml"):
        (tmp_path / "a.xml").write_text(
            '<scene version="3.0.0"><integrator type="volprim_rf_basic"/><sensor type="perspective"/></scene>'
        )
        with pytest.raises(UnsupportedScene, match=r"radiance fields are not supported.*volprim_rf_basic"):
            renderer.load_scene(source)


@needs_reports
def test_the_public_reports_get_what_they_ask_for() -> None:
    alpha = renderer.render(REPORTS / "alpha" / "rgba.xml", Target(spp=4)).channels["alpha"]
    assert alpha.mean() == pytest.approx(0.0684, abs=0.002)
    depth = renderer.render(REPORTS / "other-integrators" / "depth.xml", Target(spp=4)).channels["depth"]
    assert depth.max() > 3
    albedo = renderer.render(REPORTS / "other-integrators" / "aovalbedo.xml", Target(spp=4)).channels["albedo"]
    assert albedo.max() == pytest.approx(0.5, abs=0.01)
