"""Facts about the kernel for scenes with media: its lanes, whatever cuts them into pieces, and what it sees."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import renderer
from renderer.backend import mitsuba
from renderer.equation import launch, media, volume_path
from renderer.scene.compile import Scene

SIZE = 8


def cloud(kind: str, **more: Any) -> dict[str, Any]:
    """A white cloud on a floor under a lamp and a sky, seen through a filter that shares samples."""
    mi = mitsuba()
    medium: dict[str, Any] = {"type": "homogeneous", "sigma_t": 4.0, "albedo": 1.0}
    if kind != "even":
        data = mi.VolumeGrid(np.random.default_rng(1).random((4, 4, 4)).astype(np.float32))
        to_world = mi.ScalarTransform4f().translate([-1, -1, -1]).scale(2.0)
        volume = {"type": "gridvolume", "grid": data, "to_world": to_world}
        medium = {"type": "heterogeneous", "sigma_t": volume, "albedo": 1.0, "scale": 8.0}
    border: dict[str, Any] = {"type": "null"}
    if kind == "masked":
        border = {"type": "mask", "opacity": 0.3, "inner": {"type": "twosided", "bsdf": {"type": "diffuse"}}}
    floor = mi.ScalarTransform4f().translate([0, -1.2, 0]).rotate([1, 0, 0], -90).scale(3.0)
    look = mi.ScalarTransform4f().look_at([0, 1, 5], [0, 0, 0], [0, 1, 0])
    film = {"type": "hdrfilm", "width": 12, "height": 12, "filter": {"type": "gaussian"}}
    return {
        "type": "scene",
        "sensor": {"type": "perspective", "to_world": look, "film": film},
        "cloud": {"type": "cube", "bsdf": border, "interior": medium},
        "floor": {"type": "rectangle", "to_world": floor, "bsdf": {"type": "diffuse"}},
        "lamp": {"type": "point", "position": [0.5, 2.5, 0.5], "intensity": 5.0},
        "sky": {"type": "constant", "radiance": 0.5},
        **more,
    }


def lanes(scene: Scene, settings: renderer.Settings) -> tuple[int, tuple[np.ndarray, ...]]:
    """Launches that one replicate of every pixel took, and what it came to."""
    kernel = scene.kernel(scene.resolved(settings, SIZE))
    pixels = np.arange(scene.width * scene.height, dtype=np.uint32)
    begun, n = kernel.begin(pixels, np.zeros_like(pixels), 1), 1
    while not begun.step():
        n += 1
    return n, begun.results()


@pytest.mark.parametrize("kind", ["even", "grid", "masked"])
@pytest.mark.parametrize("colour", ["mono", "spectral"])
def test_lanes_in_media_that_are_suspended_again_and_again_have_the_same_bits(
    kind: str, colour: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = renderer.Settings(colour=colour)
    _, calm = lanes(renderer.load_scene(cloud(kind), settings=settings), settings)
    monkeypatch.setattr(volume_path, "SEGMENTS_PER_SAMPLE", 1)
    monkeypatch.setattr(launch, "FIRST_SEGMENTS", 3)
    monkeypatch.setattr(launch, "LEAST_SEGMENTS", 3)
    monkeypatch.setattr(launch, "MOST_SEGMENTS", 5)
    parts, cut = lanes(renderer.load_scene(cloud(kind), settings=settings), settings)
    assert parts > 3
    assert np.array_equal(calm[0], cut[0])
    assert np.array_equal(calm[1], cut[1])


def test_no_launch_is_longer_than_its_segments_however_dense_a_grid(monkeypatch: pytest.MonkeyPatch) -> None:
    """One hot voxel makes a majorant of 10,000 tentative collisions in thin air."""
    mi = mitsuba()
    values = np.full((32, 32, 32), 1e-5, np.float32)
    values[0, 0, 0] = 1
    to_world = mi.ScalarTransform4f().translate([-1, -1, -1]).scale(2.0)
    volume = {"type": "gridvolume", "grid": mi.VolumeGrid(values), "to_world": to_world}
    medium = {"type": "heterogeneous", "sigma_t": volume, "albedo": 1.0, "scale": 1e4}
    scene = renderer.load_scene(cloud("grid", cloud={"type": "cube", "bsdf": {"type": "null"}, "interior": medium}))
    kernel = scene.kernel(scene.resolved(renderer.Settings(independent_pixels=True), SIZE))
    pixels = np.arange(144, dtype=np.uint32)
    begun = kernel.begin(pixels, np.zeros_like(pixels), 1)
    shadow = 2 * media.LONG_WALK * 16  # of shadow rays in one turn, at odds of 2^-16
    for turn in range(2):
        begun.step()
        assert begun._long is not None  # type: ignore[union-attr]
        now = np.array(begun._long._state[-2])  # type: ignore[union-attr]
        before = SIZE * volume_path.SEGMENTS_PER_SAMPLE + launch.MOST_SEGMENTS * turn
        assert now.max() <= before + media.STEPS + shadow


@pytest.mark.parametrize("kind", ["even", "grid"])
def test_passes_in_media_are_recorded(kind: str) -> None:
    settings = renderer.Settings(width=8, height=8, replicate_size=4)
    scene = renderer.load_scene(cloud(kind), settings=settings)
    kernel = scene.kernel(scene.resolved(settings, 4))
    pixels = np.arange(64, dtype=np.uint32)
    found = []
    for turn in range(8):
        np.array(kernel.launch(pixels, np.full_like(pixels, turn), 1)[0])
        assert kernel.is_recorded, "its passes are traced one by one"
        found.append(kernel._replayed.n_recordings)
    # A scene of another test that goes away in between makes a recording anew; most passes replay one.
    assert found[-1] <= found[0] + 3, f"recordings after each pass: {found}"


def test_a_point_light_is_seen_through_the_border_of_a_cloud() -> None:
    scene = renderer.load_scene(cloud("even"))
    assert scene.cannot_see(scene.resolved(renderer.Settings(), SIZE)) == ()


@pytest.mark.parametrize(("sigma_t", "alpha"), [(0.0, 0.0), (0.5, 1 - np.exp(-1.0)), (1e6, 1.0)])
def test_alpha_of_a_cloud_is_what_does_not_pass_it_straight(sigma_t: float, alpha: float) -> None:
    mi = mitsuba()
    look = mi.ScalarTransform4f().look_at([0, 0, 4], [0, 0, 0], [0, 1, 0])
    film = {"type": "hdrfilm", "width": 2, "height": 2, "filter": {"type": "box"}}
    medium = {"type": "homogeneous", "sigma_t": sigma_t, "albedo": 0.5}
    contents = {
        "type": "scene",
        "sensor": {"type": "perspective", "fov": 0.1, "to_world": look, "film": film},
        "cloud": {"type": "cube", "bsdf": {"type": "null"}, "interior": medium},
        "lamp": {"type": "point"},
    }
    scene = renderer.load_scene(contents)
    found = scene.channels(scene.resolved(renderer.Settings(), SIZE), ("alpha",))
    np.testing.assert_allclose(found["alpha"], alpha, rtol=1e-4)
