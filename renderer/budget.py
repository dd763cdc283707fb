"""What a time allows: how many samples a replicate has, and whether every pixel gets one. Pure: no clock is read.

Enters: the pace of this machine on this scene, as a first pass measured it. A budget is met with a whole picture: two
replicates of every pixel, without which nothing can be said of its error, shall end in a fraction of the time, so that
they still do where other work takes most of the machine later. Larger replicates stratify better, and cost less to add
up; smaller ones leave more of them. The size is written into settings and file: with it, a render is as exact as any,
whatever the clock does.
"""

from __future__ import annotations

from dataclasses import dataclass

ROUNDS = 16  # replicates of every pixel that a time shall have room for,
FEWEST_ROUNDS = 8  # or this many, where adding one up takes longer than rendering it


@dataclass(frozen=True, slots=True)
class Pace:
    """Seconds that this machine takes, all of it, as busy as it was: for a sample to be rendered, and for a replicate
    to be added to its pixel's.
    """

    sample_seconds: float
    replicate_seconds: float

    def round_seconds(self, pixels: int, size: int) -> float:
        """Of a round: one replicate of `size` samples in each pixel."""
        return pixels * (self.replicate_seconds + size * self.sample_seconds)


def replicate_size(seconds: float, pixels: int, pace: Pace, most: int) -> int:
    """Samples in a replicate, a power of two up to `most`, for an image of `pixels` in `seconds`."""
    size = 1
    while 2 * size <= most and ROUNDS * pace.round_seconds(pixels, 2 * size) <= seconds:
        size *= 2
    while (
        2 * size <= most
        and size * pace.sample_seconds < pace.replicate_seconds
        and FEWEST_ROUNDS * pace.round_seconds(pixels, 2 * size) <= seconds
    ):
        size *= 2
    return size


def shortfall(seconds: float, width: int, height: int, size: int, pace: Pace) -> str | None:
    """What to say beforehand where the time is too short for a replicate of every pixel; None where it is not."""
    needed = pace.round_seconds(width * height, size)
    if needed <= seconds:
        return None
    each = "one sample" if size == 1 else f"{size} samples"
    return (
        f"{seconds:g} s are too short for {each} in each of {width}×{height} pixels, which take about {needed:.2g} s "
        "here: some show a neighbour's radiance, and the error stays unknown; give more time or ask for fewer pixels"
    )
