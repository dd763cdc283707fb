"""`fredholm measure` on a real scene: what it says of speed and error holds, and its files say the same."""

from __future__ import annotations

import json
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

import renderer
from renderer.errors import SettingsError
from renderer.measure import measure


def test_techniques_are_compared_side_by_side(seed: int) -> None:
    """On a small light that directions hardly find, sampling the light is far more efficient."""
    settings = renderer.Settings(width=24, height=24, seed=seed, max_depth=3)
    found = measure("cornell-box", seconds=0.6, settings=settings, techniques_only=True)
    rows = {row.candidate.settings.technique: row for row in found.rows}
    assert set(rows) == {"mis", "bsdf", "emitter", "cosine", "uniform"}
    assert found.relative_efficiency(rows["mis"]) == 1
    assert found.relative_efficiency(rows["uniform"]) < 0.5
    for row in found.rows:
        assert row.last is not None
        assert row.last.low < row.last.error < row.last.high
        assert row.samples > 0


def test_true_and_stated_error_agree(tmp_path: Path, seed: int) -> None:
    path = tmp_path / "reference.exr"
    settings = renderer.Settings(width=24, height=24, seed=seed + 1)
    renderer.render("furnace", renderer.Target(spp=4096), settings).write(path)
    found = measure("furnace", seconds=0.3, settings=renderer.Settings(seed=seed), reference=path, techniques_only=True)
    assert (found.width, found.height) == (24, 24)
    last = found.default.last
    assert last is not None
    assert last.true_error == pytest.approx(last.error, rel=0.5)


def test_a_reference_of_another_scene_or_size_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "reference.exr"
    renderer.render("furnace", renderer.Target(spp=16), renderer.Settings(width=8, height=8)).write(path)
    with pytest.raises(SettingsError, match="another scene"):
        measure("cornell-box", seconds=0.1, reference=path)
    with pytest.raises(SettingsError, match="8×8"):
        measure("furnace", seconds=0.1, reference=path, settings=renderer.Settings(width=16, height=16))
    with pytest.raises(SettingsError, match="no such file"):
        measure("furnace", seconds=0.1, reference=tmp_path / "none.exr")
    with pytest.raises(SettingsError, match="seconds is 0"):
        measure("furnace", seconds=0)


def test_the_command_writes_table_json_and_chart(tmp_path: Path) -> None:
    chart, file = tmp_path / "speed.svg", tmp_path / "speed.json"
    command = [sys.executable, "-m", "service.command", "measure", "furnace", "--size", "16x16", "--seconds", "0.1"]
    done = subprocess.run(
        [*command, "--chart", str(chart), "--json", str(file)], capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    for expected in ("efficiency", "to 1 %", "emitter", "replicates of 64", "depth", "Recommended"):
        assert expected in done.stdout
    found = json.loads(file.read_text())
    assert len(found["settings"]) >= 8
    ET.parse(chart)
    bad = subprocess.run([*command, "--chart", "speed.png"], capture_output=True, text=True, timeout=300)
    assert bad.returncode == 2
    assert "must end in .svg" in bad.stderr
