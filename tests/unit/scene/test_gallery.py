"""Facts about the built-in scenes: they load, they are lit, they show what they promise."""

from __future__ import annotations

import re
import struct
import subprocess
import sys
import zlib
from typing import Any

import numpy as np
import pytest

from renderer.errors import SceneError
from renderer.scene.gallery import GalleryScene, find, furnace, indexed_png, list_scenes

THUMBNAIL_WIDTH = 256
LARGEST_THUMBNAIL_BYTES = 60_000
every_scene = pytest.mark.parametrize("entry", list_scenes(), ids=lambda entry: entry.name)


def read_indexed_png(data: bytes) -> np.ndarray:
    """Decode what `indexed_png.encode` writes; (H, W, 3) uint8. Every chunk's checksum is verified."""
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    chunks: dict[bytes, bytes] = {}
    at = 8
    while at < len(data):
        (length,) = struct.unpack_from(">I", data, at)
        kind, body = data[at + 4 : at + 8], data[at + 8 : at + 8 + length]
        assert struct.unpack_from(">I", data, at + 8 + length) == (zlib.crc32(kind + body),)
        chunks[kind] = chunks.get(kind, b"") + body
        at += 12 + length
    width, height, *form = struct.unpack(">IIBBBBB", chunks[b"IHDR"])
    assert form == [8, 3, 0, 0, 0]
    rows = np.frombuffer(zlib.decompress(chunks[b"IDAT"]), np.uint8).reshape(height, width + 1)
    assert not rows[:, 0].any()
    return np.frombuffer(chunks[b"PLTE"], np.uint8).reshape(-1, 3)[rows[:, 1:]]


def small(entry: GalleryScene, width: int = 32) -> dict[str, Any]:
    """The scene with a film `width` pixels wide."""
    scene = entry.build()
    scene["sensor"]["film"] |= {"width": width, "height": round(width * entry.height / entry.width)}
    return scene


def test_the_gallery_holds_eight_scenes_of_different_names() -> None:
    names = [entry.name for entry in list_scenes()]
    assert len(set(names)) == len(names) >= 8
    assert all(re.fullmatch(r"[a-z]+(-[a-z]+)*", name) for name in names)
    assert names[0] == "cornell-box"


def test_an_unknown_name_is_refused_with_the_known_ones() -> None:
    with pytest.raises(SceneError, match=r"teapot.*cornell-box.*furnace"):
        find("teapot")


def test_listing_the_gallery_does_not_import_mitsuba() -> None:
    code = "import sys, renderer.scene.gallery as g; g.list_scenes(); sys.exit('mitsuba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@every_scene
def test_a_scene_is_found_by_its_name(entry: GalleryScene) -> None:
    assert find(entry.name) is entry


@every_scene
def test_a_scene_says_in_one_sentence_what_it_teaches(entry: GalleryScene) -> None:
    assert entry.title
    assert entry.teaches.endswith(".")
    assert ". " not in entry.teaches


@every_scene
def test_a_scene_has_the_film_and_depth_it_states(entry: GalleryScene) -> None:
    scene = entry.build()
    film = scene["sensor"]["film"]
    assert (film["width"], film["height"]) == (entry.width, entry.height)
    assert film["rfilter"]["type"] in ("box", "gaussian")
    assert scene["integrator"]["type"] in ("path", "volpath")
    assert scene["integrator"]["max_depth"] >= 2


@every_scene
def test_building_twice_shares_nothing(entry: GalleryScene) -> None:
    first, second = entry.build(), entry.build()
    assert first.keys() == second.keys()
    first["sensor"]["film"]["width"] = 1
    assert second["sensor"]["film"]["width"] == entry.width == entry.build()["sensor"]["film"]["width"]


