"""From what is asked to what is rendered: the size of replicates, resolved settings, and what the estimate is one of.

Enters: a scene, a target, settings, and the estimate to go on from. Leaves: `Resolved`, or a named refusal. Where the
target is a time, the machine's pace is measured on the way, on lanes that are then forgotten.
"""

from __future__ import annotations

import time
from dataclasses import astuple, dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from renderer import budget, plan
from renderer.backend import made_with
from renderer.errors import CheckpointError
from renderer.estimate.estimate import Estimate, Identity
from renderer.estimate.moments import Moments
from renderer.settings import Settings, Target, replicate_size_for

if TYPE_CHECKING:
    from renderer.scene.compile import Scene

WARM_LANES = 64  # that compile a kernel, where it is not, before its pace is measured
PACE_LANES, MOST_PACE_LANES = 2**12, 2**16
LONG = 8  # times that paths which were suspended are taken to need, at least
PACE_SECONDS = 0.02  # that a measurement of the pace takes at least


@dataclass(frozen=True, slots=True)
class Resolved:
    """settings: with nothing left open. short: what to say beforehand where the target's time is too short for the
    image, else None. samples_per_second: as measured where the target is a time, else 0."""

    settings: Settings
    identity: Identity
    short: str | None
    samples_per_second: float


def resolve(scene: Scene, target: Target, asked: Settings, start: Estimate | None) -> Resolved:
    """What to render. Raises CheckpointError where `start` is an estimate of something else."""
    if asked.independent_pixels is None:
        asked = replace(asked, independent_pixels=_samples_apart(target, start))
    size, short, speed = _resolved_size(scene, target, asked, start)
    settings = scene.resolved(asked, size)
    identity = identity_of(scene, settings)
    if start is not None:
        _check_resumable(start, identity)
    return Resolved(settings, identity, short, speed)


def identity_of(scene: Scene, resolved: Settings) -> Identity:
    """What an estimate of this scene with these settings is an estimate of."""
    left_out = {"seed", "channels"} | {name for name in ("sensor", "camera") if not getattr(resolved, name)}
    kept = {k: v for k, v in resolved.as_dict().items() if k not in left_out}
    needs = scene.requirements
    kept |= {"hide_emitters": needs.hide_emitters, "rr_depth": needs.rr_depth, "film": scene.film}
    if scene.is_polarised:
        kept["polarised"] = True
    if resolved.guide == "on":
        kept["guide_digest"] = scene.kernel(resolved).guide_digest
    else:
        del kept["guide"]  # as estimates were before there were guides
    if not resolved.independent_pixels:
        kept["correlation"] = list(astuple(scene.correlation(resolved)))
    return Identity(scene.digest, scene.name, kept, resolved.seed, (made_with(scene.variant),))


def _samples_apart(target: Target, start: Estimate | None) -> bool:
    """Whether pixels have samples of their own, where the settings leave it open: as before, or so that those of the
    target's region can have more of them.
    """
    return target.region is not None if start is None else bool(start.identity.setting("independent_pixels"))


def _resolved_size(
    scene: Scene, target: Target, asked: Settings, start: Estimate | None
) -> tuple[int, str | None, float]:
    """Samples in a replicate, what to say beforehand of a time that is too short, and samples per second."""
    if start is not None and asked.replicate_size is None:
        return start.replicate_size, None, 0.0
    size = replicate_size_for(asked, target)
    if target.seconds is None or start is not None:
        return size, None, 0.0
    pace = _measured_pace(scene, scene.resolved(asked, 1))
    if asked.replicate_size is None:
        size = budget.replicate_size(target.seconds, scene.width * scene.height, pace, size)
    short = budget.shortfall(target.seconds, scene.width, scene.height, size, pace)
    return size, short, size / (size * pace.sample_seconds + pace.replicate_seconds)


def _measured_pace(scene: Scene, single: Settings) -> budget.Pace:
    """The pace of this machine now, on lanes all over the image. single: resolved settings with replicates of one
    sample. Paths so long that a launch suspends them are not waited for."""
    kernel, n = scene.kernel(single), PACE_LANES
    kernel.look(plan.sample_of(scene.width, scene.height, WARM_LANES), single.seed).step()
    while True:
        pixels = plan.sample_of(scene.width, scene.height, n)
        began = time.perf_counter()
        is_done = kernel.look(pixels, single.seed).step()
        rendering = (time.perf_counter() - began) * (1 if is_done else LONG)
        if rendering >= PACE_SECONDS or n >= MOST_PACE_LANES or len(pixels) < n:
            return budget.Pace(rendering / len(pixels), _adding_seconds(len(pixels)) / len(pixels))
        n *= 4


def _adding_seconds(n: int) -> float:
    """That it takes to add a replicate to each of n pixels, whose memory has been touched before."""
    moments, pixels, began = Moments.empty(n), np.arange(n), 0.0
    radiance, none = np.ones((n, 3), np.float32), np.zeros(n, np.uint32)
    for _ in range(2):
        began = time.perf_counter()
        moments.add_runs(pixels, 1, radiance, none, 1, none)
    return time.perf_counter() - began


def _check_resumable(start: Estimate, identity: Identity) -> None:
    if start.identity.scene != identity.scene:
        raise CheckpointError(
            f"the checkpoint is of another scene ({start.identity.scene_name}, "
            f"digest {start.identity.scene[:12]}) than {identity.scene_name} ({identity.scene[:12]})"
        )
    if len(start.ranges) > 1:
        raise CheckpointError(
            "the checkpoint is a merge of several seeds; go on from one of its parts, then merge again"
        )
    if start.held is not None:
        raise CheckpointError(
            f"the checkpoint is a part of a render and waits for replicates {start.held.said_missing}; "
            "merge it with the parts that have them, then go on"
        )
    if start.identity.seed != identity.seed:
        raise CheckpointError(f"the checkpoint has seed {start.identity.seed}, asked is {identity.seed}")
    for key in dict.fromkeys((*identity.settings, *start.identity.settings)):
        value = identity.setting(key)
        if (had := start.identity.setting(key)) != value:
            raise CheckpointError(f"the checkpoint was made with {key} = {had}, asked is {value}")
