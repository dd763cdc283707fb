"""Scenes with several sensors: one is chosen, the first by default, and estimates of two of them never mix."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import renderer
from renderer.errors import CheckpointError, MergeError, SettingsError
from renderer.scene.report import inspect_scene
from renderer.settings import Settings, Target

REPORT = Path(__file__).resolve().parents[4] / "shared" / "reports" / "three-sensors" / "scene.xml"
ONE = Target(spp=4)


def looking(from_: tuple[float, float, float], width: int, height: int, **more: Any) -> dict[str, Any]:
    from renderer.backend import mitsuba

    to_world = mitsuba().ScalarTransform4f().look_at(list(from_), [0, 0, 0], [0, 1, 0])
    film = {"type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"}}
    return {"type": "perspective", "to_world": to_world, "film": film, **more}


def scene() -> dict[str, Any]:
    """A bright ball: `near` sees it alone, `far` some of it, `away` nothing of it."""
    return {
        "type": "scene",
        "near": looking((0, 0, 3), 8, 6),
        "far": looking((0, 0, 9), 12, 12),
        "away": looking((0, 0, 3), 10, 4, to_world=looking((0, 0, -3), 1, 1)["to_world"], near_clip=5.0),
        "ball": {"type": "sphere", "emitter": {"type": "area"}, "bsdf": {"type": "diffuse"}},
    }


@pytest.mark.parametrize(
    ("asked", "index", "size", "mean"),
    [
        (None, 0, (8, 6), 0.93),
        ("near", 0, (8, 6), 0.93),
        ("far", 1, (12, 12), 0.1),
        (1, 1, (12, 12), 0.1),
        ("1", 1, (12, 12), 0.1),
        ("away", 2, (10, 4), 0.0),
        (2, 2, (10, 4), 0.0),
    ],
)
def test_the_sensor_that_is_asked_for_is_rendered(
    asked: str | int | None, index: int, size: tuple[int, int], mean: float
) -> None:
    estimate = renderer.render(scene(), ONE, Settings(sensor=asked))
    assert (estimate.width, estimate.height) == size
    assert estimate.mean.mean() == pytest.approx(mean, abs=0.05 if mean else 0)
    assert estimate.identity.setting("sensor") == index


def test_a_loaded_scene_is_looked_at_from_each_of_its_sensors() -> None:
    loaded = renderer.load_scene(scene())
    sizes = [(loaded.sized(Settings(sensor=n)).width, loaded.sized(Settings(sensor=n)).height) for n in range(3)]
    assert sizes == [(8, 6), (12, 12), (10, 4)]
    there = renderer.render(loaded, ONE, Settings(sensor="far"))
    alone = renderer.render(renderer.load_scene(scene(), settings=Settings(sensor="far")), ONE)
    assert np.array_equal(there.mean, alone.mean)
    assert loaded.sized(Settings(sensor="far", width=6)).height == 6


def test_a_warning_says_that_there_are_several_until_one_is_chosen() -> None:
    loaded = renderer.load_scene(scene())
    said = "3 sensors: the picture is the first one's, 'near'; choose another by name: 'far', 'away'"
    assert said in loaded.warnings
    assert said in inspect_scene(scene())["warnings"]
    assert said in renderer.render(loaded, ONE).health.warnings
    for chosen in (loaded.sized(Settings(sensor="near")), renderer.load_scene(scene(), settings=Settings(sensor=0))):
        assert said not in chosen.warnings


def test_an_unknown_sensor_is_refused_with_those_that_there_are() -> None:
    for asked in ("top", 3, "-1", "3"):
        with pytest.raises(SettingsError, match=r"the scene has 0 'near', 1 'far', 2 'away'"):
            renderer.render(scene(), ONE, Settings(sensor=asked))
    with pytest.raises(SettingsError, match="sensor is -1"):
        Settings(sensor=-1)


def test_estimates_of_two_sensors_never_mix() -> None:
    """Of equal size: nothing else tells them apart."""
    two = {k: v for k, v in scene().items() if k != "away"} | {"far": looking((0, 0, 9), 8, 6)}
    near, far = (renderer.render(two, ONE, Settings(sensor=name)) for name in ("near", "far"))
    with pytest.raises(CheckpointError, match="sensor = 0, asked is 1"):
        renderer.render(two, Target(spp=8), Settings(sensor="far"), start=near)
    again = renderer.render(two, ONE, Settings(sensor="far", seed=1))
    with pytest.raises(MergeError, match="sensor is 0 and 1"):
        renderer.merge(near, again)
    assert renderer.merge(far, again).spp == 8


def test_a_pixel_of_another_sensor_is_replayed(tmp_path: Path) -> None:
    from renderer.replay import settings_of

    renderer.render(scene(), ONE, Settings(sensor="far")).write(tmp_path / "far.exr")
    held = renderer.Estimate.read(tmp_path / "far.exr")
    found = renderer.replay(scene(), settings_of(held), (6, 6), 0)
    assert found.radiance[0] == pytest.approx(held.mean[6, 6], abs=1)
    assert found.radiance.shape == (1, 3)


def test_a_sensor_within_a_batch_is_none_to_choose() -> None:
    batch = {"type": "batch", "a": looking((0, 0, 3), 4, 4), "b": looking((0, 0, 9), 4, 4)}
    batch["film"] = {"type": "hdrfilm", "width": 8, "height": 4}
    found = inspect_scene({"type": "scene", "both": batch, "ball": scene()["ball"]})
    assert [(one["name"], one["width"]) for one in found["sensor_choices"]] == [("both", 8)]


@pytest.mark.skipif(not REPORT.is_file(), reason="the public reports are not here")
def test_the_public_report_lists_its_three_sensors() -> None:
    found = inspect_scene(REPORT)
    told = [(one["index"], one["name"], one["plugin"], one["width"], one["height"]) for one in found["sensor_choices"]]
    assert told == [
        (0, "Camera", "perspective", 48, 32),
        (1, "Camera.001", "perspective", 40, 40),
        (2, "top", "orthographic", 40, 40),
    ]
    means = [renderer.render(REPORT, ONE, replace(Settings(), sensor=n)).mean.mean() for n in range(3)]
    assert len({round(mean, 3) for mean in means}) == 3
