"""Facts about our own cameras: their rays are Mitsuba's."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from renderer.backend import mitsuba
from renderer.equation.camera import Orthographic, ThinLens, camera_of

mi: Any = mitsuba()
LOOK = mi.ScalarTransform4f().look_at([1, 2, 3], [0, 0, 0.5], [0, 1, 0])
WHOLE = {"type": "hdrfilm", "width": 70, "height": 40}
CROPPED = WHOLE | {"crop_offset_x": 10, "crop_offset_y": 5, "crop_width": 30, "crop_height": 20}
CLIPPED = {"near_clip": 0.5, "far_clip": 20.0}
THIN = {"type": "thinlens", "fov": 50.0, "aperture_radius": 0.2, "focus_distance": 3.0, "to_world": LOOK}
SENSORS: dict[str, tuple[type, dict[str, Any]]] = {
    "thin lens": (ThinLens, THIN | CLIPPED | {"film": WHOLE}),
    "cropped thin lens": (ThinLens, THIN | CLIPPED | {"film": CROPPED}),
    "orthographic": (
        Orthographic,
        CLIPPED | {"type": "orthographic", "to_world": LOOK @ mi.ScalarTransform4f().scale([3, 2, 1]), "film": CROPPED},
    ),
}


@pytest.mark.parametrize("name", SENSORS)
def test_rays_are_those_of_mitsuba(name: str) -> None:
    kind, description = SENSORS[name]
    sensor = mi.load_dict(description)
    ours = camera_of(sensor)
    assert isinstance(ours, kind)
    u = np.random.default_rng(1).random((4, 1000), np.float32)
    where = mi.Point2f(u[0], u[1]), mi.Point2f(u[2], u[3])
    expected, weight = sensor.sample_ray(0.25, 0.5, *where, True)
    found, our_weight = ours.sample_ray(0.25, 0.5, *where, True)
    for part, tolerance in (("o", 2e-6), ("d", 5e-7), ("maxt", 2e-5), ("time", 0)):
        a, b = (np.array(getattr(ray, part)) for ray in (found, expected))
        np.testing.assert_allclose(a, np.broadcast_to(b, a.shape), atol=tolerance, rtol=0, err_msg=part)
    assert np.array_equal(np.array(weight), np.array(our_weight))


def test_other_cameras_are_mitsubas_own() -> None:
    sensor = mi.load_dict({"type": "perspective", "to_world": LOOK})
    assert camera_of(sensor) is sensor
