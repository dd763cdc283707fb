"""Where the passes of a render run: on this machine, or wherever a caller's launcher has them run.

Enters: a pass. Leaves: its results, once it is done. A pass depends on scene, settings and lanes alone, so its bits are
the same wherever it runs, by the same versions on the same kind of device. The render adds results in the order in
which passes were planned, whichever is done first.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from numpy.typing import NDArray

from renderer import plan

if TYPE_CHECKING:
    from renderer.equation.path import PathKernel


class Launched(Protocol):
    """A pass on its way."""

    @property
    def is_long(self) -> bool:
        """Whether it took several launches: its time says nothing of the next pass."""
        ...

    def step(self) -> bool:
        """Waits a moment; True once the pass is done."""
        ...

    def results(self) -> tuple[NDArray, NDArray, NDArray]:
        """Radiance (3, n) or (12, n), invalid samples and segments (n,) of its lanes, after `step` has said True."""
        ...


class Launcher(Protocol):
    """Where the passes of one render run."""

    @property
    def places(self) -> int:
        """Passes that run at the same time now; 0 where none can, for the moment."""
        ...

    @property
    def most_launched(self) -> int:
        """Passes to have on their way: those that run, and those that keep places from waiting for the next ones."""
        ...

    def launch(self, work: plan.Pass) -> Launched:
        """Have a pass run. Whoever drops what this returns does not want it any more."""
        ...

    def seconds_of(self, launched: Launched) -> float | None:
        """That a pass which is done took where it ran; None where that is the time since it was launched."""
        ...


class KernelLauncher:
    """Has passes run on this machine, one after the other: while one is added the next one runs."""

    places = most_launched = 1

    def __init__(self, kernel: PathKernel, seed: int) -> None:
        self._kernel, self._seed = kernel, seed

    def launch(self, work: plan.Pass) -> Launched:
        """Starts the pass's kernel."""
        if work.is_look:
            return self._kernel.look(work.pixels, self._seed)
        return self._kernel.begin(*work.lanes(), self._seed)

    def seconds_of(self, launched: Launched) -> float | None:
        """Of one pass after the other the caller's clock tells."""
        return None
