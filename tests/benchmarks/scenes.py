"""The scenes that benchmarks run on, all through a box filter.

One filter for everybody: wider filters let Mitsuba share samples between pixels, which smooths its noise, while ours
gives every sample to one pixel. Errors of the two are comparable only where both do the same.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import renderer
from renderer.scene import gallery, rewrite

SHARED = Path(__file__).parents[3] / "shared" / "scenes"
SHARED_SURFACES = (
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
SMOKE = ("gallery/cornell-box", "gallery/glass-sky")


def every_scene() -> tuple[str, ...]:
    """All shared surface scenes that are there, and the gallery."""
    shared = tuple(name for name in SHARED_SURFACES if (SHARED / name / "scene.xml").is_file())
    return (*shared, *(f"gallery/{scene.name}" for scene in gallery.list_scenes()))


def source_of(name: str) -> str | Path:
    """A path, `gallery/NAME`, or a name: a shared scene where there is one of that name, else the gallery's."""
    if name.startswith("gallery/"):
        return name.removeprefix("gallery/")
    shared = SHARED / name / "scene.xml"
    return shared if shared.is_file() else name


def use_box_filters() -> None:
    """From here on, every sensor of this process has a box filter, whatever its scene says."""
    original = rewrite.sensor_dict

    def boxed(state: Any, width: int | None, height: int | None) -> dict[str, Any]:
        description = original(state, width, height)
        for part in description.values():
            if isinstance(part, dict) and "width" in part:
                for key in [k for k, v in part.items() if isinstance(v, dict)]:
                    del part[key]
                part["rfilter"] = {"type": "box"}
        return description

    rewrite.sensor_dict = boxed


def load(name: str, width: int, colour: str = "auto") -> renderer.Scene:
    """The scene at that width, its proportions kept."""
    return renderer.load_scene(source_of(name), settings=renderer.Settings(width=width, colour=colour))
