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
    command = [sys.executable, "-m", "tests.benchmarks", "--smoke", "gallery/cornell-box", "--json", str(lines)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert "geometric" not in done.stdout  # one scene: nothing to average
    (row,) = map(json.loads, lines.read_text().splitlines())
    for key in ("samples_per_second", "path_samples_per_second", "rate_ratio", "error_ratio"):
        assert math.isfinite(row[key])
    assert row["rate_ratio"] > 0