@every_scene
def test_a_scene_loads_and_is_lit_all_over(entry: GalleryScene) -> None:
    from renderer.backend import mitsuba

    mi = mitsuba()
    scene = mi.load_dict(small(entry))
    assert len(scene.emitters()) >= 1
    image = np.array(mi.render(scene, spp=64, seed=1))
    assert np.isfinite(image).all()
    assert (image >= 0).all()
    luminance = image @ [0.2126, 0.7152, 0.0722]
    # Exposure 0 suits: mid-tones in range, most pixels not clipped, few pixels black.
    assert 0.05 < np.median(luminance) < 0.8
    assert np.mean(luminance > 1.0) < 0.2
    assert np.mean(luminance < 0.005) < 0.02


@every_scene
def test_a_thumbnail_is_shipped_and_shows_the_scene(entry: GalleryScene) -> None:
    data = entry.thumbnail.read_bytes()
    assert len(data) <= LARGEST_THUMBNAIL_BYTES
    image = read_indexed_png(data).astype(float)
    assert image.shape == (round(THUMBNAIL_WIDTH * entry.height / entry.width), THUMBNAIL_WIDTH, 3)
    assert 40.0 < image.mean() < 220.0
    if entry is not furnace.SCENE:  # which is one even colour
        assert image.std(axis=(0, 1)).min() > 15.0


def test_the_thumbnail_of_the_furnace_has_the_colour_of_the_known_answer() -> None:
    linear = np.array(furnace.expected_radiance(furnace.MAX_DEPTH))
    srgb = 255.0 * (1.055 * linear ** (1 / 2.4) - 0.055)
    image = read_indexed_png(furnace.SCENE.thumbnail.read_bytes()).astype(float)
    assert image.mean(axis=(0, 1)) == pytest.approx(srgb, abs=1.0)
    assert image.std(axis=(0, 1)).max() < 4.0


def test_the_camera_in_the_furnace_sees_the_truncated_neumann_series() -> None:
    for max_depth in (0, 1, 2, 7):
        series = np.zeros(3)
        for bounces in range(max_depth):
            series += np.array(furnace.EMITTED) * np.array(furnace.ALBEDO) ** bounces
        assert furnace.expected_radiance(max_depth) == pytest.approx(tuple(series), rel=1e-12)
    closed_form = np.array(furnace.EMITTED) / (1.0 - np.array(furnace.ALBEDO))
    assert furnace.expected_radiance(400) == pytest.approx(tuple(closed_form), rel=1e-12)


@pytest.mark.parametrize("max_depth", [1, 2, 5])
def test_the_furnace_renders_to_its_series_within_four_standard_errors(max_depth: int) -> None:
    from renderer.backend import mitsuba

    mi = mitsuba()
    integrator = mi.load_dict({"type": "path", "max_depth": max_depth, "rr_depth": 1000})
    image = np.array(mi.render(mi.load_dict(small(furnace.SCENE)), integrator=integrator, spp=256, seed=7), np.float64)
    pixels = image.reshape(-1, 3)
    standard_error = pixels.std(axis=0, ddof=1) / np.sqrt(len(pixels)) + 1e-6
    assert (np.abs(pixels.mean(axis=0) - furnace.expected_radiance(max_depth)) < 4.0 * standard_error).all()


def test_an_image_of_few_colours_survives_the_indexed_png_exactly() -> None:
    image = np.zeros((9, 13, 3), np.uint8)
    image[:4, :5] = (250, 10, 30)
    image[5:, 7:] = (0, 0, 255)
    image[2, 3] = (1, 2, 3)
    assert (read_indexed_png(indexed_png.encode(image)) == image).all()


def test_a_smooth_image_is_close_in_the_indexed_png() -> None:
    y, x = np.mgrid[0:64, 0:64]
    image = np.stack([x * 4, y * 4, 255 - x * 2 - y * 2], axis=-1).astype(np.uint8)
    error = read_indexed_png(indexed_png.encode(image)).astype(float) - image
    assert np.sqrt(np.mean(error**2)) < 6.0
