"""The scenes that benchmarks run on: as their authors wrote them, or boxed, with a box filter whatever they say.

Constants of ours were tuned with some of them at hand. What the others show is what scenes show that people bring.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import renderer
from renderer.scene import gallery, rewrite

SHARED = Path(__file__).parents[3] / "shared" / "scenes"
TUNED_ON = (
    "cornell-box",
    "veach-mis",
    "veach-bidir",
    "veach-ajar",
    "matpreview",
    "thinlens",
    "living-room",
    "cbox-glass-mirror",
    "sdf-instance",
    "room-indirect",
    "room-manylights",
    "caustic-ring",
    "pool",
)
JUDGED_ON = ("dining-room", "staircase2", "lamp", "bistro-chalice", "colour-cornell")
SHARED_SURFACES = TUNED_ON
WITH_MEDIA = ("fog", "smoke", "cloudy-glass")  # that Mitsuba's `path` leaves out: see `media`
SMOKE = ("gallery/cornell-box", "gallery/glass-sky")


def every_scene() -> tuple[str, ...]:
    """All shared surface scenes that are there, those to judge on first, and the gallery."""
    shared = tuple(name for name in (*JUDGED_ON, *TUNED_ON) if (SHARED / name / "scene.xml").is_file())
    return (*shared, *(f"gallery/{scene.name}" for scene in gallery.list_scenes() if scene.name not in WITH_MEDIA))


def source_of(name: str) -> str | Path:
    """A path, `gallery/NAME`, or a name: a shared scene where there is one of that name, else the gallery's."""
    if name.startswith("gallery/"):
        return name.removeprefix("gallery/")
    shared = SHARED / name / "scene.xml"
    return shared if shared.is_file() else name


@contextmanager
def box_filters() -> Iterator[None]:
    """Inside, every sensor of this process has a box filter, whatever its scene says."""
    original = rewrite.sensor_dict

    def boxed(state: Any, width: int | None, height: int | None, index: int = 0) -> dict[str, Any]:
        description = original(state, width, height, index)
        for part in description.values():
            if isinstance(part, dict) and "width" in part:
                for key in [k for k, v in part.items() if isinstance(v, dict)]:
                    del part[key]
                part["rfilter"] = {"type": "box"}
        return description

    rewrite.sensor_dict = boxed
    try:
        yield
    finally:
        rewrite.sensor_dict = original


def is_boxed(scene: renderer.Scene) -> bool:
    """Whether a loaded scene's film has a box filter."""
    return bool(scene.sensor.film().rfilter().is_box_filter())


def load(name: str, width: int, colour: str = "auto") -> renderer.Scene:
    """The scene at that width, its proportions kept."""
    return renderer.load_scene(source_of(name), settings=renderer.Settings(width=width, colour=colour))
