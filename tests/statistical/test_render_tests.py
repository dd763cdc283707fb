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
BIAS_LIMIT = 3.5  # a false alarm in 2,000 runs
SHARED_RUNS = 8
BIAS_LIMIT_OF_SHARED = 6.1  # of Student's t with 7 degrees of freedom: as rare


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
    return [pytest.param(*c, id=f"{c[1]}-{c[2]}") for c in judge().cases("")]


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
    if estimate.identity.setting("independent_pixels"):
        assert abs(result["bias_z"]) < BIAS_LIMIT
    else:
        # All squares of a shared film have their samples at the same places: where a texture repeats with the pixels,
        # the errors of all pixels have something in common, which the judge's test of the image mean does not know.
        assert abs(mean_bias_of_runs(scene, ref, spp / SHARED_RUNS, run)) < BIAS_LIMIT_OF_SHARED


def mean_bias_of_runs(scene: str, ref: np.ndarray, spp: float, run: int) -> float:
    """Student's t of the difference between the image means of several runs and the reference's."""
    loaded = renderer.load_scene(Path(scene))
    target = renderer.Target(spp=max(1, round(spp)))
    seeds = range(100 * (run + 1), 100 * (run + 1) + SHARED_RUNS)
    means = [renderer.render(loaded, target, renderer.Settings(seed=seed)).mean.mean() for seed in seeds]
    off = np.array(means, np.float64) - ref.mean(dtype=np.float64)
    return float(off.mean() / (off.std(ddof=1) / np.sqrt(SHARED_RUNS)))
