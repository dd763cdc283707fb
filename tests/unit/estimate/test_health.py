"""Facts about health: what is wrong is said, what is fine is not."""

from __future__ import annotations

import numpy as np

from renderer.estimate.estimate import Estimate, Identity
from renderer.estimate.moments import Moments


def estimate(n_replicates: int, invalid: int = 0, **notes: list[str]) -> Estimate:
    rng, moments = np.random.default_rng(0), Moments.empty(256)
    for r in range(n_replicates):
        bad = np.zeros(256, np.uint32)
        bad[7] = invalid if r == 0 else 0
        moments.add(slice(None), rng.uniform(0.9, 1.1, (256, 3)).astype(np.float32), bad, 4)
    return Estimate(16, 16, 4, moments, Identity("d", "box", {}, 0), notes=dict(notes))


def test_a_settled_image_is_good_and_says_nothing() -> None:
    health = estimate(20).health
    assert health.status == "good"
    assert health.sentences() == []


def test_an_image_of_few_replicates_is_uncertain() -> None:
    health = estimate(3).health
    assert (health.status, health.untrusted) == ("uncertain", 1.0)
    assert "100 % of the pixels" in health.sentences()[0]
    assert health.needs_samples == 48
    assert "12 replicates: 48 samples per pixel" in health.sentences()[0]
    assert estimate(12).health.needs_samples is None


def test_samples_that_were_not_finite_degrade_it() -> None:
    health = estimate(20, invalid=3).health
    assert (health.status, health.invalid, health.invalid_pixels, health.empty_pixels) == ("degraded", 3, 1, 0)
    assert "3 samples in 1 pixels were not finite" in health.sentences()[0]


def test_a_pixel_without_any_finite_sample_is_counted() -> None:
    assert estimate(1, invalid=4).health.empty_pixels == 1


def test_light_that_cannot_be_seen_and_warnings_are_passed_on() -> None:
    health = estimate(20, cannot_see=["point light 'lamp'"], warnings=["no emitters"]).health
    assert health.status == "uncertain"
    assert health.sentences() == ["incomplete: this technique cannot see the point light 'lamp'", "no emitters"]
    assert health.as_dict()["cannot_see"] == ["point light 'lamp'"]
