"""Very many samples of a constant: nothing drifts, nothing is negative, no false noise appears."""

from __future__ import annotations

import numpy as np
import pytest

import renderer

RADIANCE = 0.7


def constant_scene(side: int) -> dict[str, object]:
    film = {"type": "hdrfilm", "width": side, "height": side}
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 3},
        "sensor": {"type": "perspective", "film": film},
        "sky": {"type": "constant", "radiance": RADIANCE},
    }


@pytest.mark.parametrize(
    ("side", "samples"), [(16, 10_000_000), pytest.param(64, 100_000_000, marks=pytest.mark.slow, id="64-1e8")]
)
def test_a_constant_stays_what_it_is(side: int, samples: int) -> None:
    target = renderer.Target(spp=-(-samples // side**2))
    estimate = renderer.render(constant_scene(side), target, renderer.Settings(replicate_size=64))
    assert estimate.samples >= samples
    truth = float(np.float32(RADIANCE))
    assert np.abs(estimate.mean / truth - 1).max() <= 1e-6
    assert (estimate.stderr >= 0).all()
    assert (estimate.stderr / truth).max() < 1e-6
    assert (estimate.moments.m2 >= 0).all()
    assert estimate.trust.all()
