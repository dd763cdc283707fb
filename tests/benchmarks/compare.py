"""One scene: Fredholm and Mitsuba's `path` taking turns in one process, both warm.

Rates are samples per second, ours with variances, theirs without, all pixels alike: adaptive sampling seeks out the
pixels whose paths are long. Errors are those of the defaults, relMSE against one reference, scaled to
equal time: squared error times seconds does not depend on when one stops. Seconds are the processor's, all cores
together: what else the machine does counts for neither.
"""

from __future__ import annotations

import math
import statistics
import time
from dataclasses import dataclass, replace
from typing import Any

from scipy.stats import t

import renderer
from tests.benchmarks import scenes
from tests.benchmarks.first_picture import first_picture
from tests.benchmarks.peer import SAMPLERS, Peer
from tests.benchmarks.ray_limit import RayCasts
from tests.benchmarks.reference import Reference, converged
from tests.benchmarks.scenes import load

WARM_UP_SECONDS = 0.3
WIDE = 2.0  # ratio of the extreme rounds from which they say nothing: then renders take
LONGER, LONG_REFERENCE = 10, 6  # times as long, the reference, too


@dataclass(frozen=True)
class Effort:
    """width: of the image in pixels. seconds: of each render. reference_seconds: of the reference."""

    width: int = 128
    seconds: float = 2.0
    rounds: int = 5
    reference_seconds: float = 10.0
    keep_reference: bool = True
    samplers: tuple[str, ...] = SAMPLERS


def compare(name: str, effort: Effort) -> dict[str, Any]:
    """Rates, errors at equal time and their ratios; above 1 Fredholm is better. Medians over the rounds.

    Where rounds differ much a few fireflies decide: then all is measured again in renders so long that they have more.
    """
    row = _compare(name, effort)
    low, high = row["error_ratio_range"]
    if effort.rounds > 1 and not 0 < high <= WIDE * low:
        seconds, reference = LONGER * effort.seconds, LONG_REFERENCE * effort.reference_seconds
        row = _compare(name, replace(effort, seconds=seconds, reference_seconds=reference))
    row["boxed_error_ratio"] = row["error_ratio"]
    if not scenes.is_boxed(scenes.load(name, 16)):
        with scenes.box_filters():
            row["boxed_error_ratio"] = _compare(name, replace(effort, samplers=effort.samplers[:1]))["error_ratio"]
    return row | {"asked_seconds": effort.seconds, "rounds": effort.rounds}


def interval_of(ratios: list[float], confidence: float = 0.95) -> tuple[float, float]:
    """Of the ratio, over independent rounds: Student's t of their logarithms. Of fewer than two nothing is known."""
    if len(ratios) < 2 or min(ratios) <= 0:
        return 0.0, math.inf
    logs = [math.log(ratio) for ratio in ratios]
    half = float(t.ppf(0.5 + confidence / 2, len(logs) - 1)) * statistics.stdev(logs) / math.sqrt(len(logs))
    return math.exp(statistics.fmean(logs) - half), math.exp(statistics.fmean(logs) + half)


def _compare(name: str, effort: Effort) -> dict[str, Any]:
    scene = load(name, effort.width)
    reference = converged(scene, effort.reference_seconds, effort.keep_reference)
    in_rgb = load(name, effort.width, "rgb")  # as its users have it; ours takes mono where nothing is coloured
    peers = {sampler: Peer(in_rgb, sampler) for sampler in effort.samplers}
    spp = {sampler: peer.calibrate(effort.seconds) for sampler, peer in peers.items()}

    rates: dict[str, list[float]] = {who: [] for who in ("fredholm", *peers)}
    images: dict[str, list[tuple[Any, float]]] = {who: [] for who in ("fredholm", *peers)}  # and their seconds
    n = scene.width * scene.height
    casts, cast_seconds = RayCasts(scene), []
    # Last, for every scene that is loaded makes Dr.Jit compile anew what calls its plugins.
    _ours(scene, WARM_UP_SECONDS, 0)
    for turn in range(1, effort.rounds + 1):
        cast_seconds.append(casts.seconds())
        estimate, took = _ours(scene, effort.seconds, turn, adaptive=False)
        rates["fredholm"].append(estimate.samples / took)
        estimate, took = _ours(scene, effort.seconds, turn)
        images["fredholm"].append((estimate.mean, took))
        for sampler, peer in peers.items():
            image, took, done = peer.render(spp[sampler], turn)
            rates[sampler].append(done * n / took)
            images[sampler].append((image, took))
    errors = {who: [reference.rel_mse(image) * took for image, took in some] for who, some in images.items()}
    typical = {who: [reference.typical_rel_mse(image) * took for image, took in some] for who, some in images.items()}

    plain = effort.samplers[0]
    ours_at_equal_time = statistics.median(errors["fredholm"])
    at_equal_time = {s: statistics.median(errors[s]) for s in peers}
    turns = [a / b for a, b in zip(errors[plain], errors["fredholm"], strict=True)]
    best = min(at_equal_time, key=at_equal_time.__getitem__)
    rate = statistics.median(rates["fredholm"])
    share = statistics.median(r * cast for r, cast in zip(rates["fredholm"], cast_seconds, strict=True))
    return {
        "scene": name,
        "width": scene.width,
        "height": scene.height,
        "colour": scene.colour,
        "max_depth": scene.requirements.max_depth,
        "seconds": effort.seconds,
        "samples_per_second": rate,
        "rays_per_sample": casts.rays,
        "rays_per_second": rate * casts.rays,
        "ray_limit_share": share,
        "curve": _curve(scene, reference, effort),
        **first_picture(name, effort.width, effort.seconds),
        "path_samples_per_second": statistics.median(rates[plain]),
        "rate_ratio": statistics.median(a / b for a, b in zip(rates["fredholm"], rates[plain], strict=True)),
        "rel_mse": ours_at_equal_time / effort.seconds,
        "path_rel_mse": {s: v / effort.seconds for s, v in at_equal_time.items()},
        "path_sampler_rates": {s: statistics.median(rates[s]) for s in peers},
        "error_ratio": at_equal_time[plain] / ours_at_equal_time,
        "error_ratio_range": [min(turns), max(turns)],
        "error_ratio_interval": list(interval_of(turns)),
        "typical_error_ratio": statistics.median(typical[plain]) / statistics.median(typical["fredholm"]),
        "typical_error_ratio_to_best": statistics.median(typical[best]) / statistics.median(typical["fredholm"]),
        "error_ratio_to_best": at_equal_time[best] / ours_at_equal_time,
        "best_sampler": best,
        "reference_share": reference.own_rel_mse * effort.seconds / max(ours_at_equal_time, 1e-30),
    }


def _curve(scene: renderer.Scene, reference: Reference, effort: Effort) -> list[list[float]]:
    """[seconds, relMSE] of one render, each point at least half as late again as the one before."""
    settings = renderer.Settings(scene.width, scene.height, effort.rounds + 1)
    points: list[list[float]] = []
    for snapshot in renderer.progressive(scene, renderer.Target(seconds=effort.seconds), settings):
        if snapshot.stopped_by or not points or snapshot.seconds >= 1.5 * points[-1][0]:
            points.append([snapshot.seconds, reference.rel_mse(snapshot.estimate.mean)])
    return points


def _ours(scene: renderer.Scene, seconds: float, seed: int, adaptive: bool = True) -> tuple[renderer.Estimate, float]:
    settings = renderer.Settings(scene.width, scene.height, seed, adaptive=adaptive)
    began = time.process_time()
    estimate = renderer.render(scene, renderer.Target(seconds=seconds), settings)
    return estimate, time.process_time() - began
