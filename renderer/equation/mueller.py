"""Polarised light: what spectra are in polarised variants, behind the same names as in all others.

Light is a Stokes vector there, and a path's throughput a Mueller matrix, in the frames of Mitsuba: that of a direction
follows from the direction alone, `mueller.stokes_basis`. Lights of Mitsuba 3.9 are unpolarised, so of what a path
brings the first column of its matrix is enough: `Stokes`. In other variants all of this is one spectrum, and these
functions are the products and sums that they stand for, in the same order: no bit depends on them.
Sources: Collett 2005, Field Guide to Polarization; Mitsuba 3, "Polarized rendering".
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from renderer.backend import mitsuba
from renderer.equation.tables import number

mi: Any = mitsuba()

COMPONENTS = 4  # of a Stokes vector


class Stokes:
    """S0 … S3, each a spectrum or a colour: what light is to sums and to products with numbers."""

    DRJIT_STRUCT: dict[str, Any]
    s0: Any
    s1: Any
    s2: Any
    s3: Any

    @property
    def parts(self) -> tuple[Any, Any, Any, Any]:
        """S0, S1, S2, S3."""
        return self.s0, self.s1, self.s2, self.s3

    @classmethod
    def of(cls, parts: Any) -> Stokes:
        """Of four spectra or colours."""
        made = cls()
        made.s0, made.s1, made.s2, made.s3 = parts
        return made

    def __add__(self, other: Stokes) -> Stokes:
        return self.of([a + b for a, b in zip(self.parts, other.parts, strict=True)])

    def __mul__(self, factor: Any) -> Stokes:
        return self.of([one * factor for one in self.parts])

    def __setitem__(self, where: Any, other: Any) -> None:
        for i, mine in enumerate(self.parts):
            mine[where] = other.parts[i] if isinstance(other, Stokes) else other


@cache
def stokes_of(kind: type) -> type[Stokes]:
    """Stokes vectors of a spectrum or colour type of some variant."""
    return type("Stokes", (Stokes,), {"DRJIT_STRUCT": {f"s{i}": kind for i in range(COMPONENTS)}})


def each(function: Callable[[Any], Any], light: Any) -> Any:
    """A function of a spectrum or colour, of each component."""
    if not isinstance(light, Stokes):
        return function(light)
    parts = [function(one) for one in light.parts]
    return stokes_of(type(parts[0])).of(parts)


def parts_of(light: Any) -> tuple[Any, ...]:
    """The components of light."""
    return light.parts if isinstance(light, Stokes) else (light,)


def zeros(kind: type, has_stokes: bool, n: int = 1) -> Any:
    """No light, as a spectrum or colour type or as Stokes vectors of it."""
    one = lambda: kind(0) if n == 1 else dr.zeros(kind, n)  # noqa: E731 (each an array of its own)
    return stokes_of(kind).of([one() for _ in range(COMPONENTS)]) if has_stokes else one()


def no_light() -> Any:
    """Of no kind, along a path."""
    return zeros(mi.UnpolarizedSpectrum, mi.is_polarized)


def intensity(value: Any) -> Any:
    """Of light, or of what unpolarised light becomes by a Mueller matrix: S0, a spectrum."""
    if isinstance(value, Stokes):
        return value.s0
    return value[0, 0] if mi.is_polarized and isinstance(value, mi.Spectrum) else value


def depolarised(value: Any) -> Any:
    """What scatters light without any memory of how it swung, as a spectrum: that spectrum, or its Mueller matrix."""
    return mi.mueller.depolarizer(value) if mi.is_polarized else mi.Spectrum(value)


def applied(throughput: Any, value: Any) -> Any:
    """What a path carries that was met by `value` on its far side."""
    return throughput @ value if mi.is_polarized else throughput * value


def lit(throughput: Any, light: Any) -> Any:
    """What a path brings of unpolarised light, a spectrum."""
    if not mi.is_polarized:
        return throughput * light
    return stokes_of(mi.UnpolarizedSpectrum).of([throughput[i, 0] * light for i in range(COMPONENTS)])


def is_finite(light: Any) -> Any:
    """Whether all of it is."""
    if not isinstance(light, Stokes):
        return dr.all(dr.isfinite(light))
    found = [dr.all(dr.isfinite(one)) for one in light.parts]
    return found[0] & found[1] & found[2] & found[3]


def columns(light: Any) -> NDArray[np.float32]:
    """(3, n) of colours; of their Stokes vectors (12, n): R, G, B of S0, then of S1, S2 and S3."""
    return np.concatenate([np.array(one) for one in light.parts]) if isinstance(light, Stokes) else np.array(light)


class SensorFrame:
    """The frame in which a sensor's Stokes vectors are told, that of Mitsuba's `stokes`: S1 is positive where light
    swings along the horizontal of the picture."""

    def __init__(self, sensor: Any) -> None:
        up = np.array(sensor.world_transform().matrix, np.float64).reshape(4, 4)[:3, 1]
        self.up = [number(x) for x in up]

    def towards(self, direction: Any) -> Any:
        """Mueller matrix from the frame of light that arrives against a camera ray's direction to the sensor's."""
        frame = mi.mueller.stokes_basis(-direction)
        return mi.mueller.rotate_stokes_basis(-direction, frame, dr.cross(direction, mi.Vector3f(*self.up)))
