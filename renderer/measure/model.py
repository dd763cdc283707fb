"""What the lean model buys: the kernel of a scene as it is, and with each of its omissions put back.

All kernels take turns on the same lanes, so that a busy machine slows them alike. Compile time is that of a kernel that
nobody has compiled before: its seed is written into it as a number, which makes it a new one.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import drjit as dr
import numpy as np
from rich.table import Table

from renderer.backend import mitsuba, using
from renderer.settings import DEFAULT_REPLICATE_SIZE, Settings

if TYPE_CHECKING:
    from renderer.equation.path import Model
    from renderer.scene.compile import Scene

LAUNCH_SECONDS = 0.15  # short turns: what slows the machine for a while slows all kernels alike
LEAST_ROUNDS = 9
COMPILATIONS = 5
_TOLD = {
    "has_sampleable_emitters": "emitter sampling",
    "has_lens": "a lens",
    "has_transmission": "light through surfaces",
    "has_visible_emitters": "lights that rays hit",
    "needs_time": "time within the shutter",
    "has_delta": "mirrors and clear glass",
    "has_roulette": "roulette",
    "has_tree": "a tree of the shapes",
    "needs_uv": "texture coordinates",
}


@dataclass(frozen=True, slots=True)
class KernelCost:
    """name: of the kernel. operations: in its code. compile_seconds: code and machine code, nothing cached, median.
    render_seconds: of one launch, median; processor time on a CPU. render_ratio: to the lean kernel, median over the
    rounds; low, high: its 95 % interval, in which a ratio of 1 says that nothing was measured.
    """

    name: str
    operations: int
    compile_seconds: float
    render_seconds: float
    render_ratio: float
    low: float
    high: float


def model_costs(scene: Scene, settings: Settings, seconds: float) -> list[KernelCost]:
    """The lean kernel first, then with each omission put back, then the full one. seconds: of launching each."""
    *_, costs = costing(scene, settings, seconds)
    assert costs is not None
    return costs


def costing(
    scene: Scene, settings: Settings, seconds: float, *, only_full: bool = False
) -> Iterator[list[KernelCost] | None]:
    """The same step by step, for whoever has other things to do between: a step is one compilation or one round of
    launches, and yields None; the last one yields the costs. only_full: the lean kernel and the full one alone.
    """
    resolved = scene.resolved(
        replace(settings, independent_pixels=True), settings.replicate_size or DEFAULT_REPLICATE_SIZE
    )
    tried = _kernels(scene, settings, resolved, only_full)
    compiled: list[list[tuple[int, float]]] = []
    for turn in range(COMPILATIONS):
        compiled.append([])
        for _, made, model in tried:
            compiled[-1].append(_compilation(made, model, 1 + turn))
            yield None
    lanes = _lanes_for(scene, tried[0][2], LAUNCH_SECONDS)
    rounds = []
    for turn in range(max(LEAST_ROUNDS, round(seconds / LAUNCH_SECONDS)) + 1):
        times = [_launch(made, model, lanes) for _, made, model in tried]
        if turn > 0:  # the first may compile
            rounds.append(times)
        yield None
    costs = []
    for i, (name, _, _) in enumerate(tried):
        low, middle, high = median_interval([times[i] / times[0] for times in rounds])
        compile_seconds = statistics.median(turn[i][1] for turn in compiled)
        operations = compiled[0][i][0]
        render_seconds = statistics.median(times[i] for times in rounds)
        costs.append(KernelCost(name, operations, compile_seconds, render_seconds, middle, low, high))
    yield costs


def _kernels(scene: Scene, settings: Settings, resolved: Settings, only_full: bool) -> list[tuple[str, Scene, Model]]:
    """Name, scene and model of each kernel, the lean one first."""
    from renderer.scene.compile import load_scene

    lean, full = scene.model(resolved), scene.model(resolved, full=True)
    tried: list[tuple[str, Scene, Model]] = [("lean", scene, lean)]
    left_out = omissions(lean, full)
    if not only_full:
        for name in left_out:
            tried.append((f"with {_TOLD.get(name, name)}", scene, replace(lean, **{name: getattr(full, name)})))
    if len(left_out) > 1 or (only_full and left_out):
        tried.append(("with all of these", scene, full))
    if scene.colour == "mono" and not scene.is_polarised and not only_full:
        in_rgb = load_scene(scene.source, settings=replace(settings, colour="rgb"), rewrites=scene.rewrites)
        tried.append(("with three channels", in_rgb, lean))
    return tried


def left_out_of(scene: Scene, settings: Settings) -> tuple[str, ...]:
    """What the lean kernel of a scene leaves out, in words."""
    resolved = scene.resolved(
        replace(settings, independent_pixels=True), settings.replicate_size or DEFAULT_REPLICATE_SIZE
    )
    return tuple(_TOLD.get(name, name) for name in omissions(scene.model(resolved), scene.model(resolved, full=True)))


def median_interval(values: list[float]) -> tuple[float, float, float]:
    """The median between the ends of its 95 % interval, by order statistics: no distribution is assumed."""
    n, ordered = len(values), sorted(values)
    rank = max(0, math.floor((n - 1.96 * math.sqrt(n)) / 2))
    return ordered[rank], statistics.median(ordered), ordered[n - 1 - rank]


def omissions(lean: Model, full: Model) -> list[str]:
    """Names of what the lean model leaves out."""
    return [f.name for f in fields(full) if getattr(lean, f.name) != getattr(full, f.name)]


def _compilation(scene: Scene, model: Model, turn: int) -> tuple[int, float]:
    """Operations and seconds of compiling the kernel anew."""
    kernel = scene.kernel_of(model)
    with using(scene.variant), dr.suspend_grad(), dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        mi = mitsuba()
        lane = dr.opaque(mi.UInt32, 0, 16)
        anew = mi.UInt32((time.time_ns() // 1000) % 2**31 + turn)  # no opaque: part of the code
        dr.kernel_history_clear()
        dr.eval(kernel._run(lane, lane, (anew, mi.UInt32(turn)), kernel.sizes, None, None))
        dr.sync_thread()
        found = max(dr.kernel_history(), key=lambda k: k.get("operation_count", 0))
    return int(found["operation_count"]), (found["codegen_time"] + found["backend_time"]) / 1000


def _lanes_for(scene: Scene, model: Model, seconds: float) -> int:
    """Lanes that the kernel takes about `seconds` for: whole pictures."""
    n = scene.width * scene.height
    _launch(scene, model, n)
    took = _launch(scene, model, n)
    return n * max(1, round(seconds / took))


def _launch(scene: Scene, model: Model, lanes: int) -> float:
    """Seconds of one launch."""
    index = np.arange(lanes, dtype=np.uint32)
    n = scene.width * scene.height
    # Other processes on the same cores do not count.
    clock = time.process_time if scene.variant.startswith("llvm") else time.perf_counter
    began = clock()
    scene.kernel_of(model).launch(index % n, index // n, 1)
    return clock() - began


def model_table(scene: Scene, costs: list[KernelCost]) -> Table:
    """One line per kernel: what putting an omission back costs is what leaving it out saves."""
    lean = costs[0]
    table = Table(title=f"{scene.name}, {scene.width}×{scene.height}, {scene.colour}", title_justify="left")
    table.add_column("kernel")
    for column in ("operations", "compile s", "saved s", "render ms", "saved", "(95 %)"):
        table.add_column(column, justify="right", no_wrap=True)
    for cost in costs:
        cells = [f"{cost.operations:,}", f"{cost.compile_seconds:.2f}"]
        if cost is lean:
            cells += ["", f"{1000 * cost.render_seconds:.0f}", "", ""]
        else:
            saved, low, high = (f"{100 * (1 - 1 / ratio):+.0f} %" for ratio in (cost.render_ratio, cost.low, cost.high))
            cells += [f"{cost.compile_seconds - lean.compile_seconds:+.2f}", f"{1000 * cost.render_seconds:.0f}", saved]
            cells.append(f"{low} … {high}")
        table.add_row(cost.name, *cells, style="bold" if cost is lean else None)
    return table


def as_dict(scene: Scene, costs: list[KernelCost]) -> dict[str, Any]:
    """Plain values, for a file."""
    head = {"scene": scene.name, "digest": scene.digest, "width": scene.width, "height": scene.height}
    return head | {"colour": scene.colour, "kernels": [asdict(cost) for cost in costs]}
