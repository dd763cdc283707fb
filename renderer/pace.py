"""How fast a render goes, and what follows from it for its passes and snapshots: its pace, and no bit of its image.

Enters: what passes and snapshots took. Leaves: samples that the next pass shall have, and whether a snapshot is due.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from renderer import plan

SAMPLES_PER_SECOND = {False: 2e6, True: 1e7}  # that two processors render at least, by Scene.is_listed
MIN_SNAPSHOT_SECONDS, MAX_SNAPSHOT_SECONDS = 0.25, 0.35  # of rendering between two snapshots
# Of the render time, that making snapshots may take; and where a viewer would otherwise wait for MAX_SNAPSHOT_SECONDS.
SNAPSHOT_SHARE, MAX_SNAPSHOT_SHARE = 0.1, 0.3
# Where nobody looks before the end: snapshots only keep the curve, and passes are longer, for what a pass costs beside
# its samples is the same for all.
UNSEEN_SHARE, UNSEEN_PASS_SECONDS = 0.01, 1.0


@dataclass(slots=True)
class Pace:
    """Of passes. replicate_size: samples in a replicate. samples_per_second: of the last passes. pass_seconds: of the
    last one. sample_segments: path segments of a sample in the last one, in the mean.
    """

    replicate_size: int
    samples_per_second: float
    pass_seconds: float = 0.0
    sample_segments: float = 1.0

    def note(self, work: plan.Pass, segments: NDArray, seconds: float | None) -> None:
        """What a pass that is done tells of the next one. segments: of its lanes. seconds: None where its time says
        nothing.
        """
        samples = work.n_lanes * self.replicate_size
        self.sample_segments = float(segments.sum(dtype=np.int64)) / samples
        if seconds is None:
            return
        self.pass_seconds = seconds
        speed, before = samples / max(seconds, 1e-6), self.samples_per_second
        # The first pass may have compiled: a later, faster one replaces it at once.
        self.samples_per_second = speed if speed > 2 * before else 0.7 * before + 0.3 * speed

    def pass_samples(self, target_seconds: float | None = None, aimed: float = plan.PASS_SECONDS) -> int:
        """Samples of a pass that takes about `aimed` seconds, and only a fraction of the target's."""
        return plan.pass_samples_for(
            self.samples_per_second, self.sample_segments, self.replicate_size, target_seconds, aimed
        )


@dataclass(slots=True)
class SnapshotPace:
    """Of snapshots. is_watched: whether somebody looks at one before the last. cost: seconds that the last one took.
    since: seconds of rendering after it.
    """

    is_watched: bool
    cost: float = 0.0
    since: float = 0.0

    def is_due(self, is_first: bool, pass_seconds: float) -> bool:
        """Whether to make one at the end of this pass."""
        if not self.is_watched:
            return self.since >= max(self.cost / UNSEEN_SHARE, MAX_SNAPSHOT_SECONDS)
        pace = min(max(self.cost / SNAPSHOT_SHARE, MIN_SNAPSHOT_SECONDS), MAX_SNAPSHOT_SECONDS)
        pace = max(pace, self.cost / MAX_SNAPSHOT_SHARE)
        # The end of the pass that is nearest to it.
        return is_first or self.since + 0.5 * pass_seconds >= pace


@dataclass(slots=True)
class Clock:
    """Counts the time in which something renders: suspended time does not."""

    resumed_at: float = field(default_factory=time.perf_counter)

    def resume(self) -> None:
        """From here on it counts."""
        self.resumed_at = time.perf_counter()

    def passed(self) -> float:
        """Seconds since it was resumed or last asked."""
        before, self.resumed_at = self.resumed_at, time.perf_counter()
        return self.resumed_at - before
