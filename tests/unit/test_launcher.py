"""Facts about where passes run: however many are on their way, and whichever is done first, no bit changes."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from renderer import Settings, Target, plan, render
from renderer.estimate.estimate import Estimate
from renderer.estimate.moments import Moments
from renderer.progress import Snapshot, steps


class _Elsewhere:
    """Stands in for a pass on another machine: rendered when it is launched, done a few looks later."""

    is_long = False

    def __init__(self, results: Any, looks: int) -> None:
        self._results, self._looks = results, looks

    def step(self) -> bool:
        self._looks -= 1
        return self._looks < 0

    def results(self) -> Any:
        return self._results


class Several:
    """Has many passes on their way, of which later ones are often done first. log: (on their way, is a look)."""

    most_launched = 7

    def __init__(self, scene: Any, settings: Settings, places: int = 4) -> None:
        self.kernel, self.seed, self.places = scene.kernel(settings), settings.seed, places
        self.launched: list[_Elsewhere] = []
        self.log: list[tuple[int, bool]] = []

    def launch(self, work: plan.Pass) -> _Elsewhere:
        lanes = (
            self.kernel.look(work.pixels, self.seed) if work.is_look else self.kernel.begin(*work.lanes(), self.seed)
        )
        pending = _Elsewhere(lanes.finished(), (3, 0, 1)[len(self.launched) % 3])
        self.launched.append(pending)
        self.log.append((sum(one._looks >= 0 for one in self.launched), work.is_look))
        return pending

    def seconds_of(self, launched: Any) -> float | None:
        return 0.05


def rendered(scene: str, target: Target, settings: Settings, **how: Any) -> tuple[Estimate, Several, list[Snapshot]]:
    made: list[Several] = []

    def launcher(*of: Any) -> Several:
        made.append(Several(*of))
        return made[0]

    told = [one for one in steps(scene, target, settings, launcher=launcher, **how) if one is not None]
    return told[-1].estimate, made[0], told


@pytest.mark.parametrize(
    ("scene", "target", "other"),
    [
        ("cornell-box", Target(spp=96), {"replicate_size": 8, "adaptive": False}),
        ("cornell-box", Target(error=0.15), {"replicate_size": 4, "independent_pixels": True}),
        ("glass-sky", Target(spp=64), {"replicate_size": 8, "colour": "spectral"}),
    ],
    ids=["shared samples", "adaptive", "spectral"],
)
@pytest.mark.parametrize("is_watched", [True, False])
def test_passes_that_are_done_in_another_order_change_no_bit(
    monkeypatch: pytest.MonkeyPatch, scene: str, target: Target, other: dict[str, Any], is_watched: bool
) -> None:
    settings = Settings(width=40, height=24, seed=3, **other)
    straight = render(scene, target, settings)
    monkeypatch.setattr(plan, "pass_samples_for", lambda *_: 900)
    elsewhere, launcher, _ = rendered(scene, target, settings, is_watched=is_watched)
    assert max(n for n, _ in launcher.log) > 2
    for field in fields(Moments):
        a, b = getattr(elsewhere.moments, field.name), getattr(straight.moments, field.name)
        assert a.tobytes() == b.tobytes(), field.name
    assert elsewhere.ranges == straight.ranges


def test_nothing_is_launched_beside_the_first_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plan, "pass_samples_for", lambda *_: 900)
    made: list[Several] = []

    def launcher(*of: Any) -> Several:
        made.append(Several(*of))
        return made[0]

    settings = Settings(width=40, height=24, replicate_size=8)
    running = steps("cornell-box", Target(spp=512), settings, launcher=launcher)
    next(one for one in running if one is not None)
    assert made[0].log
    assert max(n for n, _ in made[0].log) == 1
    next(one for one in running if one is not None)
    assert max(n for n, _ in made[0].log) > 1


def test_a_stop_takes_what_is_done_and_leaves_the_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plan, "pass_samples_for", lambda *_: 900)
    asked = iter(range(1000))
    settings = Settings(width=40, height=24, replicate_size=8, adaptive=False)
    part, launcher, told = rendered("cornell-box", Target(spp=4096), settings, should_stop=lambda: next(asked) > 40)
    assert told[-1].stopped_by == "interrupted"
    done = sum(not is_look for _, is_look in launcher.log)
    assert 0 < part.samples < done * 900 * 4
    whole = render("cornell-box", Target(spp=256), settings)
    resumed = render("cornell-box", Target(spp=256), settings, start=part)
    assert resumed.moments.mean.tobytes() == whole.moments.mean.tobytes()


def test_time_does_not_pass_while_there_is_no_place_to_render(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter(np.arange(0, 1e6, 0.5))
    monkeypatch.setattr("time.perf_counter", lambda: float(next(clock)))
    settings = Settings(width=16, height=8, replicate_size=8, adaptive=False)
    nobody = steps("cornell-box", Target(spp=16), settings, launcher=lambda *of: Several(*of, places=0))
    somebody = steps("cornell-box", Target(spp=16), settings, launcher=lambda *of: Several(*of, places=4))
    seconds = [[s.seconds for s in told if s is not None][-1] for told in (nobody, somebody)]
    assert seconds[0] < seconds[1]
