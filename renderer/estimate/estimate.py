"""An estimate: what it holds, its files, and how several become one."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import reduce
from itertools import groupby
from pathlib import Path
from typing import Any

from renderer.errors import MergeError
from renderer.estimate.blocks import Held, join
from renderer.estimate.contents import Contents, Identity, PixelReading
from renderer.estimate.moments import Moments
from renderer.image import card
from renderer.image.exr import read_estimate, write_estimate, write_picture

__all__ = ["Estimate", "Identity", "PixelReading", "merge", "merge_order", "merge_sorted"]


@dataclass(frozen=True)
class Estimate(Contents):
    """An image with its errors. Estimates of disjoint replicates merge."""

    def write(self, path: str | Path, metadata: dict[str, Any] | None = None) -> None:
        """Writes all of it as an EXR, the checkpoint that `read` reads: under a temporary name, then renamed."""
        write_estimate(self, Path(path), metadata or {})

    def write_picture(
        self,
        path: str | Path,
        metadata: dict[str, Any] | None = None,
        *,
        half: bool = False,
        checkpoint: str | Path | None = None,
    ) -> None:
        """Writes the EXR that people open, an eighth of the size: the same channels, no moments. half: radiance in half
        precision. checkpoint: a file in the same folder that `write` wrote; `read` of the picture then reads that.
        """
        beside = None if checkpoint is None else Path(checkpoint)
        write_picture(self, Path(path), metadata or {}, half=half, checkpoint=beside)

    @staticmethod
    def read(path: str | Path) -> Estimate:
        """Reads back what `write` wrote, bit for bit; of a picture, the checkpoint that was written beside it."""
        return read_estimate(Path(path), Estimate)

    def _repr_png_(self) -> bytes:
        """The picture, for notebooks."""
        return card.png(self)

    def _repr_html_(self) -> str:
        """Picture, error and trust in one card, for notebooks."""
        return card.html(self)


def merge(*estimates: Estimate) -> Estimate:
    """The estimate of all their replicates, of one or several seeds: the same bits in whatever order they are given.

    Parts of a render (`renderer.passes`) become the bits of a straight one; while some are missing, `held` says which.
    Refuses other scenes, settings, overlapping replicates, and parts that other versions or devices made, by name.
    """
    if not estimates:
        raise MergeError("nothing to merge: give at least one estimate")
    return merge_sorted(sorted(estimates, key=merge_order))


def merge_order(estimate: Estimate) -> tuple[tuple[int, ...], int]:
    """What `merge_sorted` wants estimates sorted by: seeds, and the first replicate."""
    return _seeds(estimate), estimate.held.first if estimate.held is not None else 0


def merge_sorted(estimates: Iterable[Estimate]) -> Estimate:
    """As `merge`, one after the other: they need not all be in memory."""
    of_one_seed = (reduce(_joined, group) for _, group in groupby(estimates, key=_seeds))
    return reduce(_pooled, of_one_seed)


def _seeds(estimate: Estimate) -> tuple[int, ...]:
    return tuple(seed for seed, _ in estimate.ranges)


def _joined(a: Estimate, b: Estimate) -> Estimate:
    """Both are of the same seed: parts of one render."""
    _check_same_question(a, b)
    seed, has_several = a.ranges[0][0], len(a.ranges) > 1
    advice = "render one of them with another --seed, or other replicates"
    if has_several:
        raise MergeError(f"replicates overlap: both hold seed {seed}; {advice}")
    if a.identity.made_with != b.identity.made_with and a.samples and b.samples:
        made = (", ".join(e.identity.made_with) or "an older version" for e in (a, b))
        raise MergeError(
            f"parts of one render (seed {seed}) were made by {' and by '.join(made)}, and have the bits of none; "
            "render them again with one of these, or with another --seed"
        )
    try:
        held = join(a.held or Held(a.moments), b.held or Held(b.moments), a.replicate_size)
    except MergeError as overlap:
        raise MergeError(f"replicates overlap: both hold seed {seed}, {overlap}; {advice}") from None
    return replace(
        _put_together(a, b, held.moments(a.replicate_size)),
        ranges=((seed, max(a.ranges[0][1], b.ranges[0][1])),),
        audit=a.audit or b.audit,  # it depends on the seed alone
        held=held if held.waiting else None,
    )


def _pooled(a: Estimate, b: Estimate) -> Estimate:
    """Of different seeds."""
    _check_same_question(a, b)
    if shared := {s for s, last in a.ranges if last} & {s for s, last in b.ranges if last}:
        raise MergeError(f"replicates overlap: both hold seed {min(shared)}; render one of them with another --seed")
    for one in (a, b):
        if one.held is not None:
            raise MergeError(
                f"seed {one.identity.seed} waits for its replicates {one.held.said_missing}; merge all of its parts "
                "before, or together with, other seeds"
            )
    return replace(
        _put_together(a, b, a.moments.merge(b.moments)),
        identity=a.identity.also_with(b.identity),
        ranges=tuple(sorted({r for r in (*a.ranges, *b.ranges) if r[1]})) or a.ranges[:1],
        audit=a.audit.merge(b.audit) if a.audit is not None and b.audit is not None else a.audit or b.audit,
    )


def _put_together(a: Estimate, b: Estimate, moments: Moments) -> Estimate:
    return Estimate(
        width=a.width,
        height=a.height,
        replicate_size=a.replicate_size,
        moments=moments,
        identity=a.identity if a.samples else b.identity,
        seconds=a.seconds + b.seconds,
        notes=a.notes,
        channels=b.channels | a.channels,
    )


def _check_same_question(a: Estimate, b: Estimate) -> None:
    """Refuses to merge estimates of different images, by name."""
    if (a.width, a.height) != (b.width, b.height):
        raise MergeError(f"image sizes differ: {a.width}×{a.height} and {b.width}×{b.height}")
    if a.identity.scene != b.identity.scene:
        raise MergeError(f"scenes differ: {a.identity.scene_name} and {b.identity.scene_name} have other contents")
    if a.replicate_size != b.replicate_size:
        raise MergeError(f"replicate sizes differ: {a.replicate_size} and {b.replicate_size}")
    for key in sorted({*a.identity.settings, *b.identity.settings}):
        left, right = a.identity.setting(key), b.identity.setting(key)
        if left != right:
            raise MergeError(f"settings differ: {key} is {left} and {right}")
