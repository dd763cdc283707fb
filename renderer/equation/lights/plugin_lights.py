"""Lights that are sampled by their plugins: spots, points, suns, uneven skies, and whatever else Mitsuba has."""

from __future__ import annotations

from typing import Any

from renderer.equation.lights.group import Hit
from renderer.equation.mueller import intensity


class PluginLights:
    """emitters: in the order of their rows. One alone becomes part of the code, without a call that could be any's."""

    tells_radiance = False

    def __init__(self, emitters: list[Any]) -> None:
        self._alone = emitters[0] if len(emitters) == 1 else None

    def sample(self, ref: Any, row: Any, emitter: Any, u: Any, active: Any) -> tuple[Any, Any]:
        """As `LightGroup.sample`."""
        ds, weight = self._asked(emitter).sample_direction(ref, u, active)
        return ds, intensity(weight)

    def pdf(self, ref: Any, ds: Any, si: Any, hit: Hit, active: Any) -> Any:
        """As `LightGroup.pdf`."""
        return self._asked(hit.emitter).pdf_direction(ref, ds, active)

    def emission(self, si: Any, hit: Hit, active: Any) -> Any:
        """As `LightGroup.emission`."""
        return intensity(self._asked(hit.emitter).eval(si, active))

    def _asked(self, emitter: Any) -> Any:
        return emitter if self._alone is None else self._alone
