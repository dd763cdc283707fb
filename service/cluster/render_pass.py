"""Runs inside a worker's render process: one pass, from its message to its results."""

from __future__ import annotations

import json
import time
from collections import OrderedDict
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from service.cluster.wire import narrowed, pack, unpack
from service.engine import worker
from service.engine.turn import Failure

if TYPE_CHECKING:
    from renderer.launcher import Launcher

_KEPT_JOBS = 8
_ready: OrderedDict[str, Launcher] = OrderedDict()  # by what they render


def kind_of_worker() -> str:
    """Versions and kind of device that this process renders with, as estimates name them."""
    from renderer.backend import made_with, variant_for

    return made_with(variant_for("auto", is_coloured=True))


def render_pass(message: bytes, path: str, name: str) -> bytes:
    """The results of a pass, or why there are none. path: of its scene's file, or the name of a gallery scene.
    name: of the worker.
    """
    began = time.perf_counter()
    told, arrays = unpack(message)
    try:
        launcher = _launcher_of(told["job"], path)
        if isinstance(launcher, Failure):
            return failed(launcher)
        began = time.perf_counter()  # loading says nothing of the next pass
        radiance, invalid, segments = _rendered(launcher, told, arrays)
    except Exception as error:
        return failed(worker.failure_of(error))
    seconds = time.perf_counter() - began
    worker.trim_heap()
    if len(radiance) == 3 and _is_grey(radiance):
        radiance = radiance[:1]
    counts = {"invalid": narrowed(invalid), "segments": narrowed(segments)}
    return pack({"state": "done", "seconds": seconds, "worker": name}, radiance=radiance, **counts)


def _is_grey(radiance: NDArray[np.float32]) -> bool:
    """Whether all three channels have the same bits."""
    bits = np.ascontiguousarray(radiance).view(np.uint32)
    return bool((bits[:1] == bits[1:]).all())


def failed(failure: Failure) -> bytes:
    """The message that says why there are no results."""
    return pack({"state": "failed", "failure": asdict(failure)})


def _rendered(launcher: Launcher, told: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> Any:
    from renderer import plan

    first, n_replicates = (told[name] if name in told else arrays[name] for name in ("first", "n_replicates"))
    work = plan.Pass(arrays["pixels"].astype(np.uint32), first, n_replicates, is_look=told["is_look"])
    launched = launcher.launch(work)
    while not launched.step():
        pass
    return launched.results()


def _launcher_of(job: dict[str, Any], path: str) -> Launcher | Failure:
    """What renders passes of a job; the scene is loaded and the kernel traced once."""
    import renderer
    from renderer.launcher import KernelLauncher

    key = json.dumps(job, sort_keys=True)
    if key not in _ready:
        settings = renderer.Settings(**job["settings"])
        scene = worker.kept_scene(path, settings, job["parameters"])
        if scene.digest != job["digest"]:
            return _other("the scene", scene.digest[:12], job["digest"][:12])
        kernel = scene.kernel(settings)
        if job["guide"] is not None and kernel.guide_digest != job["guide"]:
            return _other("what was learned of its light", str(kernel.guide_digest)[:12], job["guide"][:12])
        _ready[key] = KernelLauncher(kernel, settings.seed)
        while len(_ready) > _KEPT_JOBS:
            _ready.popitem(last=False)
    _ready.move_to_end(key)
    return _ready[key]


def _other(what: str, found: str, wanted: str) -> Failure:
    return Failure(
        "A worker has another scene",
        f"On a worker of the cluster {what} has the digest {found}, and here {wanted}: the bits would not be those of "
        "one machine.",
        "Install the same versions on all machines; if that is so, clear the folder of that worker and submit again.",
    )
