"""Renders one pixel, or one replicate of it, alone: the same bits as in the whole image.

A replicate is addressed by (scene, settings, seed, pixel, index) and by nothing else, so whatever looks odd in an image
can be looked at again by itself: a firefly, a sample that was not finite, a pixel that differs between two machines.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from renderer.backend import one_at_a_time
from renderer.errors import CheckpointError, SettingsError
from renderer.estimate.estimate import Estimate
from renderer.estimate.moments import Moments
from renderer.scene.parameters import Source
from renderer.settings import DEFAULT_REPLICATE_SIZE, STOKES, Settings

if TYPE_CHECKING:
    from renderer.scene.compile import Scene


@dataclass(frozen=True, slots=True)
class Replay:
    """Replicates of one pixel. radiance: (n, 3) float32 mean of each one's finite samples, (n, 12) with S1 to S3.
    invalid: (n,) samples of each that were not finite. moments: all of them folded, as an estimate holds them for this
    pixel.
    """

    replicates: range
    radiance: NDArray[np.float32]
    invalid: NDArray[np.uint32]
    moments: Moments


def replay(
    scene: Scene | Source,
    settings: Settings,
    pixel: tuple[int, int],
    replicate: int | range,
) -> Replay:
    """Renders replicates of the pixel in column x, row y. Raises SettingsError where there is no such pixel."""
    with one_at_a_time:
        return _replayed(scene, settings, pixel, replicate)


def _replayed(
    scene: Scene | Source,
    settings: Settings,
    pixel: tuple[int, int],
    replicate: int | range,
) -> Replay:
    from renderer.scene.compile import Scene, load_scene

    loaded = scene.sized(settings) if isinstance(scene, Scene) else load_scene(scene, settings=settings)
    x, y = pixel
    if not (0 <= x < loaded.width and 0 <= y < loaded.height):
        raise SettingsError(f"pixel ({x}, {y}) is outside the image of {loaded.width}×{loaded.height}")
    replicates = range(replicate, replicate + 1) if isinstance(replicate, int) else replicate
    if not replicates or replicates.step != 1 or replicates[0] < 0:
        raise SettingsError(f"replicates are {replicates}; give an index from 0 or a range of them")
    resolved = loaded.resolved(settings, settings.replicate_size or DEFAULT_REPLICATE_SIZE)
    lanes = np.arange(replicates.start, replicates.stop, dtype=np.uint32)
    pixels = np.full(len(lanes), y * loaded.width + x, np.uint32)
    kernel = loaded.kernel(resolved)
    result = kernel.launch(pixels, lanes, resolved.seed)
    radiance = np.array(result[0]).T
    invalid, segments = (np.array(counts).reshape(len(lanes)) for counts in result[1:])
    moments = Moments.empty(1, kernel.has_stokes)
    for r in range(len(lanes)):
        one = slice(r, r + 1)
        moments.add(slice(None), radiance[one], invalid[one], resolved.replicate_size or 1, segments[one])
    return Replay(replicates, radiance, invalid, moments)


def settings_of(estimate: Estimate) -> Settings:
    """The settings that an estimate was made with. Raises CheckpointError where it has several seeds."""
    if len(estimate.ranges) > 1:
        raise CheckpointError("the estimate is a merge of several seeds; replay from one of its parts")
    if estimate.held is not None:
        raise CheckpointError(
            f"the estimate is a part of a render and waits for replicates {estimate.held.said_missing}; "
            "merge it with the parts that have them, then replay"
        )
    names = {f.name for f in fields(Settings)}
    kept: dict[str, Any] = {k: v for k, v in estimate.identity.settings.items() if k in names}
    kept["seed"] = estimate.identity.seed
    if estimate.identity.setting("polarised"):
        kept["channels"] = (STOKES,)  # for which it may have been rendered so
    return Settings(**kept)


def differences(estimate: Estimate, pixel: tuple[int, int], again: Replay) -> list[str]:
    """Names of the moments in which a replay of all replicates differs, in any bit, from the estimate's pixel."""
    i = pixel[1] * estimate.width + pixel[0]
    return [
        f.name
        for f in fields(Moments)
        if np.ascontiguousarray(getattr(estimate.moments, f.name)[i]).tobytes()
        != np.ascontiguousarray(getattr(again.moments, f.name)[0]).tobytes()
    ]
