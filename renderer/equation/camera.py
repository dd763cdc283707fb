"""Cameras that a recording can hold: the thin lens and the orthographic one.

Enters: Mitsuba's sensor. Leaves: an object that samples the same rays. Mitsuba 3.9 keeps the projection of these two
where a recorded kernel cannot find it: each pass was traced anew, which took up to a third of the time. Both
projections are affine in the film's position (the thin lens in the slopes of its rays), so the rays of three corners
say all.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from renderer.backend import mitsuba
from renderer.equation.tables import number

mi: Any = mitsuba()

CORNERS = ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))
CENTRE = 0.5  # of the lens


def camera_of(sensor: Any) -> Any:
    """What samples the sensor's rays: ours where Mitsuba's cannot be recorded, else the sensor itself."""
    kind = sensor.class_name() if hasattr(sensor, "class_name") else ""
    ours = {"ThinLensCamera": ThinLens, "OrthographicCamera": Orthographic}.get(kind)
    return sensor if ours is None else ours(sensor)


class _Camera:
    """corners: origins and directions of the rays through CORNERS, (3, 3) float64 each; far: their lengths, (3,)."""

    def __init__(self, sensor: Any) -> None:
        self.sensor = sensor
        at = mi.Point2f(*np.array(CORNERS, np.float32).T)
        ray, _ = sensor.sample_ray(0.0, CENTRE, at, mi.Point2f(CENTRE), True)
        values = (np.atleast_2d(np.array(v, np.float64)) for v in (ray.o, ray.d, ray.maxt))
        origins, directions, far = (np.broadcast_to(v, (len(v), len(CORNERS))).T for v in values)
        self.corners, self.far = (origins, directions), far

    def _wavelengths(self, u: Any, active: Any) -> tuple[Any, Any]:
        return self.sensor.sample_wavelengths(dr.zeros(mi.SurfaceInteraction3f), u, active)


class ThinLens(_Camera):
    """Rays from a point of the lens through the point in focus."""

    def __init__(self, sensor: Any) -> None:
        super().__init__(sensor)
        to_world = np.array(sensor.world_transform().matrix, np.float64).reshape(4, 4)
        directions = self.corners[1] @ np.linalg.inv(to_world[:3, :3]).T
        self.slopes = _affine(directions[:, :2] / directions[:, 2:])
        self.axes = [[number(v) for v in to_world[:3, i]] for i in range(4)]
        known = mi.traverse(sensor)
        self.radius, self.focus = (number(known[name]) for name in ("aperture_radius", "focus_distance"))
        self.near_clip, self.far_clip = number(sensor.near_clip()), number(sensor.far_clip())

    def sample_ray(self, time: Any, u_wavelength: Any, position: Any, lens: Any, active: Any = True) -> tuple[Any, Any]:
        """As Mitsuba's."""
        x, y, z, origin = (mi.Vector3f(*axis) for axis in self.axes)
        at = self.radius * mi.warp.square_to_uniform_disk_concentric(lens)
        focus_x, focus_y = (self.focus * slope for slope in _at(self.slopes, position))
        d = dr.normalize(mi.Vector3f(focus_x - at.x, focus_y - at.y, self.focus))
        direction = x * d.x + y * d.y + z * d.z
        nearest = self.near_clip / d.z
        wavelengths, weight = self._wavelengths(u_wavelength, active)
        start = mi.Point3f(origin + x * at.x + y * at.y + direction * nearest)
        ray = mi.Ray3f(start, direction, time, wavelengths)
        ray.maxt = self.far_clip / d.z - nearest
        return ray, weight


class Orthographic(_Camera):
    """Parallel rays."""

    def __init__(self, sensor: Any) -> None:
        super().__init__(sensor)
        self.places = _affine(self.corners[0])
        self.direction = [number(v) for v in self.corners[1][0]]
        self.length = number(self.far[0])

    def sample_ray(self, time: Any, u_wavelength: Any, position: Any, lens: Any, active: Any = True) -> tuple[Any, Any]:
        """As Mitsuba's."""
        wavelengths, weight = self._wavelengths(u_wavelength, active)
        start = mi.Point3f(*_at(self.places, position))
        ray = mi.Ray3f(start, mi.Vector3f(*self.direction), time, wavelengths)
        ray.maxt = self.length
        return ray, weight


def _affine(corners: NDArray[np.float64]) -> list[list[Any]]:
    """(3, k) values at the corners as k triples: the constant, the x and the y part."""
    first, right, down = corners
    return [[number(v) for v in triple] for triple in zip(first, right - first, down - first, strict=True)]


def _at(parts: list[list[Any]], position: Any) -> list[Any]:
    return [constant + dx * position.x + dy * position.y for constant, dx, dy in parts]
