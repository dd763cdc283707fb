"""The benchmark runs from end to end. No time is judged here."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_the_benchmark_runs_and_reports_every_ratio(tmp_path: Path) -> None:
    lines = tmp_path / "bench.jsonl"
    command = [sys.executable, "-m", "tests.benchmarks", "--smoke"]
    command += ["--scenes", "gallery/cornell-box", "--json", str(lines)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert "geometric" not in done.stdout  # one scene: nothing to average
    (row,) = map(json.loads, lines.read_text().splitlines())
    for key in ("samples_per_second", "path_samples_per_second", "rate_ratio", "error_ratio", "boxed_error_ratio"):
        assert math.isfinite(row[key])
    for key in ("rate_ratio", "rays_per_second", "ray_limit_share", "peak_bytes", "first_picture_cold"):
        assert row[key] > 0
    assert row["rays_per_sample"] > 2  # each camera path of a closed box has a camera ray, a shadow ray, and goes on
    assert row["curve"][-1][0] >= row["curve"][0][0] > 0
    again = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert again.returncode == 0, again.stderr
    assert len(lines.read_text().splitlines()) == 1  # what is there is not measured again
