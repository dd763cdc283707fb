"""Mitsuba's `path`, rendered as fast as it can: one warm launch, without variances."""

from __future__ import annotations

import os
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

import renderer
from renderer.backend import mitsuba
from renderer.scene import rewrite
from renderer.scene.source import load_part

# Low-discrepancy samplers round the number of samples up, so each launch asks what it became.
SAMPLERS = ("independent", "multijitter", "ldsampler")
PILOT_SPP = 16
LARGEST_LAUNCH = 2**25  # samples: beyond this, memory and not speed is measured


class Peer:
    """`path` at the depth of the scene, in RGB, with one of Mitsuba's samplers."""

    def __init__(self, scene: renderer.Scene, sampler: str) -> None:
        mi = mitsuba()
        needs = scene.requirements
        if scene.colour != "rgb":
            asked = renderer.Settings(scene.width, scene.height, colour="rgb")
            scene = renderer.load_scene(scene.source, settings=asked)
        self.scene = scene
        description = rewrite.sensor_dict(scene._parsed.state, scene.width, scene.height)
        self.sensor = load_part(scene._parsed, description | {"sampler": {"type": sampler}})
        self.sensor.set_scene(scene.mitsuba_scene)
        self.integrator: Any = mi.load_dict(
            {
                "type": "volpath" if needs.media else "path",
                "max_depth": needs.max_depth,
                "rr_depth": needs.rr_depth,
                "hide_emitters": needs.hide_emitters,
            }
        )

    def calibrate(self, seconds: float) -> int:
        """Samples per pixel that take about `seconds` on all cores; leaves the kernel for that number warm."""
        self.render(PILOT_SPP, 0)
        _, took, spp = self.render(PILOT_SPP, 1)
        most = max(1, LARGEST_LAUNCH // (self.scene.width * self.scene.height))
        cores = len(os.sched_getaffinity(0))
        asked = min(most, max(1, round(spp * seconds * cores / took)))
        _, _, spp = self.render(asked, 2)
        return spp

    def render(self, spp: int, seed: int) -> tuple[NDArray[np.float64], float, int]:
        """(H, W, 3) radiance, processor seconds, samples per pixel."""
        sampler = self.sensor.sampler()
        sampler.set_sample_count(spp)
        spp = int(sampler.sample_count())
        began = time.process_time()
        image: Any = mitsuba().render(
            self.scene.mitsuba_scene, sensor=self.sensor, integrator=self.integrator, spp=spp, seed=seed
        )
        pixels = np.array(image, dtype=np.float64)
        return pixels[..., :3], time.process_time() - began, spp
