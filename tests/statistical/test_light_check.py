"""The check of lights before a render: a sampler that misses light is named, and one that does not is not.

Mitsuba's own emitter sampling misses light of pictures that repeat; it stands in for the fault that is looked for. The
check's seed is fixed; what it takes for a lack is five standard errors and a quarter of the light.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import drjit as dr
import numpy as np
import pytest
from test_painted_lights import BIG_UV, LIGHTS, plate, room

import renderer
from renderer.backend import mitsuba, using
from renderer.equation.lights.check import lights_that_are_missed
from renderer.equation.lights.environment_map import EnvironmentMap
from renderer.scene.report import inspect_scene

SUN = np.full((16, 32, 3), 0.1, np.float32)
SUN[3, 20] = 500.0


def said_of(parts: dict[str, Any]) -> tuple[str, ...]:
    scene = renderer.load_scene(parts)
    with using(scene.variant):
        return lights_that_are_missed(scene.mitsuba_scene)


def sky(texels: np.ndarray = SUN) -> dict[str, Any]:
    return {"type": "envmap", "bitmap": mitsuba().Bitmap(texels)}


@pytest.mark.parametrize("name", LIGHTS)
def test_nothing_is_said_of_lights_that_are_found(name: str, tmp_path: Path) -> None:
    assert said_of(room(LIGHTS[name](tmp_path))) == ()


@pytest.mark.parametrize("texels", [SUN, np.roll(SUN, 5, axis=0), np.ones((4, 8, 3), np.float32)])
def test_nothing_is_said_of_a_sky_that_is_found(texels: np.ndarray) -> None:
    assert said_of(room(sky(texels))) == ()


def test_a_sampler_that_misses_most_of_a_picture_that_repeats_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("renderer.equation.lights.surface_lights._is_ours", lambda *args: False)
    (said,) = said_of(room(plate(tmp_path, uv=BIG_UV)))
    assert said.startswith("light check: ")
    assert "'light'" in said


def test_a_sampler_of_the_sky_that_misses_half_of_it_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    honest = EnvironmentMap.sample

    def half(self: Any, *args: Any) -> tuple[Any, Any]:
        ds, weight = honest(self, *args)
        return ds, dr.select(ds.d.x > 0, weight, 0)

    monkeypatch.setattr(EnvironmentMap, "sample", half)
    said = inspect_scene(room(sky(np.ones((4, 8, 3), np.float32))))["warnings"]
    assert any(line.startswith("light check: ") and "50 %" in line for line in said)


@pytest.mark.parametrize("texels", [SUN, np.roll(SUN, 5, axis=0), SUN * 0 + 1 + (SUN > 1)])
def test_a_render_checks_its_own_sampler_and_has_nothing_to_say_of_what_it_leaves_to_bsdfs(texels: np.ndarray) -> None:
    scene = renderer.load_scene(room(sky(texels)))
    assert scene.kernel(scene.resolved(renderer.Settings(), 1)).emitters.sky is not None
    estimate = renderer.render(scene, renderer.Target(spp=4), renderer.Settings(width=8, height=8))
    assert not [line for line in estimate.health.warnings if line.startswith("light check: ")]


def test_a_render_whose_sampler_misses_half_of_a_sky_says_so_in_its_health(monkeypatch: pytest.MonkeyPatch) -> None:
    honest = EnvironmentMap.sample

    def half(self: Any, *args: Any) -> tuple[Any, Any]:
        ds, weight = honest(self, *args)
        return ds, dr.select(ds.d.x > 0, weight, 0)

    monkeypatch.setattr(EnvironmentMap, "sample", half)
    scene = renderer.load_scene(room(sky(np.ones((4, 8, 3), np.float32))))
    estimate = renderer.render(scene, renderer.Target(spp=4), renderer.Settings(width=8, height=8))
    assert any(line.startswith("light check: ") for line in estimate.health.warnings)


def test_a_brief_render_has_no_time_for_the_check(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("renderer.progress.LIGHT_CHECK_SECONDS", 1e9)
    monkeypatch.setattr("renderer.equation.lights.check.lights_that_are_missed", lambda *_: ("light check: called",))
    scene = renderer.load_scene(room(sky()))
    small = renderer.Settings(width=8, height=8)
    assert not renderer.render(scene, renderer.Target(seconds=0.1), small).health.warnings
    assert "light check: called" in renderer.render(scene, renderer.Target(spp=4), small).health.warnings
