"""Facts about passes whose paths are long: each kernel launch is bounded, and no bit depends on it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import renderer
from renderer import progress
from renderer.backend import mitsuba
from renderer.equation import launch, path
from renderer.scene.compile import Scene

SHARED = Path(__file__).resolve().parents[4] / "shared" / "scenes"
SIZE = 8


def white_room(depth: int) -> dict[str, Any]:
    """A closed room that absorbs nothing, seen from inside, with a point light."""
    white = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 1.0}}
    film = {"type": "hdrfilm", "width": 16, "height": 16}
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": depth},
        "sensor": {"type": "perspective", "film": film},
        "room": {"type": "cube", "flip_normals": True, "bsdf": white},
        "lamp": {"type": "point", "position": [0.3, 0.2, -0.4], "intensity": 1.0},
    }


def lanes(scene: Scene, settings: renderer.Settings) -> tuple[int, tuple[np.ndarray, ...]]:
    """Launches that one replicate of every pixel took, and what it came to."""
    kernel = scene.kernel(scene.resolved(settings, SIZE))
    pixels = np.arange(scene.width * scene.height, dtype=np.uint32)
    begun, n = kernel.begin(pixels, np.zeros_like(pixels), 1), 1
    while not begun.step():
        n += 1
    return n, begun.results()


@pytest.mark.parametrize(
    ("name", "colour"),
    [("cornell-box", "rgb"), ("cornell-box", "spectral"), ("furnace", "auto"), ("glass-sky", "auto"), ("gap", "auto")],
)
def test_lanes_that_are_suspended_again_and_again_have_the_same_bits(
    name: str, colour: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = renderer.Settings(width=16, height=16, colour=colour)  # type: ignore[arg-type]
    whole, calm = lanes(renderer.load_scene(name, settings=settings), settings)
    monkeypatch.setattr(path, "SEGMENTS_PER_SAMPLE", 1)
    monkeypatch.setattr(launch, "FIRST_SEGMENTS", 3)
    monkeypatch.setattr(launch, "LEAST_SEGMENTS", 3)
    monkeypatch.setattr(launch, "MOST_SEGMENTS", 5)
    parts, cut = lanes(renderer.load_scene(name, settings=settings), settings)
    assert whole == 1
    assert parts > 3
    assert np.array_equal(calm[0], cut[0])
    assert np.array_equal(calm[1], cut[1])


@pytest.mark.skipif(not SHARED.is_dir(), reason="there is no folder of shared scenes beside the checkout")
def test_lanes_in_a_scene_with_a_tree_have_the_same_bits_too(monkeypatch: pytest.MonkeyPatch) -> None:
    settings = renderer.Settings(width=16, height=16)
    source = SHARED / "veach-ajar" / "scene.xml"
    _, calm = lanes(renderer.load_scene(source, settings=settings), settings)
    monkeypatch.setattr(path, "SEGMENTS_PER_SAMPLE", 2)
    monkeypatch.setattr(launch, "FIRST_SEGMENTS", 4)
    parts, cut = lanes(renderer.load_scene(source, settings=settings), settings)
    assert parts > 1
    assert np.array_equal(calm[0], cut[0])


def test_no_launch_is_longer_than_its_segments_however_deep_the_paths(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = renderer.load_scene(white_room(1_000_000), settings=renderer.Settings())
    kernel = scene.kernel(scene.resolved(renderer.Settings(independent_pixels=True), SIZE))
    pixels = np.arange(256, dtype=np.uint32)
    begun = kernel.begin(pixels, np.zeros_like(pixels), 1)
    for turn in range(3):
        assert isinstance(begun, launch.Launch)
        before = None if turn == 0 else np.array(begun._long._state[-2])  # type: ignore[union-attr]
        assert not begun.step(), "a million segments are not done within a few launches"
        assert begun._long is not None
        now = np.array(begun._long._state[-2])
        assert now.max() <= SIZE * path.SEGMENTS_PER_SAMPLE + launch.MOST_SEGMENTS * turn
        assert before is None or (now >= before).all()


def test_a_render_with_long_paths_can_be_suspended_within_a_pass() -> None:
    settings = renderer.Settings(width=16, height=16, seed=1)
    found = progress.steps(white_room(1_000_000), renderer.Target(spp=16), settings)
    assert [next(found) for _ in range(4)] == [None] * 4


def test_a_room_without_end_is_as_bright_as_its_albedo_says() -> None:
    """A closed room of albedo a under an even light of its walls is Le/(1 − a) bright: 100 here, with paths of 100."""
    wall = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.99}}
    light = {"type": "area", "radiance": {"type": "rgb", "value": 1.0}}
    scene = white_room(-1) | {"room": {"type": "cube", "flip_normals": True, "bsdf": wall, "emitter": light}}
    del scene["lamp"]
    settings = renderer.Settings(width=16, height=16, seed=1)
    estimate = renderer.render(scene, renderer.Target(spp=64), settings)
    mean = float(estimate.mean.mean())
    sigma = float(np.sqrt((estimate.stderr[..., 0] ** 2).mean() / estimate.count.size))
    assert abs(mean - 100) < 4 * sigma, f"{mean} ± {sigma}: false alarm 6e-5"
    assert sigma < 1


def test_lights_hidden_behind_a_mask_stay_hidden_when_lanes_are_suspended(monkeypatch: pytest.MonkeyPatch) -> None:
    veil = {"type": "mask", "opacity": 0.5, "bsdf": {"type": "diffuse"}}
    look = mitsuba().ScalarTransform4f().look_at([0, 0, 4], [0, 0, 0], [0, 1, 0])
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 6, "hide_emitters": True},
        "sensor": {"type": "perspective", "film": {"type": "hdrfilm", "width": 16, "height": 16}, "to_world": look},
        "veil": {"type": "rectangle", "bsdf": veil},
        "sky": {"type": "constant"},
    }
    settings = renderer.Settings()
    _, calm = lanes(renderer.load_scene(scene, settings=settings), settings)
    monkeypatch.setattr(path, "SEGMENTS_PER_SAMPLE", 1)
    monkeypatch.setattr(launch, "FIRST_SEGMENTS", 1)
    monkeypatch.setattr(launch, "LEAST_SEGMENTS", 1)
    monkeypatch.setattr(launch, "MOST_SEGMENTS", 1)
    parts, cut = lanes(renderer.load_scene(scene, settings=settings), settings)
    assert parts > 3
    assert np.array_equal(calm[0], cut[0])
