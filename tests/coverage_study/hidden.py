"""What is said of pictures whose light is hardly ever found: is a target called reached that is not, is a pixel trusted
that is wrong, and is the cause named?

The truth is the same room lit by a lamp of the same power that is large enough to be found (`hidden_light.findable`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

import renderer
from renderer.settings import Settings, Target
from tests.coverage_study import hidden_light

TARGETS = (0.25, 0.10, 0.05)
SIDE = 16
MOST_SPP = {0.25: 128, 0.10: 256, 0.05: 512}  # of a run to that target, so that no result depends on the machine
REFERENCE_SPP = 8192
REFERENCE_SEED = 77
OFF = 2.0  # times the said error, that a mean may be off where a target counts as reached
FAR = 3.0  # half widths


@dataclass(frozen=True)
class Reference:
    """mean, stderr: (pixels, 3). level: mean of the image."""

    mean: np.ndarray
    stderr: np.ndarray

    @property
    def level(self) -> float:
        """Mean of the image."""
        return float(self.mean.mean())


@dataclass(frozen=True)
class Row:
    """runs of one scene and target. reached: how many stopped by the error. wrong: of these, how many are off. trusted:
    share of pixels; far: of those, how many are wrong. named: runs whose health says what is missing. mean: the lowest
    and the highest of the images' means over the true one."""

    runs: int
    reached: int
    wrong: int
    trusted: float
    far: float
    named: int
    mean: tuple[float, float]


def reference_of(name: str, seconds: float) -> Reference:
    """The same light from a lamp that is found."""
    settings = Settings(SIDE, SIDE, REFERENCE_SEED, replicate_size=16, adaptive=False)
    found = renderer.render(hidden_light.findable(name), Target(spp=REFERENCE_SPP, seconds=seconds), settings)
    return Reference(found.moments.mean, np.sqrt(found.moments.variance_of_mean()[:, :3]))


def loaded(name: str) -> renderer.Scene:
    """A scene whose kernels are compiled."""
    scene = renderer.load_scene(hidden_light.scene(name), settings=Settings(SIDE, SIDE))
    renderer.render(scene, Target(spp=4, error=0.25), Settings(seed=999))
    return scene


def measure(scene: renderer.Scene, truth: Reference, target: float, runs: int) -> Row:
    """So many runs of other seeds, each to the target or to its most samples."""
    goal = Target(error=target, spp=MOST_SPP.get(target, max(MOST_SPP.values())))
    reached = wrong = named = 0
    trusted, far, means = [], [], []
    for seed in range(runs):
        *_, last = renderer.progressive(scene, goal, Settings(seed=seed))
        mean = float(last.estimate.mean.mean()) / truth.level
        is_reached = last.stopped_by == "error"
        reached += is_reached
        wrong += is_reached and abs(mean - 1) > OFF * (last.error or 0.0)
        named += bool(last.health.hidden or last.health.cannot_see)
        means.append(mean)
        is_trusted = np.asarray(last.estimate.trust, bool).ravel()
        trusted.append(float(is_trusted.mean()))
        far.append(int(np.count_nonzero(_is_far(last.estimate, truth) & is_trusted)))
    pixels = sum(trusted) * SIDE * SIDE
    share = sum(far) / pixels if pixels else 0.0
    return Row(runs, reached, wrong, float(np.mean(trusted)), share, named, (min(means), max(means)))


def _is_far(estimate: renderer.Estimate, truth: Reference) -> np.ndarray:
    """(pixels,) whether green is more than FAR half widths off, the truth's own noise taken in."""
    moments = estimate.moments
    width = student.ppf(0.975, np.maximum(moments.count - 1, 1)) * np.sqrt(moments.variance_of_mean()[:, 1])
    width = np.hypot(width, np.nan_to_num(1.96 * truth.stderr[:, 1]))
    return np.abs(moments.mean[:, 1] - truth.mean[:, 1]) > FAR * width
