"""Facts about the lean model: a kernel without what its scene does not need gives the same bits."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import drjit as dr
import numpy as np
import pytest

from renderer.backend import mitsuba, using
from renderer.equation.path import Model, PathKernel
from renderer.scene.compile import Scene, load_scene
from renderer.settings import Settings

SIZE = 24
SETTINGS = Settings(width=SIZE, height=SIZE, seed=1)


def ball(bsdf: dict[str, Any], **lights: dict[str, Any]) -> dict[str, Any]:
    look = mitsuba().ScalarTransform4f().look_at([0, 2, 5], [0, 0, 0], [0, 1, 0])
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 5},
        "sensor": {"type": "perspective", "fov": 45.0, "shutter_close": 0.5, "to_world": look},
        "ball": {"type": "sphere", "bsdf": bsdf},
        "floor": {
            "type": "disk",
            "to_world": mitsuba().ScalarTransform4f().rotate([1, 0, 0], -90).scale(3),
            "bsdf": bsdf,
        },
        **lights,
    }


POINT = {"type": "point", "position": mitsuba().ScalarPoint3f(1, 3, 1), "intensity": 20.0}
CASES: dict[str, Any] = {
    "cornell-box": "cornell-box",
    "glass-sky": "glass-sky",
    "a point light alone": ball({"type": "diffuse"}, lamp=POINT),
    "mirrors alone": ball({"type": "conductor"}, sky={"type": "constant"}),
    "clear glass alone": ball({"type": "dielectric"}, sky={"type": "constant"}),
    "rough metal of two sides": ball(
        {"type": "twosided", "bsdf": {"type": "roughconductor", "alpha": 0.1}}, sky={"type": "constant"}, lamp=POINT
    ),
    "varnished wood": ball({"type": "roughplastic"}, sky={"type": "constant"}),
}


def rendered(scene: Scene, model: Model) -> np.ndarray:
    pixels = np.arange(SIZE * SIZE, dtype=np.uint32)
    with using(scene.variant):
        kernel = PathKernel(scene.mitsuba_scene, scene.sensor, (SIZE, SIZE), model)
        return np.array(kernel.launch(pixels, np.zeros_like(pixels), 1)[0])


@pytest.mark.parametrize("name", CASES)
def test_lean_and_full_kernels_agree(name: str) -> None:
    scene = load_scene(CASES[name], settings=SETTINGS)
    resolved = scene.resolved(SETTINGS, 16)
    lean, full = scene.model(resolved), scene.model(resolved, full=True)
    assert lean != full
    # Rays that try all primitives turn tangents another way: other directions from the same numbers (`test_rays.py`).
    full = replace(full, has_tree=lean.has_tree, needs_uv=lean.needs_uv)
    assert np.allclose(rendered(scene, lean), rendered(scene, full), rtol=1e-5, atol=1e-7)
    assert rendered(scene, lean).mean() > 0


def test_each_scene_gets_what_it_needs() -> None:
    def model(name: str, depth: int | None = None) -> Model:
        scene = load_scene(CASES[name], settings=SETTINGS)
        return scene.model(scene.resolved(replace(SETTINGS, max_depth=depth), 16))

    point, mirrors, glass = (model(name) for name in list(CASES)[2:5])
    assert (point.has_visible_emitters, point.has_sampleable_emitters, point.has_transmission) == (False, True, False)
    assert (mirrors.has_visible_emitters, mirrors.has_sampleable_emitters) == (True, False)
    assert (mirrors.has_delta, glass.has_delta) == (True, True)
    assert not point.has_delta
    assert [model("a point light alone", depth).has_roulette for depth in (2, 3, -1)] == [False, True, True]
    assert (glass.has_transmission, glass.has_sampleable_emitters, glass.needs_time) == (True, False, False)


def test_what_is_left_out_is_not_in_the_kernel() -> None:
    def operations(scene: Scene, model: Model) -> int:
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
            dr.kernel_history_clear()
            rendered(scene, model)
            return max(kernel.get("operation_count", 0) for kernel in dr.kernel_history())

    for name, share in (("mirrors alone", 0.95), ("a point light alone", 0.95)):
        scene = load_scene(CASES[name], settings=SETTINGS)
        resolved = scene.resolved(SETTINGS, 16)
        lean, full = (operations(scene, scene.model(resolved, full=whole)) for whole in (False, True))
        assert 0 < lean < share * full
