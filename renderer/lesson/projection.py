"""Where points of the scene lie in its picture.

Known for cameras that see through a centre of projection, which are nearly all; checked against the camera's own rays.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderer.backend import mitsuba

mi: Any = mitsuba()

_OFF = 0.5  # pixels that a projection may be off, before it is not said


class Projection:
    """Of a scene's sensor; `is_known` False where there is none to rely on."""

    def __init__(self, sensor: Any, width: int, height: int) -> None:
        self._matrix: NDArray[np.float64] | None = None
        self.width, self.height = width, height
        parameters = mi.traverse(sensor)
        if "x_fov" not in parameters:
            return
        near, far = float(sensor.near_clip()), float(sensor.far_clip())
        fov = float(np.array(parameters["x_fov"]).reshape(-1)[0])
        size = mi.ScalarVector2u(width, height)
        to_picture = mi.perspective_projection(size, size, mi.ScalarVector2i(0), fov, near, far)
        to_camera = mi.ScalarTransform4f(np.linalg.inv(_matrix(sensor.world_transform().matrix)))
        self._matrix = _matrix(to_picture.matrix) @ _matrix(to_camera.matrix)
        if not self._agrees(sensor):
            self._matrix = None

    @property
    def is_known(self) -> bool:
        """Whether points can be placed."""
        return self._matrix is not None

    def _agrees(self, sensor: Any) -> bool:
        """Whether points on the camera's own rays fall on their pixels."""
        for u, v in ((0.5, 0.5), (0.1, 0.2), (0.9, 0.7)):
            ray, _ = sensor.sample_ray(float(sensor.shutter_open()), 0.5, mi.Point2f(u, v), mi.Point2f(0.5))
            origin, direction = (np.array(part, dtype=np.float64).reshape(3) for part in (ray.o, ray.d))
            place = self.place((origin + direction * max(1.0, float(np.abs(origin).max())))[None])[0]
            if not np.hypot(place[0] - u * self.width, place[1] - v * self.height) < _OFF:
                return False
        return True

    def place(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Pixel coordinates (n, 2) of points (n, 3) of the rendered scene, 0 at the left and top edge; nan for points
        behind the camera, and where nothing is known. They may lie outside the picture.
        """
        if self._matrix is None:
            return np.full((len(points), 2), np.nan)
        homogeneous = np.concatenate([points, np.ones((len(points), 1))], axis=1) @ self._matrix.T
        depth = homogeneous[:, 3:]
        with np.errstate(divide="ignore", invalid="ignore"):
            place = homogeneous[:, :2] / depth * [self.width, self.height]
        return np.where(depth > 0, place, np.nan)


def _matrix(matrix: Any) -> NDArray[np.float64]:
    return np.array(matrix, dtype=np.float64).reshape(4, 4, -1)[..., 0]
