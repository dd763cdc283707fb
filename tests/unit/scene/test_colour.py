"""Facts about colour: a scene counts as colourless only where one channel says all that three would."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from renderer.backend import mitsuba
from renderer.errors import SettingsError
from renderer.progress import render
from renderer.scene.compile import load_scene
from renderer.scene.requirements import Requirements, measure
from renderer.scene.source import parse
from renderer.settings import Settings, Target
from tests.files import write_png

GREY = {"type": "rgb", "value": [0.3, 0.3, 0.3]}
RED = {"type": "rgb", "value": [0.3, 0.2, 0.2]}


def scene(bsdf: dict[str, Any] | None = None, light: dict[str, Any] | None = None) -> dict[str, Any]:
    return {
        "type": "scene",
        "sensor": {
            "type": "perspective",
            "to_world": mitsuba().ScalarTransform4f().look_at([0, 0, -4], [0, 0, 0], [0, 1, 0]),
            "film": {"type": "hdrfilm", "width": 8, "height": 8},
        },
        "ball": {"type": "sphere", "bsdf": bsdf or {"type": "diffuse", "reflectance": GREY}},
        "light": light or {"type": "constant", "radiance": {"type": "rgb", "value": 1.0}},
    }


def measured(**changes: Any) -> Requirements:
    return measure(parse(scene(**changes)))


COLOURLESS = [
    {},
    {"bsdf": {"type": "diffuse", "reflectance": 0.4}},
    {"bsdf": {"type": "diffuse"}},
    {"bsdf": {"type": "dielectric"}},
    {"bsdf": {"type": "conductor"}},
    {"bsdf": {"type": "roughconductor", "eta": 0.3, "k": 3.0}},
    {"bsdf": {"type": "diffuse", "reflectance": {"type": "spectrum", "value": 0.4}}},
    {"light": {"type": "constant"}},
    {"light": {"type": "point", "intensity": 3.0}},
    {"light": {"type": "constant", "radiance": {"type": "d65", "scale": 2.0}}},
]
COLOURED = [
    ({"bsdf": {"type": "diffuse", "reflectance": RED}}, "diffuse reflectance"),
    ({"bsdf": {"type": "conductor", "material": "Au"}}, "conductor material"),
    ({"bsdf": {"type": "twosided", "inner": {"type": "diffuse", "reflectance": RED}}}, "diffuse reflectance"),
    ({"bsdf": {"type": "diffuse", "reflectance": {"type": "checkerboard", "color0": RED}}}, "checkerboard color0"),
    (
        {"bsdf": {"type": "diffuse", "reflectance": {"type": "spectrum", "value": [(400, 0.1), (700, 0.2)]}}},
        "diffuse reflectance",
    ),
    # Equal values over a part of the range, or at its two ends alone: nothing is known beyond them.
    (
        {"bsdf": {"type": "diffuse", "reflectance": {"type": "spectrum", "value": [(500, 0.8), (600, 0.8)]}}},
        "diffuse reflectance",
    ),
    (
        {
            "bsdf": {
                "type": "roughconductor",
                "specular_reflectance": {"type": "spectrum", "value": [(600, 1), (700, 1)]},
            }
        },
        "roughconductor specular_reflectance",
    ),
    ({"bsdf": {"type": "principled", "base_color": RED}}, "principled base_color"),
    ({"light": {"type": "constant", "radiance": RED}}, "constant radiance"),
    ({"light": {"type": "constant", "radiance": {"type": "spectrum", "value": 1.0}}}, "constant radiance"),
    ({"light": {"type": "sunsky"}}, "sunsky"),
]


@pytest.mark.parametrize("changes", COLOURLESS, ids=str)
def test_a_scene_of_greys_needs_one_channel_and_renders_grey(changes: dict[str, Any]) -> None:
    found = measured(**changes)
    assert (found.is_coloured, found.coloured_by, found.variant) == (False, None, "mono")
    image = render(load_scene(scene(**changes)), Target(spp=16), Settings(seed=1)).mean
    assert np.allclose(image, image[..., :1], rtol=1e-5)


@pytest.mark.parametrize(("changes", "named"), COLOURED, ids=str)
def test_what_is_coloured_is_named(changes: dict[str, Any], named: str) -> None:
    found = measured(**changes)
    assert (found.is_coloured, found.coloured_by, found.variant) == (True, named, "rgb")


BY_WAVELENGTH: dict[str, dict[str, Any]] = {
    "blackbody": {"type": "blackbody", "temperature": 3000.0},
    "irregular": {"type": "irregular", "wavelengths": "400, 500, 600, 700", "values": "0.2, 0.3, 0.9, 0.5"},
    "regular": {"type": "regular", "wavelength_min": 400.0, "wavelength_max": 700.0, "values": "0.2, 0.3, 0.9"},
}


@pytest.mark.parametrize("name", BY_WAVELENGTH)
def test_a_light_known_by_wavelengths_alone_is_rendered_by_wavelengths(name: str) -> None:
    """Mitsuba's rgb variants cannot be asked for it: a RuntimeError while the kernel was traced."""
    description = scene(light={"type": "constant", "radiance": BY_WAVELENGTH[name]})
    needs = measure(parse(description))
    assert (needs.variant, needs.spectral_by) == ("spectral", name)
    auto, asked = (render(load_scene(description, settings=s), Target(spp=16), s).mean for s in SPECTRAL)
    assert np.array_equal(auto, asked)
    assert np.ptp(auto.mean(axis=(0, 1))) > 0.05 * auto.mean()


