"""Facts about measuring the lean model: what is put back is named, and every kernel has its cost."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from renderer.errors import SettingsError
from renderer.measure import model as measured
from renderer.measure.model import median_interval, omissions
from renderer.scene.compile import load_scene
from renderer.settings import Settings
from service.command.main import app


def test_what_the_lean_model_leaves_out_is_named() -> None:
    scene = load_scene("many-lights", settings=Settings(width=8, height=8))
    resolved = scene.resolved(Settings(), 16)
    lean, full = scene.model(resolved), scene.model(resolved, full=True)
    assert "has_transmission" in omissions(lean, full)
    assert omissions(full, full) == []


def test_the_command_prints_and_writes_the_cost_of_every_kernel(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(measured, "COMPILATIONS", 1)
    monkeypatch.setattr(measured, "LEAST_ROUNDS", 2)
    file = tmp_path / "model.json"
    asked = ["measure", "many-lights", "--model", "--size", "8x8", "--seconds", "0.1", "--json", str(file)]
    done = CliRunner().invoke(app, asked)
    assert done.exit_code == 0, done.output
    kernels = json.loads(file.read_text())["kernels"]
    named = {kernel["name"]: kernel for kernel in kernels}
    assert next(iter(named)) == "lean"
    assert named["with light through surfaces"]["operations"] > named["lean"]["operations"] > 0
    for name, kernel in named.items():
        assert name in done.output
        assert kernel["compile_seconds"] > 0
        assert kernel["render_seconds"] > 0
        assert math.isfinite(kernel["render_ratio"])


@pytest.mark.parametrize("other", [["--techniques"], ["--chart", "a.svg"], ["--reference", "a.exr"]])
def test_kernels_are_compared_alone(other: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["measure", "many-lights", "--model", *other])
    assert isinstance(done.exception, SettingsError)
    assert "--model compares kernels alone" in str(done.exception)


@pytest.mark.parametrize("n", [9, 20, 133])
def test_the_interval_of_a_median_covers_it(n: int) -> None:
    """False alarm 1e-6: that of 4000 intervals with 95 % coverage fewer than 3730 cover is less likely."""
    draws = np.random.default_rng(n).exponential(size=(4000, n))
    found = [median_interval(row.tolist()) for row in draws]
    assert all(low <= middle <= high for low, middle, high in found)
    assert sum(low <= math.log(2) <= high for low, _, high in found) >= 3730
