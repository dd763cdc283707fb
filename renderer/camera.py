"""A camera that is set from outside the scene: where it stands, what it looks at, which way is up, how wide it sees.

Enters: numbers in the scene's own units. Leaves: `Camera`, a part of the settings, and the matrix that follows from it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderer.errors import SettingsError

Vector = tuple[float, float, float]
LARGEST = 1e15  # a coordinate
LEAST_ANGLE = 1e-6  # radians between the view and what is up


@dataclass(frozen=True, slots=True)
class Camera:
    """What differs from the scene's own sensor, a perspective or thinlens one; None is as the scene has it.

    origin, target: points in the scene's units. An origin alone leaves the direction of the view as it is.
    up: a direction, of any length, that is up in the picture; the sensor's own by default.
    fov: degrees, above 0 and below 180, along the sensor's fov_axis (the width, unless the scene says otherwise).
    """

    origin: Vector | None = None
    target: Vector | None = None
    up: Vector | None = None
    fov: float | None = None

    def __post_init__(self) -> None:
        for name in ("origin", "target", "up"):
            object.__setattr__(self, name, _vector(name, getattr(self, name)))
        if self.up is not None and not any(self.up):
            raise SettingsError("camera up is 0, 0, 0, which is no direction; give one, for example 0, 1, 0")
        if self.origin is not None and self.origin == self.target:
            where = _said(self.origin)
            raise SettingsError(f"camera origin and target are both {where}; it must look at another point")
        if self.up is not None and self.origin is not None and self.target is not None:
            to_world(np.eye(4), self.origin, self.target, self.up)  # raises where up is along the view
        if (fov := self.fov) is not None:
            if isinstance(fov, bool) or not isinstance(fov, Real) or not 0 < float(fov) < 180:
                raise SettingsError(f"camera fov is {fov!r}; it must be above 0 and below 180 degrees")
            object.__setattr__(self, "fov", float(fov))

    @classmethod
    def of(cls, given: Any) -> Camera | None:
        """The camera that a setting means: itself, a mapping of its fields, or None. One that sets nothing is none."""
        if isinstance(given, Mapping):
            known = [field.name for field in fields(cls)]
            for name in given:
                if name not in known:
                    raise SettingsError(f"camera has no {name!r}; its parts are {', '.join(known)}")
            given = cls(**given)
        if given is not None and not isinstance(given, cls):
            raise SettingsError(f"camera is {given!r}; give a Camera, for example Camera(origin=(0, 1, 5))")
        return None if given == cls() else given

    def as_dict(self) -> dict[str, Any]:
        """Plain values, as JSON has them."""
        return {name: list(v) if isinstance(v, tuple) else v for name, v in asdict(self).items()}

    @property
    def is_turned(self) -> bool:
        """Whether the direction of the view, or what is up, is to change."""
        return self.target is not None or self.up is not None


def to_world(own: NDArray[np.float64], origin: Any, target: Any, up: Vector | None) -> NDArray[np.float64]:
    """The (4, 4) matrix of a camera like `own`, at an origin (its own by None), that looks at a target (its own
    direction by None). A camera whose picture is mirrored keeps that. Raises SettingsError where no view follows.
    """
    made = own.copy()
    if origin is not None:
        made[:3, 3] = origin
    if target is None and up is None:
        return made
    forward = _unit(own[:3, 2]) if target is None else _unit(np.asarray(target, np.float64) - made[:3, 3])
    if forward is None:
        raise SettingsError("the camera's target is where it stands; it must look at another point")
    upward = _unit(own[:3, 1] if up is None else np.asarray(up, np.float64))
    left = None if upward is None else np.cross(upward, forward)
    if left is None or float(np.linalg.norm(left)) < LEAST_ANGLE:
        which = f"up is {_said(up)}, which" if up is not None else "own up"
        raise SettingsError(f"camera {which} is along the direction of its view; give another up, across the view")
    left /= np.linalg.norm(left)
    made[:3, :3] = np.stack([left, np.cross(forward, left), forward], axis=1)
    if np.linalg.det(own[:3, :3]) < 0:
        made[:3, 0] *= -1
    return made


def _unit(v: NDArray[np.float64] | None) -> NDArray[np.float64] | None:
    length = 0.0 if v is None else float(np.linalg.norm(v))
    return None if v is None or not 0 < length < math.inf else v / length


def _vector(name: str, value: Any) -> Vector | None:
    if value is None:
        return None
    try:
        x, y, z = value
    except (TypeError, ValueError):
        raise SettingsError(f"camera {name} is {value!r}; give three numbers x, y, z") from None
    for one in (x, y, z):
        if isinstance(one, bool) or not isinstance(one, Real) or not abs(float(one)) <= LARGEST:
            raise SettingsError(f"camera {name} is {value!r}; its numbers must be from {-LARGEST:g} to {LARGEST:g}")
    return float(x), float(y), float(z)


def _said(v: Vector) -> str:
    return ", ".join(f"{x:g}" for x in v)