SPECTRAL = (Settings(seed=1), Settings(seed=1, colour="spectral"))


@pytest.mark.parametrize("colour", ["mono", "rgb"])
def test_a_spectrum_by_wavelengths_is_refused_by_name_without_them(colour: Any) -> None:
    description = scene(bsdf={"type": "diffuse", "reflectance": BY_WAVELENGTH["irregular"]})
    with pytest.raises(SettingsError, match=f"{colour}.*irregular.*spectral or auto"):
        load_scene(description, settings=Settings(colour=colour))


def test_a_spectrum_of_equal_values_over_a_part_of_the_range_is_a_colour_in_the_picture() -> None:
    """Taken for grey it was 0.932 in all channels; Mitsuba's path says 0.851, 0.968 and 0.821."""
    reflectance = {"type": "spectrum", "value": [(500, 0.8), (600, 0.8)]}
    found = load_scene(scene(bsdf={"type": "diffuse", "reflectance": reflectance}))
    image = render(found, Target(spp=16), Settings(seed=1)).mean[4, 4]
    assert image[1] > 2 * image[0] > 2 * image[2]


@pytest.mark.parametrize(("picture", "is_coloured"), [((9, 9, 9), False), ((255, 255, 255), False), ((9, 9, 60), True)])
def test_a_picture_is_coloured_if_one_pixel_is(
    tmp_path: Path, picture: tuple[int, int, int], is_coloured: bool
) -> None:
    pixels = np.full((100, 70, 3), 100, np.uint8)
    pixels[99, 69] = picture
    write_png(str(tmp_path / "t.png"), pixels)
    texture = {"type": "bitmap", "filename": str(tmp_path / "t.png")}
    found = measured(bsdf={"type": "diffuse", "reflectance": texture})
    assert found.coloured_by == ("t.png" if is_coloured else None)


def test_a_texture_of_bumps_that_is_a_colour_too_is_a_colour(tmp_path: Path) -> None:
    write_png(str(tmp_path / "t.png"), np.full((2, 2, 3), (250, 10, 10), np.uint8))
    texture = {"type": "bitmap", "filename": str(tmp_path / "t.png"), "id": "t"}
    shared = {"type": "ref", "id": "t"}
    bsdf = {"type": "bumpmap", "arbitrary": texture, "bsdf": {"type": "diffuse", "reflectance": shared}}
    assert measured(bsdf=bsdf).coloured_by == "t.png"


def test_a_normal_map_is_no_colour(tmp_path: Path) -> None:
    write_png(str(tmp_path / "n.png"), np.full((2, 2, 3), (128, 128, 255), np.uint8))
    normals = {"type": "bitmap", "filename": str(tmp_path / "n.png"), "raw": True}
    bsdf = {"type": "normalmap", "normalmap": normals, "bsdf": {"type": "diffuse", "reflectance": GREY}}
    assert not measured(bsdf=bsdf).is_coloured
