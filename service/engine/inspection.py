"""Runs inside the process that checks scenes: untrusted input is parsed and loaded there and nowhere else.

Whatever such a scene does to its process, no render and no request is lost by it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from service.engine.turn import SceneFacts
from service.engine.worker import failure_of

if TYPE_CHECKING:
    from renderer.scene.limits import SceneLimits


_is_prepared = False


def prepare(memory_bytes: int) -> None:
    """Import the renderer and choose its backend; then bound what the process may take beyond that.

    memory_bytes: estimate that a scene may reach.
    """
    global _is_prepared
    if _is_prepared:
        return
    from renderer.scene import report

    report.inspect_scene("furnace")  # whatever is loaded on first use is loaded now
    # Twice what is allowed: an estimate is one, and loading takes copies.
    _bound_memory(2 * memory_bytes)
    _is_prepared = True


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


def inspect_upload(path: str, memory_bytes: int) -> SceneFacts:
    """Load an uploaded scene and tell what it is, or why it is refused. Its files must lie in its own folder."""
    from renderer.scene.limits import UNTRUSTED

    prepare(memory_bytes)
    return _facts(path, replace(UNTRUSTED, memory_bytes=memory_bytes))


def inspect_built_in(name: str, memory_bytes: int) -> SceneFacts:
    """What a scene of the gallery requires."""
    prepare(memory_bytes)
    return _facts(name, None)


def _facts(source: str, limits: SceneLimits | None) -> SceneFacts:
    from renderer.scene.report import inspect_scene, refuse

    try:
        found = inspect_scene(source, limits)
        refuse(found)
    except Exception as error:
        return SceneFacts(failure=failure_of(error))
    return SceneFacts(found["width"], found["height"], found["digest"], tuple(found["warnings"]), found)
