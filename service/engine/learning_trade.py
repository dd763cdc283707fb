"""Runs inside a render process: error against time for the Learn view, a turn at a time. Plain values in and out.

A measurement stays here between its turns, where no time of it is counted; whoever asks for the next turn tells which.
Should it be lost, the next turn begins anew: each answer is whole, and says how much of it is done.
"""

from __future__ import annotations

import math
import time
from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

from service.engine.turn import Failure
from service.engine.worker import failure_of, kept_scene

if TYPE_CHECKING:
    from renderer.measure import Measurement, Measuring, Row
    from renderer.measure.model import KernelCost
    from renderer.scene.compile import Scene

TURN_SECONDS = 0.7  # that a turn aims at: others wait for so long
MOST_SECONDS = 16.0  # of a setting
PIXELS = 1 << 13  # that are measured: every setting shall see each of them several times in a second or two
_KEPT = 4  # measurements on their way
GROUPS = ("technique", "sampling", "depth")
_IN_GROUP = {"technique": {"technique"}, "sampling": {"replicate size", "sampling"}, "depth": {"depth"}}


@dataclass(slots=True)
class _Going:
    """A measurement, with the pixels of the scene's own picture."""

    measuring: Measuring
    full: tuple[int, int]


_going: OrderedDict[tuple[str, str], _Going] = OrderedDict()
_kernels: OrderedDict[str, Iterator[list[KernelCost] | None]] = OrderedDict()


def trade(scene: str, group: str, seconds: float, step: int) -> dict[str, Any] | Failure:
    """One more turn of a measurement, and all that is known by then. step: number of the turn, for those who ask."""
    try:
        going = _going.get((scene, group))
        if going is None or (step == 0 and going.measuring.seconds > seconds):
            going = _going[scene, group] = _begun(scene, group, seconds)
        _going.move_to_end((scene, group))
        while len(_going) > _KEPT:
            _going.popitem(last=False)
        measuring = going.measuring
        measuring.give(seconds)
        ends = time.perf_counter() + TURN_SECONDS
        while not measuring.is_done:
            measuring.step()
            if time.perf_counter() >= ends:
                break
        return _told(going)
    except Exception as error:
        _going.pop((scene, group), None)
        return failure_of(error)


def _begun(path: str, group: str, seconds: float) -> _Going:
    from renderer import Settings
    from renderer.measure import Measuring, candidates

    loaded = kept_scene(path, Settings())
    full = loaded.width, loaded.height
    shrink = min(1.0, math.sqrt(PIXELS / (full[0] * full[1])))
    size = {"width": max(1, round(full[0] * shrink)), "height": max(1, round(full[1] * shrink))}
    asked = replace(Settings(), **size)
    small = loaded.sized(asked)
    tried = [
        one for one in candidates(asked, small.requirements.max_depth) if one.group in {"default", *_IN_GROUP[group]}
    ]
    most = MOST_SECONDS
    return _Going(Measuring(small, tuple(tried), seconds, None, full[0] * full[1], most), full)


def _told(going: _Going) -> dict[str, Any]:
    measuring = going.measuring
    found = measuring.result()
    return {
        "share": measuring.share,
        "is_done": measuring.is_done,
        "at_work": None if measuring.is_done else measuring.at_work,
        "seconds": measuring.seconds,
        "width": found.width,
        "height": found.height,
        "full_width": going.full[0],
        "full_height": going.full[1],
        "full_size": found.full_size,
        "settings": [_row(found, row, measuring.scene) for row in found.rows],
    }


def _row(found: Measurement, row: Row, scene: Scene) -> dict[str, Any]:
    """A setting. All seconds are those of the scene's own picture: of the one measured, times its share of pixels."""
    from renderer.measure.result import TARGETS

    scale, reach, settings = found.full_size, row.log_reach, row.candidate.settings
    is_known = row.last is not None and math.isfinite(row.variance_time) and row.variance_time > 0
    ratio = found.efficiency_interval(row) if is_known and found.default.last else None
    work = row.variance_time * scale
    return {
        "name": row.name,
        "group": row.candidate.group,
        "technique": settings.technique,
        "curve": [asdict(point) | {"seconds": point.seconds * scale} for point in _plain(row)],
        "seconds": row.seconds * scale,
        "samples_per_second": row.samples_per_second if row.seconds > 0 else None,
        "work": work if is_known else None,
        "work_low": work * math.exp(-reach) if is_known and reach is not None else None,
        "work_high": work * math.exp(reach) if is_known and reach is not None else None,
        # Time is what is asked for, so the ratio of times: the reciprocal of that of the efficiencies.
        "times": 1 / found.relative_efficiency(row) if is_known and found.default.last else None,
        "times_low": 1 / ratio[1] if ratio else None,
        "times_high": 1 / ratio[0] if ratio else None,
        "times_to": [_time(row, target, scale) for target in TARGETS],
        "lost_light": max(0.0, row.lost_light),
        "is_trusted": row.last is not None and row.is_trusted,
        "cannot_see": list(scene.cannot_see(scene.resolved(settings, settings.replicate_size or 1))),
    }


def _plain(row: Row) -> list[Any]:
    return [point for point in row.curve if point.error > 0 and math.isfinite(point.high)]


def _time(row: Row, target: float, scale: float) -> dict[str, Any]:
    found, interval = row.time_to(target), row.time_interval(target)
    is_known = found is not None and math.isfinite(found.seconds) and row.last is not None and row.last.error > 0
    return {
        "target": target,
        "seconds": found.seconds * scale if found is not None and is_known else None,
        "low": interval[0] * scale if interval and is_known else None,
        "high": interval[1] * scale if interval and is_known else None,
        "is_measured": bool(found is not None and found.is_measured),
    }


def kernels(scene: str, step: int) -> dict[str, Any] | Failure:
    """One more turn of measuring what the lean kernel saves against the full one; the costs once they are known."""
    from renderer import Settings
    from renderer.measure.model import COMPILATIONS, LEAST_ROUNDS, costing, left_out_of

    try:
        loaded = kept_scene(scene, Settings())
        left_out = left_out_of(loaded, Settings())
        whole = (2 if left_out else 1) * COMPILATIONS + LEAST_ROUNDS + 1
        told = {"left_out": left_out, "steps": whole, "lean": None, "full": None}
        if not left_out:
            return told | {"is_done": True}
        if scene not in _kernels or step == 0:
            _kernels[scene] = costing(loaded, Settings(), 0.0, only_full=True)
        while len(_kernels) > _KEPT:
            _kernels.popitem(last=False)
        ends = time.perf_counter() + TURN_SECONDS
        costs = None
        while costs is None and time.perf_counter() < ends:
            costs = next(_kernels[scene])
        if costs is None:
            return told | {"is_done": False}
        del _kernels[scene]
        return told | {"is_done": True, "lean": asdict(costs[0]), "full": asdict(costs[-1])}
    except Exception as error:
        _kernels.pop(scene, None)
        return failure_of(error)
