"""Facts about the main path: it ends, by the target that was reached first, and resuming changes no bit."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from renderer import pace, plan, resolve
from renderer.budget import Pace
from renderer.errors import CheckpointError, SettingsError
from renderer.estimate.estimate import Estimate, merge
from renderer.estimate.moments import Moments
from renderer.progress import Snapshot, progressive, render
from renderer.replay import settings_of
from renderer.scene.compile import Scene, load_scene
from renderer.settings import Settings, Target
from tests.stand_ins import Begins

WIDTH, HEIGHT, SIZE = 24, 16, 4
N = WIDTH * HEIGHT
SETTINGS = Settings(replicate_size=SIZE, seed=3, adaptive=False)
ADAPTIVE = Settings(replicate_size=SIZE, seed=3)


class NoisyKernel(Begins):
    """Stands in for the kernel: radiance that depends on (seed, pixel, replicate) alone, by NumPy."""

    def __init__(self, invalid_where: tuple[int, int] | None = None, launches_allowed: int = 200) -> None:
        self.invalid_where = invalid_where
        self.launches_allowed = launches_allowed
        self.lanes: list[tuple[int, int]] = []
        self.dull = 0  # columns with hardly any noise: where there are some, counts differ

    def launch(self, pixels: NDArray, replicates: NDArray, seed: int) -> tuple[NDArray, NDArray, NDArray]:
        self.launches_allowed -= 1
        assert self.launches_allowed >= 0, "the render does not end"
        self.lanes += zip(pixels.tolist(), replicates.tolist(), strict=True)
        generators = (np.random.default_rng([seed, int(p), int(r)]) for p, r in zip(pixels, replicates, strict=True))
        radiance = np.array([g.gamma(2.0, 1.0, 3) for g in generators], np.float32)
        radiance = 1 + (radiance - 1) * np.where(pixels % 24 < self.dull, 0.05, 1)[:, None]  # of width 24
        invalid = np.zeros(len(pixels), np.uint32)
        if self.invalid_where is not None:
            pixel, replicate = self.invalid_where
            hit = (pixels == pixel) & ((replicates == replicate) if replicate >= 0 else True)
            radiance[hit], invalid[hit] = 0, SIZE
        return radiance.T, invalid, pixels % 5 + replicates % 3 + SIZE


@pytest.fixture
def kernel(monkeypatch: pytest.MonkeyPatch) -> NoisyKernel:
    made = NoisyKernel()
    monkeypatch.setattr(Scene, "kernel", lambda self, settings: made)
    return made


@pytest.fixture(scope="module")
def scene() -> Scene:
    """Any scene of the right size: the kernel that would render it is replaced."""
    film = {"type": "hdrfilm", "width": WIDTH, "height": HEIGHT, "rfilter": {"type": "box"}}
    return load_scene(
        {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 4},
            "sensor": {"type": "perspective", "film": film},
            "sky": {"type": "constant"},
        }
    )


def snapshots(scene: Scene, target: Target, **more: Any) -> list[Snapshot]:
    return snapshots_of(scene, target, SETTINGS, **more)


def snapshots_of(scene: Scene, target: Target, settings: Settings, **more: Any) -> list[Snapshot]:
    return list(progressive(scene, target, settings, **more))


def assert_same_bits(a: Estimate, b: Estimate) -> None:
    for field in fields(Moments):
        assert getattr(a.moments, field.name).tobytes() == getattr(b.moments, field.name).tobytes(), field.name


def test_samples_stop_at_the_number_asked_for(scene: Scene, kernel: NoisyKernel) -> None:
    last = snapshots(scene, Target(spp=40))[-1]
    assert (last.stopped_by, last.spp, last.samples) == ("spp", 40, 40 * N)
    assert (last.estimate.count == 10).all()
    assert len(set(kernel.lanes)) == len(kernel.lanes) == 10 * N
    assert last.estimate.ranges == ((3, 10),)


def test_an_error_target_stops_at_the_first_checkpoint_below_it(scene: Scene, kernel: NoisyKernel) -> None:
    last = snapshots(scene, Target(error=0.2))[-1]
    assert last.stopped_by == "error"
    assert last.error is not None
    assert last.upper is not None
    assert 0.12 < last.error < last.upper <= 0.2


def test_the_first_limit_reached_wins(scene: Scene, kernel: NoisyKernel) -> None:
    assert snapshots(scene, Target(error=1e-6, spp=8))[-1].stopped_by == "spp"
    assert snapshots(scene, Target(error=0.5, spp=4000))[-1].stopped_by == "error"
    assert snapshots(scene, Target(seconds=0.001, spp=4000))[-1].stopped_by == "seconds"


def test_sequence_numbers_count_up_and_only_the_last_snapshot_says_why_it_stopped(
    scene: Scene, kernel: NoisyKernel
) -> None:
    seen = snapshots(scene, Target(spp=64))
    assert [s.sequence for s in seen] == list(range(1, len(seen) + 1))
    assert [s.stopped_by for s in seen] == [None] * (len(seen) - 1) + ["spp"]
    assert [s.samples for s in seen] == sorted(s.samples for s in seen)


def test_a_snapshot_is_not_changed_by_what_comes_after_it(scene: Scene, kernel: NoisyKernel) -> None:
    running = progressive(scene, Target(spp=64), SETTINGS)
    first = next(running)
    held = first.estimate.moments.copy()
    for _ in running:
        pass
    assert held.count.tobytes() == first.estimate.moments.count.tobytes()
    assert held.mean.tobytes() == first.estimate.moments.mean.tobytes()


def test_an_interrupted_render_that_is_resumed_equals_one_that_was_not(scene: Scene, kernel: NoisyKernel) -> None:
    def interruptions() -> Iterator[bool]:
        yield from (False, False, True)

    straight = render(scene, Target(spp=64), SETTINGS)
    asked = interruptions()
    part = snapshots(scene, Target(spp=64), should_stop=lambda: next(asked))[-1]
    assert part.stopped_by == "interrupted"
    assert part.samples < straight.samples
    held = part.estimate.moments.copy()
    resumed = render(scene, Target(spp=64), SETTINGS, start=part.estimate)
    assert_same_bits(resumed, straight)
    assert resumed.seconds > part.seconds
    assert held.mean.tobytes() == part.estimate.moments.mean.tobytes()


@pytest.mark.parametrize("dull", [0, 12])
@pytest.mark.parametrize("passes", [1, 3, 6, 9, 14])
def test_an_adaptive_render_stopped_after_any_pass_goes_on_with_the_same_bits(
    scene: Scene, kernel: NoisyKernel, monkeypatch: pytest.MonkeyPatch, passes: int, dull: int
) -> None:
    kernel.dull, target = dull, Target(spp=120)
    straight = render(scene, target, ADAPTIVE)
    assert straight.samples == 120 * N
    assert (straight.count.min() < straight.count.max()) == (dull > 0)
    monkeypatch.setattr(plan, "pass_samples_for", lambda *_: 600)  # several passes a round: most stops are inside one
    asked = iter(range(1000))
    part = snapshots_of(scene, target, ADAPTIVE, should_stop=lambda: next(asked) >= passes)[-1].estimate
    assert part.samples < straight.samples
    resumed = render(scene, target, ADAPTIVE, start=part)
    assert_same_bits(resumed, straight)


def test_the_round_in_progress_survives_the_file(scene: Scene, kernel: NoisyKernel, tmp_path: Path) -> None:
    straight = render(scene, Target(spp=100), ADAPTIVE)
    part = render(scene, Target(spp=59), ADAPTIVE)
    assert part.planned is not None
    part.write(tmp_path / "part.exr")
    read = Estimate.read(tmp_path / "part.exr")
    assert read.planned is not None
    assert read.planned.tobytes() == part.planned.tobytes()
    assert_same_bits(render(scene, Target(spp=100), ADAPTIVE, start=read), straight)


def test_adaptive_lanes_are_each_pixels_next_replicates(scene: Scene, kernel: NoisyKernel) -> None:
    kernel.dull = 12
    estimate = render(scene, Target(spp=200), ADAPTIVE)
    assert len(set(kernel.lanes)) == len(kernel.lanes) == 50 * N
    for pixel, count in enumerate(estimate.count.ravel()):
        assert sorted(r for p, r in kernel.lanes if p == pixel) == list(range(count))


def test_a_region_decides_where_the_error_counts_and_where_lanes_go(scene: Scene, kernel: NoisyKernel) -> None:
    kernel.invalid_where = None
    last = snapshots_of(scene, Target(error=0.12, region=[0, 0, 8, 16]), ADAPTIVE)[-1]
    assert last.stopped_by == "error"
    inside, outside = last.estimate.count[:, :8], last.estimate.count[:, 8:]
    assert inside.mean() > 1.5 * outside.mean()
    with pytest.raises(SettingsError, match="reaches outside the image of 24×16"):
        snapshots_of(scene, Target(error=0.1, region=[20, 0, 8, 8]), ADAPTIVE)


def test_a_share_of_pixels_stops_later_the_larger_it_is(scene: Scene, kernel: NoisyKernel) -> None:
    few, many = (snapshots_of(scene, Target(error=0.2, share=s), SETTINGS)[-1] for s in (0.5, 0.95))
    assert few.stopped_by == many.stopped_by == "error"
    assert few.samples < many.samples
    assert few.share_within is not None
    assert few.share_within >= 0.5


def test_more_confidence_costs_more_samples(scene: Scene, kernel: NoisyKernel) -> None:
    bold, sure = (snapshots_of(scene, Target(error=0.15, confidence=c), SETTINGS)[-1] for c in (0.5, 0.9999))
    assert bold.samples < sure.samples


class SingleThreadedKernel(Begins):
    """Has rendered a pass when `launch` returns, as kernels do on a single thread."""

    def __init__(self, samples_per_second: float) -> None:
        self.samples_per_second = samples_per_second
        self.samples: list[int] = []

    def launch(self, pixels: NDArray, replicates: NDArray, seed: int) -> tuple[NDArray, NDArray, NDArray]:
        self.samples.append(len(pixels) * SIZE)
        time.sleep(self.samples[-1] / self.samples_per_second)
        none = np.zeros(len(pixels), np.uint32)
        return np.ones((3, len(pixels)), np.float32), none, none


def test_a_render_that_nobody_watches_has_longer_passes_and_the_same_bits(
    scene: Scene, kernel: NoisyKernel, monkeypatch: pytest.MonkeyPatch
) -> None:
    # As fast as it says: a pass has as many samples as its seconds are worth.
    monkeypatch.setattr(plan, "pass_samples_for", lambda _speed, _segments, _size, _seconds, aimed: int(6000 * aimed))
    launches, estimates = [], []
    for is_watched in (True, False):
        kernel.launches_allowed = 1000
        if is_watched:
            estimates.append(snapshots(scene, Target(spp=64))[-1].estimate)
        else:
            estimates.append(render(scene, Target(spp=64), SETTINGS))
        launches.append(1000 - kernel.launches_allowed)
    assert_same_bits(*estimates)
    assert launches[1] < launches[0] / 3


def test_passes_stay_short_where_a_launch_waits_for_the_kernel(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    kernel = SingleThreadedKernel(samples_per_second=5 * 2**18)
    monkeypatch.setattr(Scene, "kernel", lambda self, settings: kernel)
    settings = replace(SETTINGS, width=640, height=512)
    list(progressive(scene.sized(settings), Target(spp=3 * SIZE), settings))
    assert max(kernel.samples) <= 2**19, "twice what the speed of the kernel would have"


def test_a_target_that_the_start_has_reached_renders_nothing(scene: Scene, kernel: NoisyKernel) -> None:
    start = render(scene, Target(spp=16), SETTINGS)
    before = len(kernel.lanes)
    assert_same_bits(render(scene, Target(spp=16), SETTINGS, start=start), start)
    assert len(kernel.lanes) == before


@pytest.mark.parametrize(
    ("settings", "named"),
    [
        (Settings(replicate_size=SIZE, seed=4, adaptive=False), "seed 3, asked is 4"),
        (Settings(replicate_size=8, seed=3), "replicate_size = 4, asked is 8"),
        (Settings(replicate_size=SIZE, seed=3, max_depth=2), "max_depth = 4, asked is 2"),
        (Settings(replicate_size=SIZE, seed=3, technique="bsdf"), "technique = mis, asked is bsdf"),
    ],
)
def test_a_checkpoint_of_another_question_is_refused_by_name(
    scene: Scene, kernel: NoisyKernel, settings: Settings, named: str
) -> None:
    start = render(scene, Target(spp=4), SETTINGS)
    with pytest.raises(CheckpointError, match=named):
        render(scene, Target(spp=8), settings, start=start)


def test_a_merge_of_seeds_is_not_resumed(scene: Scene, kernel: NoisyKernel) -> None:
    parts = [render(scene, Target(spp=4), Settings(replicate_size=SIZE, seed=s)) for s in (3, 5)]
    with pytest.raises(CheckpointError, match="merge of several seeds"):
        render(scene, Target(spp=8), SETTINGS, start=merge(*parts))


def test_a_forecast_is_for_an_error_target_only_and_gone_at_the_end(scene: Scene, kernel: NoisyKernel) -> None:
    assert all(s.forecast is None for s in snapshots(scene, Target(spp=80)))
    assert snapshots(scene, Target(error=0.1))[-1].forecast is None


def test_the_curve_goes_forward_in_time_and_samples(
    scene: Scene, kernel: NoisyKernel, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A snapshot after every pass: by the clock, a fast machine would be done after the first.
    monkeypatch.setattr(pace, "MIN_SNAPSHOT_SECONDS", 0.0)
    monkeypatch.setattr(pace, "MAX_SNAPSHOT_SECONDS", 0.0)
    monkeypatch.setattr(pace, "MAX_SNAPSHOT_SHARE", 1e9)
    curve = snapshots(scene, Target(spp=160))[-1].curve
    assert len(curve) >= 3
    assert [p.seconds for p in curve] == sorted(p.seconds for p in curve)
    assert [p.spp for p in curve] == sorted(p.spp for p in curve)


def test_a_pixel_whose_samples_are_never_finite_does_not_keep_the_render_from_ending(
    scene: Scene, kernel: NoisyKernel
) -> None:
    # Such a pixel's count stays 0: a plan that waits for it gives it the same replicate for ever.
    kernel.invalid_where = (5, -1)
    last = snapshots(scene, Target(spp=40))[-1]
    assert last.stopped_by == "spp"
    assert 0 < last.invalid <= 40
    assert (np.delete(last.estimate.moments.count, 5) == 10).all()


@pytest.mark.parametrize("lost", [0, 1, 2])
def test_no_replicate_is_added_twice_after_one_was_lost(scene: Scene, kernel: NoisyKernel, lost: int) -> None:
    # The replicate after a lost one must not be taken for the lost one: it would count twice, the error bar too small.
    kernel.invalid_where = (5, lost)
    last = snapshots(scene, Target(spp=40))[-1]
    kept = [r for p, r in kernel.lanes if p == 5 and r != lost]
    assert len(set(kept)) == len(kept) == last.estimate.moments.count[5]
    assert last.invalid == SIZE


def test_a_time_decides_the_replicate_size_once_and_a_resumed_render_keeps_it(
    scene: Scene, kernel: NoisyKernel, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    paces = [Pace(1e-3 / N, 0.0), Pace(1e-5 / N, 0.0)]
    monkeypatch.setattr(resolve, "_measured_pace", lambda *_: paces.pop(0))
    asked = Settings(seed=3)
    part = render(scene, Target(seconds=0.07), asked)
    assert part.replicate_size == part.identity.settings["replicate_size"] == 4
    part.write(tmp_path / "part.exr")
    read = Estimate.read(tmp_path / "part.exr")
    assert settings_of(read).replicate_size == 4
    assert_same_bits(
        render(scene, Target(spp=part.samples // N + 40), asked, start=read),
        render(scene, Target(spp=part.samples // N + 40), replace(asked, replicate_size=4)),
    )
    assert len(paces) == 1, "the pace was measured again"


def test_a_time_that_is_too_short_says_so_with_the_first_picture_and_leaves_the_error_unknown(
    scene: Scene, kernel: NoisyKernel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(resolve, "_measured_pace", lambda *_: Pace(1.0, 0.0))
    monkeypatch.setattr(plan, "pass_samples_for", lambda *_: 16)
    settings = Settings(seed=3)
    first = next(progressive(scene, Target(seconds=0.5), settings))
    assert "0.5 s are too short for one sample in each of 24×16 pixels" in first.health.sentences()[-1]
    assert first.short is not None
    assert first.error is None
    assert first.unknown is not None
    assert first.unknown.endswith("no sample")
    assert first.share_within is None
    # Where it was enough after all, nothing is said.
    whole = render(scene, Target(seconds=60.0, spp=4), settings)
    assert whole.health.warnings == ()


def test_a_resumed_render_keeps_its_curve_and_its_forecast(
    scene: Scene, kernel: NoisyKernel, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(pace, "MIN_SNAPSHOT_SECONDS", 0.0)
    monkeypatch.setattr(pace, "MAX_SNAPSHOT_SECONDS", 0.0)
    monkeypatch.setattr(pace, "MAX_SNAPSHOT_SHARE", 1e9)
    part = snapshots(scene, Target(error=0.02, spp=120))[-1]
    assert len(part.curve) >= 3
    assert all(point.upper is None or point.upper >= point.error for point in part.curve)
    assert part.curve[-1].upper is not None
    part.estimate.write(tmp_path / "part.exr")
    read = Estimate.read(tmp_path / "part.exr")
    first = next(progressive(scene, Target(error=0.02, spp=400), SETTINGS, start=read))
    assert first.curve[: len(part.curve)] == part.curve
    assert first.forecast is not None
    surer = next(progressive(scene, Target(error=0.02, spp=400, confidence=0.99), SETTINGS, start=read))
    assert [point.error for point in surer.curve[: len(part.curve)]] == [point.error for point in part.curve]
    assert all(point.upper is None for point in surer.curve[: len(part.curve)]), "bounds of another confidence"
    corner = next(progressive(scene, Target(error=0.02, spp=400, region=[0, 0, 16, 16]), SETTINGS, start=read))
    assert len(corner.curve) <= 1, "errors of another region"


def test_an_estimate_that_other_versions_or_devices_went_on_with_says_so(scene: Scene, kernel: NoisyKernel) -> None:
    start = render(scene, Target(spp=16), SETTINGS)
    (own,) = start.identity.made_with
    assert "mitsuba" in own
    other = replace(start, identity=replace(start.identity, made_with=("fredholm 0.0, mitsuba 1, drjit 1, cuda",)))
    mixed = render(scene, Target(spp=32), SETTINGS, start=other)
    assert len(mixed.identity.made_with) == 2
    (sentence,) = [s for s in mixed.health.sentences() if s.startswith("mixed")]
    assert own in sentence
    assert "mitsuba 1, drjit 1, cuda" in sentence
    assert not render(scene, Target(spp=32), SETTINGS, start=start).health.mixed
    merged = merge(mixed, render(scene, Target(spp=8), replace(SETTINGS, seed=9)))
    assert merged.health.mixed == mixed.health.mixed
