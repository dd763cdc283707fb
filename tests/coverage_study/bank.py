"""A bank of replicates: one scene's replicate means, rendered once and dealt to many independent runs.

A run of K replicates takes K that no other run takes. `BankKernel` stands in for the path kernel and deals from the
bank, so that the studied runs go through the real plan, stop rule and moments, while the light was traced in large and
fast passes. The truth is the mean over the bank, or over the part of it that a run did not take.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import renderer
from renderer.settings import Settings

SHARED = Path(__file__).parents[3] / "shared" / "scenes"
LANES = 2**18  # of one launch


@dataclass(frozen=True)
class Bank:
    """values: (replicates, pixels, 3) float32 replicate means of an image of width × height."""

    name: str
    width: int
    height: int
    size: int
    values: NDArray[np.float32]

    @property
    def n_pixels(self) -> int:
        """Pixels of the image."""
        return self.width * self.height


def source_of(name: str) -> str | Path | dict[str, Any]:
    """A rare-light scene, a shared scene, or else one of the gallery."""
    shared = SHARED / name / "scene.xml"
    return shared if shared.is_file() and not name.startswith("gallery:") else name.removeprefix("gallery:")


def fill(
    name: str, source: str | Path | dict[str, Any], pixels: int, replicates: int, settings: Settings, seed: int
) -> Bank:
    """Renders a bank of about `pixels` pixels in the scene's own aspect."""
    scene = renderer.load_scene(source)
    width = max(1, round((pixels * scene.width / scene.height) ** 0.5))
    height = max(1, round(width * scene.height / scene.width))
    scene = scene.sized(Settings(width=width, height=height))
    size = settings.replicate_size or 16
    kernel = scene.kernel(scene.resolved(settings, size))
    n = scene.width * scene.height
    values = np.empty((replicates, n, 3), np.float32)
    step = max(1, LANES // n)
    every = np.arange(n, dtype=np.uint32)
    for first in range(0, replicates, step):
        some = np.arange(first, min(first + step, replicates), dtype=np.uint32)
        radiance, _ = kernel.launch(np.tile(every, len(some)), np.repeat(some, n), seed)
        values[some] = np.array(radiance).T.reshape(len(some), n, 3)
    return Bank(name, scene.width, scene.height, size, values)
