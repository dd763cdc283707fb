"""Runs inside the process that checks scenes: untrusted input is parsed and loaded there and nowhere else.

Whatever such a scene does to its process, no render and no request is lost by it.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from service.engine import sandbox
from service.engine.turn import SceneFacts
from service.engine.worker import failure_of
from service.store.records import NO_PARAMETERS
from service.without_paths import without_paths

if TYPE_CHECKING:
    from renderer.scene.limits import SceneLimits


_FILE_BYTES, _OPEN_FILES = 256 << 20, 512
_is_prepared = False


def prepare(folder: str, memory_bytes: int, is_confined: bool) -> list[str]:
    """Give up what checking scenes does not need, import the renderer, and bound what the process may take beyond that.

    folder: of this process, with `incoming`, where scenes come in, `home`, where compiled kernels are kept apart from
    those of the renderer, and `empty`, to work in. memory_bytes: estimate that a scene may reach. is_confined: give up
    files and calls. Returns what the system could not do.
    """
    global _is_prepared
    if _is_prepared:
        return []
    # Before Mitsuba is imported: it looks for files where it was.
    os.environ["HOME"] = os.environ["TMPDIR"] = f"{folder}/home"
    os.chdir(f"{folder}/empty")
    lacks = sandbox.bound_resources(_FILE_BYTES, _OPEN_FILES)
    if is_confined:
        from renderer.backend import choose_llvm

        choose_llvm()
        # Before the first thread begins; it and all others then are confined too.
        readable = [*sandbox.programs(), Path(folder, "incoming"), Path(folder, "empty")]
        lacks += sandbox.confine_files(readable, [Path(folder, "home")])
    from renderer.scene import report

    report.inspect_scene("furnace")  # whatever is loaded on first use is loaded now
    if is_confined:
        lacks += sandbox.confine_calls(may_start_programs=False)
    # Twice what is allowed: an estimate is one, and loading takes copies.
    _bound_memory(2 * memory_bytes)
    _is_prepared = True
    return lacks


def _bound_memory(more_bytes: int) -> None:
    """Let the process grow by so much and no more: an allocation beyond that fails instead of filling the machine."""
    try:
        import resource

        with open("/proc/self/statm") as statm:
            pages = int(statm.read().split()[5])
    except (ImportError, OSError):  # only Linux says how much there is
        return
    limit = pages * resource.getpagesize() + more_bytes
    resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))


def inspect_upload(
    folder: str, scene: str, memory_bytes: int, parameters: Mapping[str, str] = NO_PARAMETERS
) -> SceneFacts:
    """Load an uploaded scene and tell what it is, or why it is refused. Its files must lie in the folder of the upload.

    scene: its file, relative to that folder. parameters: values for those that it has.
    """
    from renderer.scene.limits import UNTRUSTED

    path = Path(folder, scene)
    limits = replace(UNTRUSTED, memory_bytes=memory_bytes, root=Path(folder))
    return _facts(path, limits, str(path.parent), folder, parameters=parameters)


def inspect_built_in(name: str) -> SceneFacts:
    """What a scene of the gallery requires."""
    return _facts(name, None)


def _facts(
    path: str | Path, limits: SceneLimits | None, *roots: str, parameters: Mapping[str, str] = NO_PARAMETERS
) -> SceneFacts:
    from renderer.scene.parameters import SceneFile
    from renderer.scene.report import inspect_scene, refuse

    try:
        found = inspect_scene(SceneFile(path, parameters) if parameters else path, limits)
        refuse(found)
    except Exception as error:
        return SceneFacts(failure=failure_of(error, *roots))
    found |= {kind: tuple(without_paths(one, roots) for one in found[kind]) for kind in ("warnings", "notes")}
    return SceneFacts(found["width"], found["height"], found["digest"], found["warnings"], found)
