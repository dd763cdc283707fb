"""Asked error against true error: how often the stop rule keeps its word, and what it spends."""

from __future__ import annotations

from dataclasses import dataclass
from unittest.mock import patch

import numpy as np

import renderer
from renderer import plan, progress
from renderer.estimate.error import floor_of
from renderer.estimate.forecast import Forecast
from renderer.scene.compile import Scene
from tests.coverage_study.bank import Bank, BankKernel
from tests.stand_ins import Rendered

FORECAST_FROM, FORECAST_BEFORE = 0.1, 0.5  # of the run
NEAR = 0.25
FIRST_PASS, LATER_PASS = 0.25, 0.5  # of the image's replicates, as in images of the usual size


@dataclass(frozen=True)
class Stopping:
    """reached: share of runs whose true error was below the target. spent: mean samples over those of an oracle, which
    knows after how many samples 95 % of the runs are below it. spp: mean samples per pixel. forecasts: share of runs
    that had one after a tenth of their samples, or after more but less than half; near: share of those within 25 % of
    the truth, held: with the truth in their 95 % interval.
    """

    target: float
    runs: int
    reached: float
    spent: float
    spp: float
    forecasts: float
    near: float
    held: float


def true_error(bank: Bank, mean: np.ndarray) -> float:
    """Relative error of an image against the bank's mean."""
    return float(np.sqrt(np.mean((mean - bank.mean) ** 2 / (bank.mean**2 + floor_of(bank.mean)))))


def measure(bank: Bank, target: float, runs: int, adaptive: bool = True) -> Stopping:
    """Independent runs to one target. Render time is samples here: dealing from a bank has no other."""
    kernel = BankKernel(bank)
    reached, spent, forecasts, curves = [], [], [], []
    with patch.object(Scene, "kernel", lambda self, settings: kernel):
        for run in range(runs):
            settings = renderer.Settings(**{**bank.settings.as_dict(), "seed": 5000 + run, "adaptive": adaptive})
            curve: list[tuple[float, float]] = []
            said: list[tuple[float, Forecast]] = []
            last = None
            for last in _rounds(bank, target, settings):
                curve.append((last.spp, true_error(bank, last.estimate.moments.mean)))
                if last.forecast is not None:
                    said.append((last.spp, last.forecast))
            assert last is not None
            reached.append(curve[-1][1] <= target)
            spent.append(last.spp)
            curves.append(curve)
            forecasts.append(_forecast_totals(said, last.spp))
    known = [f for f in forecasts if f is not None]
    return Stopping(
        target=target,
        runs=runs,
        reached=float(np.mean(reached)),
        spent=float(np.mean(spent)) / _oracle(curves, target),
        spp=float(np.mean(spent)),
        forecasts=len(known) / runs,
        near=float(np.mean([abs(total - 1) <= NEAR for total, *_ in known])) if known else float("nan"),
        held=float(np.mean([low <= 1 <= high for _, low, high in known])) if known else float("nan"),
    )


def _rounds(bank: Bank, target: float, settings: renderer.Settings):
    """Snapshots of a run at every planned checkpoint, with time counted in samples per pixel."""
    n = bank.values.shape[1]
    size = bank.settings.replicate_size or 1

    class Clock:
        """A clock that the samples drive: forecasts are then about the curve, not about this machine."""

        now = 0.0

        def perf_counter(self) -> float:
            return self.now

        def monotonic(self) -> float:
            return self.now

    clock = Clock()
    inner = BankKernel(bank)

    class Timed(Rendered):
        """What a pass will have rendered: the clock goes on when somebody waits for it."""

        def __init__(self, pixels, replicates, seed) -> None:
            super().__init__(inner.launch(pixels, replicates, seed))
            self.seconds = len(pixels) * size / n

        def step(self) -> bool:
            clock.now += self.seconds
            return True

    class TimedKernel:
        has_stokes = False

        begin = Timed

        @staticmethod
        def look(pixels, seed):
            return Timed(pixels, np.zeros(len(pixels), np.uint32), seed)

    with (
        patch.object(progress, "time", clock),
        patch.object(progress, "MIN_SNAPSHOT_SECONDS", 0.0),
        patch.object(progress, "MAX_SNAPSHOT_SECONDS", 0.0),
        patch.object(plan, "FIRST_SAMPLES", int(FIRST_PASS * n * size)),
        patch.object(plan, "MIN_PASS_SAMPLES", int(LATER_PASS * n * size)),
        patch.object(Scene, "kernel", lambda self, settings: TimedKernel),
    ):
        goal = renderer.Target(error=target, spp=len(bank.values) * 4 * size)
        yield from renderer.progressive(bank.scene, goal, settings)


def _forecast_totals(said: list[tuple[float, Forecast]], end: float) -> tuple[float, float, float] | None:
    """Forecast total over true total, and its interval, by the first forecast that is early enough; None without it."""
    for at, left in said:
        if FORECAST_FROM * end <= at <= FORECAST_BEFORE * end:
            return (at + left.seconds_left) / end, (at + left.low) / end, (at + left.high) / end
    return None


def _oracle(curves: list[list[tuple[float, float]]], target: float) -> float:
    """Samples per pixel after which 95 % of the runs are below the target, from each run's own error curve.

    Between checkpoints error² falls like 1/samples.
    """
    needed = [spp * (error / target) ** 2 for curve in curves for spp, error in curve[-3:]]
    return float(np.quantile(needed, 0.95))
