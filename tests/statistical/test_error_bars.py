"""Reported standard errors against the spread of independent runs."""

from __future__ import annotations

import numpy as np
import pytest

import renderer

RUNS = 64


@pytest.mark.parametrize("size", [4, 16])
def test_reported_error_is_the_spread_of_independent_runs(size: int, seed: int) -> None:
    """64 runs of 1024 pixels give the ratio to about 0.4 %; accepted is 5 %."""
    scene = renderer.load_scene("cornell-box", settings=renderer.Settings(width=32, height=32))
    means, variances = [], []
    for run in range(RUNS):
        settings = renderer.Settings(seed=seed + run, replicate_size=size)
        moments = renderer.render(scene, renderer.Target(spp=8 * size), settings).moments
        means.append(np.concatenate([moments.mean, moments.luminance()[:, None]], axis=1))
        variances.append(moments.variance_of_mean())
    spread = np.var(np.array(means), axis=0, ddof=1).mean(axis=0)
    reported = np.array(variances).mean(axis=(0, 1))
    ratio = np.sqrt(reported / spread)
    assert np.all((ratio > 0.95) & (ratio < 1.05)), f"reported / spread for R, G, B, Y: {ratio}"
