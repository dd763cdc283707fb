"""What a group of lights can do, all of which are sampled in the same way.

To add one: a class with these methods, a line in `scene_lights.py` that says which lights are its own, and a case in
`tests/statistical/test_emitter_sampling.py`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import drjit as dr

from renderer.backend import mitsuba

mi: Any = mitsuba()


@dataclass(frozen=True)
class Spot:
    """A direction on the map. patch: its number. radiance: a spectrum. density: per solid angle, within the patch."""

    patch: Any
    radiance: Any
    density: Any


@dataclass(frozen=True)
class Hit:
    """A light that a ray has met. index: its number in the choice among all. is_listed: whether it is among them.

    group: the number of its group, None where there is just one. row: its number within that. spot: where on an
    environment map, None in scenes without one.
    """

    emitter: Any
    index: Any
    is_listed: Any
    group: Any
    row: Any
    spot: Spot | None


class LightGroup(Protocol):
    """Some of the lights of a scene. Rows count them from 0; ref is the point to be lit."""

    tells_radiance: bool  # whether `emission` knows more than Mitsuba's plugin does

    def sample(self, ref: Any, row: Any, emitter: Any, u: Any, active: Any, /) -> tuple[Any, Any]:
        """A point on a light as seen from ref, visibility not tested. Returns (DirectionSample3f, radiance / pdf)."""
        ...

    def pdf(self, ref: Any, ds: Any, si: Any, hit: Hit, active: Any, /) -> Any:
        """Solid-angle density with which `sample` at ref finds the hit `si`, which is `ds` as seen from there."""
        ...

    def emission(self, si: Any, hit: Hit, active: Any, /) -> Any:
        """Radiance of a light that was hit, back along the ray; asked where `tells_radiance`."""
        ...


def take(ds: Any, other: Any, where: Any) -> None:
    """Fills in a direction sample from another one."""
    for name in ("p", "n", "d", "dist", "pdf", "delta"):
        setattr(ds, name, dr.select(where, getattr(other, name), getattr(ds, name)))
