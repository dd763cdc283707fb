"""Paths that are followed vertex by vertex: they are samples of the pixel."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

import renderer
from renderer.lesson.pixel import Lesson
from renderer.lesson.projection import Projection
from renderer.lesson.walk import walk
from renderer.scene import gallery

COLOUR = renderer.Settings(colour="rgb")


def lesson_of(name: str, x: float, y: float) -> Lesson:
    found = gallery.find(name)
    scene = renderer.load_scene(name, settings=COLOUR)
    return Lesson(scene, int(x * found.width), int(y * found.height))


@pytest.mark.parametrize(
    ("name", "x", "y"), [("cornell-box", 0.34, 0.87), ("furnace", 0.2, 0.3), ("ring-sky", 0.3, 0.9)]
)
def test_the_mean_over_paths_is_the_pixel_by_bsdf_sampling(name: str, x: float, y: float) -> None:
    """Within five standard errors, and 1 % for the pixel's area, of which paths see the centre alone."""
    lesson, n = lesson_of(name, x, y), 4096
    sums = sum(np.where(step.is_there, step.added, 0.0) for step in walk(lesson, range(n)))
    samples = lesson.samples("bsdf", range(n))
    error = np.hypot(np.std(sums), samples.std()) / np.sqrt(n)
    assert abs(np.mean(sums) - samples.mean()) < 5 * error + 0.01 * samples.mean()


def test_each_vertex_lies_on_the_ray_from_the_one_before() -> None:
    steps = walk(lesson_of("cornell-box", 0.34, 0.87), range(64))
    assert steps[0].is_seen.all()
    for before, step in pairwise(steps):
        here = step.is_there & ~step.is_sky
        reached = before.position[here] + step.distance[here, None] * step.direction[here]
        np.testing.assert_allclose(reached, step.position[here], rtol=1e-4, atol=1.0)
        assert (step.throughput[here] <= before.throughput[here] * (1 + 1e-5)).all(), "this box only takes light away"


@pytest.mark.parametrize("name", [scene.name for scene in gallery.list_scenes() if not scene.has_media])
def test_what_a_pixel_sees_lies_in_that_pixel(name: str) -> None:
    lesson = lesson_of(name, 0.34, 0.8)
    assert lesson.vertex.is_hit
    projection = Projection(lesson.scene.sensor, lesson.scene.width, lesson.scene.height)
    assert projection.is_known
    seen = np.array(lesson.si.p, dtype=float).reshape(1, 3)
    np.testing.assert_allclose(projection.place(seen), [[lesson.x + 0.5, lesson.y + 0.5]], atol=0.05)


def test_a_camera_without_a_centre_of_projection_is_told_so() -> None:
    scene = renderer.load_scene(
        {"type": "scene", "sensor": {"type": "orthographic", "film": {"type": "hdrfilm", "width": 8, "height": 8}},
         "wall": {"type": "rectangle"}, "sky": {"type": "constant"}},
        settings=COLOUR,
    )  # fmt: skip
    projection = Projection(scene.sensor, 8, 8)
    assert not projection.is_known
    assert np.isnan(projection.place(np.zeros((1, 3)))).all()
