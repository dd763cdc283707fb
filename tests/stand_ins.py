"""What stands in for the path kernel where a test wants to know each lane."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np


class Rendered:
    """Stands in for `renderer.equation.launch.Launch`: a pass that is over once it has begun."""

    is_long = False

    def __init__(self, results: tuple[Any, ...]) -> None:
        self._results = results

    def step(self) -> bool:
        return True

    def results(self) -> tuple[Any, ...]:
        return self._results


class _Launches(Protocol):
    def launch(self, pixels: Any, replicates: Any, seed: int) -> tuple[Any, ...]: ...


class Begins:
    """Gives a stand-in that has `launch` the `begin` of the path kernel."""

    has_stokes = False

    def begin(self: _Launches, pixels: Any, replicates: Any, seed: int) -> Rendered:
        return Rendered(self.launch(pixels, replicates, seed))

    def look(self: _Launches, pixels: Any, seed: int) -> Rendered:
        return Rendered(self.launch(pixels, np.zeros_like(pixels), seed))
