"""What adaptive sampling gains at equal time: relative squared error × seconds, uniform over adaptive."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

import renderer
from renderer.estimate.error import floor_of
from renderer.settings import Settings
from tests.coverage_study.bank import source_of

REFERENCE_SPP = 2048
SPP = 1024
REFERENCE_SEED = 77


@dataclass(frozen=True)
class Gain:
    """samples: ratio of errors at equal samples. time: at equal processor time. error: relative, of uniform runs."""

    samples: float
    time: float
    error: float


def measure(name: str, pixels: int, runs: int) -> Gain:
    """The error of a run is that expected of its counts, with the variance of each pixel from a reference of its own:
    counts do not follow from the values they are applied to, and the ratio has far less noise than that of two images.
    """
    scene = renderer.load_scene(source_of(name))
    width = max(1, round((pixels * scene.width / scene.height) ** 0.5))
    scene = scene.sized(Settings(width=width))
    target = renderer.Target(spp=REFERENCE_SPP)
    reference = renderer.render(scene, target, _settings(scene, REFERENCE_SEED, False)).moments
    per_replicate = np.mean(reference.variance()[:, :3] / (reference.mean**2 + floor_of(reference.mean)), axis=1)
    errors, seconds = np.zeros((2, runs)), np.zeros((2, runs))
    renderer.render(scene, renderer.Target(spp=64), _settings(scene, 1, True))  # warm
    for run in range(runs):
        for i, adaptive in enumerate((False, True)):
            began = time.process_time()
            counts = renderer.render(scene, renderer.Target(spp=SPP), _settings(scene, run, adaptive)).moments.count
            seconds[i, run] = time.process_time() - began
            errors[i, run] = float(np.mean(per_replicate / counts))
    uniform, adapted = errors.mean(axis=1)
    pace = seconds.min(axis=1)  # what disturbs a run only adds to its time
    return Gain(uniform / adapted, uniform * pace[0] / (adapted * pace[1]), float(np.sqrt(uniform)))


def _settings(scene: renderer.Scene, seed: int, adaptive: bool) -> Settings:
    return Settings(scene.width, scene.height, seed, replicate_size=16, adaptive=adaptive)
