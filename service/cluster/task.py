"""What a worker does when it is asked: it hands a pass to its render process, takes scenes in, and gives passes up.

Runs in the worker's event loop, which so stays free: a kernel that hangs or a scene that crashes costs the render
process alone, and the scheduler hears from the worker all the while.
"""

from __future__ import annotations

import asyncio
from pathlib import Path

from distributed import get_worker

from service.cluster.render_pass import failed, render_pass
from service.cluster.scenes import SceneCache, SceneRefused
from service.cluster.wire import pack, unpack
from service.crashes import shown_words
from service.engine.interface import Lost
from service.engine.local import LocalEngine
from service.engine.turn import Failure

PASS_SECONDS = 1800.0  # after which a pass hangs: those of closed white rooms have taken minutes


class Place:
    """What one worker renders with. name: of the worker. folder: its own."""

    def __init__(self, name: str, folder: Path, cache_bytes: int) -> None:
        self.name = name
        self.engine = LocalEngine("render", folder / "process")
        self.scenes = SceneCache(folder, cache_bytes)
        self.rendering: str | None = None  # name of the pass


_places: list[Place] = []  # one, of this process


def settle(place: Place) -> None:
    """Have this process render at this place."""
    _places[:] = [place]


async def render(name: str, message: bytes) -> bytes:
    """The answer to a pass: its results, or that its scene is missing here, or why there are none."""
    place, (told, _) = _places[0], unpack(message)
    job = told["job"]
    path: Path | str | None
    try:
        path = str(job["scene"]) if job["is_gallery"] else place.scenes.path(job["scene"])
    except SceneRefused as error:
        return failed(Failure("The scene could not be read", str(error), "Upload it again."))
    if path is None:
        return pack({"state": "missing", "worker": get_worker().address})
    place.rendering = name
    try:
        return await place.engine.submit(render_pass, message, str(path), place.name, deadline=PASS_SECONDS)
    except Lost as lost:
        return pack({"state": "lost", "why": str(lost), "words": shown_words(lost.last_words)})
    finally:
        place.rendering = None


async def take_scene(scene: str, at: int, part: bytes, is_last: bool) -> None:
    """A part of a scene's files."""
    await asyncio.to_thread(_places[0].scenes.take, scene, at, part, is_last)


async def give_up(names: set[str]) -> None:
    """Nobody wants these passes any more: end the one that is being rendered, if it is among them."""
    if _places and _places[0].rendering in names:
        _places[0].engine.kill()
