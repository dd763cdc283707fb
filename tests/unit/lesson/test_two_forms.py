"""The area form and the hemisphere form: the same integral."""

from __future__ import annotations

import math

import numpy as np
import pytest

import renderer
from renderer.backend import mitsuba
from renderer.lesson.pixel import Lesson
from renderer.lesson.two_forms import LightPoints, light_points
from renderer.scene import gallery

COLOUR = renderer.Settings(colour="rgb")


def points_of(name: str, x: float, y: float, n: int = 4096) -> tuple[Lesson, LightPoints]:
    found = gallery.find(name)
    lesson = Lesson(renderer.load_scene(name, settings=COLOUR), int(x * found.width), int(y * found.height))
    points = light_points(lesson, n)
    assert points is not None
    return lesson, points


@pytest.mark.parametrize(
    ("name", "x", "y"), [("cornell-box", 0.34, 0.87), ("plates", 0.3, 0.85), ("ring-sky", 0.3, 0.9)]
)
def test_the_mean_over_points_is_the_direct_light_of_the_pixel(name: str, x: float, y: float) -> None:
    """Within five standard errors, and 1 % for the pixel's area, of which the points see the centre alone."""
    lesson, points = points_of(name, x, y)
    for technique in ("emitter", "mis"):
        samples = lesson.samples(technique, range(8192), max_depth=2) - lesson.vertex.emitted
        error = math.hypot(points.estimate.std() / 64, samples.std() / math.sqrt(8192))
        assert abs(points.estimate.mean() - samples.mean()) < 5 * error + 0.01 * abs(samples.mean()), technique


def test_both_forms_count_each_point_alike() -> None:
    _, points = points_of("cornell-box", 0.34, 0.87)
    assert points.has_area.all()
    lit = points.estimate > 0
    assert lit.any()
    by_area = points.f * points.emitted * points.is_visible * points.geometry / points.pdf_area
    # Colours multiply channel by channel, luminances only nearly so.
    np.testing.assert_allclose(by_area[lit], points.estimate[lit], rtol=0.02)
    np.testing.assert_allclose(
        points.pdf_area[lit] / points.pdf[lit], points.cos_light[lit] / points.distance[lit] ** 2
    )


def test_solid_angles_of_a_lamp_overhead_are_those_of_the_formula() -> None:
    """A square lamp of side 2 straight above at distance 3: p_A = 1/4, and ∫ cosθ′/r² dA = 4 asin(1/(1 + 9))."""
    T = mitsuba().ScalarTransform4f
    scene = renderer.load_scene(
        {
            "type": "scene",
            "sensor": {
                "type": "perspective",
                "fov": 5,
                "to_world": T().look_at([0, -4, 2], [0, 0, 0], [0, 0, 1]),
                "film": {"type": "hdrfilm", "width": 9, "height": 9},
            },
            "floor": {"type": "rectangle", "to_world": T().scale(10)},
            "lamp": {
                "type": "rectangle",
                "to_world": T().translate([0, 0, 3]).rotate([1, 0, 0], 180),
                "emitter": {"type": "area", "radiance": {"type": "rgb", "value": 1.0}},
            },
        },
        settings=COLOUR,
    )
    points = light_points(Lesson(scene, 4, 4), 4096)
    assert points is not None
    assert points.is_visible.all()
    np.testing.assert_allclose(points.pdf_area, 0.25, rtol=1e-3)
    solid_angle = (points.cos_light / points.distance**2 / points.pdf_area).mean()
    assert solid_angle == pytest.approx(4 * math.asin(1 / 10), rel=0.02)


def test_where_there_is_no_light_there_are_no_points() -> None:
    scene = renderer.load_scene(
        {"type": "scene", "sensor": {"type": "perspective", "film": {"type": "hdrfilm", "width": 4, "height": 4}},
         "wall": {"type": "rectangle", "to_world": mitsuba().ScalarTransform4f().translate([0, 0, 5]).scale(9)}},
        settings=COLOUR,
    )  # fmt: skip
    assert light_points(Lesson(scene, 1, 1), 4) is None
