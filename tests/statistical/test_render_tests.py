"""Mitsuba's own render tests, with references that nobody here made, judged on our images."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from conftest import SHARED

import renderer
from renderer.backend import mitsuba

ORACLE = SHARED / "oracle" / "run_oracle.py"
BUDGET = 2_000_000
BIAS_LIMIT = 3.5


def judge() -> ModuleType:
    spec = importlib.util.spec_from_file_location("run_oracle", ORACLE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def cases() -> list[Any]:
    if not ORACLE.is_file():
        return []
    surface = [c for c in judge().cases("") if c[1] != "participating_media"]
    return [pytest.param(*c, id=f"{c[1]}-{c[2]}") for c in surface]


def load(path: str) -> np.ndarray:
    mi = mitsuba()
    bitmap = mi.Bitmap(path).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, False)
    return np.array(bitmap)


@pytest.mark.oracle
@pytest.mark.skipif(not ORACLE.is_file(), reason="needs the shared oracle beside the checkout")
@pytest.mark.parametrize("run", [0, 1])
@pytest.mark.parametrize(("scene", "folder", "name", "integrator", "reference", "variance"), cases())
def test_render_test_passes(
    scene: str, folder: str, name: str, integrator: str, reference: str, variance: str, run: int
) -> None:
    del integrator
    ref = load(reference)
    spp = max(1, BUDGET // (ref.shape[0] * ref.shape[1]))
    estimate = renderer.render(Path(scene), renderer.Target(spp=spp), renderer.Settings(seed=run))
    result = judge().judge(estimate.mean, ref, load(variance), estimate.spp)
    print(
        f"{folder}/{name} seed {run}: {100 * result['pixels_ok']:.2f} % of values ok, bias "
        f"{100 * result['rel_bias']:+.3f} %, bias_z {result['bias_z']:+.2f}, {estimate.seconds:.1f} s"
    )
    assert result["passed"]
    assert abs(result["bias_z"]) < BIAS_LIMIT
