"""The Learn view's answers: they are the product's own numbers, seen from one pixel."""

from __future__ import annotations

import numpy as np
import pytest

import renderer
from renderer.backend import mitsuba
from renderer.lesson.pixel import TECHNIQUES, Lesson, checkpoints, running

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


@pytest.fixture(scope="module")
def floor() -> Lesson:
    """A point on the Cornell box's floor, in a picture so fine that the pixel shows one point."""
    return Lesson(renderer.load_scene("cornell-box"), 174, 445)


def test_arriving_light_times_f_cos_is_what_the_pixel_shows(floor: Lesson) -> None:
    """∫ f L cosθ dω over the map against the pixel's own samples: two routes through the same kernel.

    The bound is 4 standard errors (6e-5 with a right program) and 2 % for the map's finite cells.
    """
    columns, rows = floor.map_size
    moments = floor.incident(range(32))
    theta = (np.arange(rows) + 0.5) / rows * floor.polar_range
    solid_angle = (floor.polar_range / rows) * (2 * np.pi / columns) * np.sin(theta)[:, None, None]
    weight = floor.integrand() * solid_angle
    from_map = float((moments.mean.reshape(rows, columns, 3) * weight).sum((0, 1)) @ LUMINANCE)
    spread = np.sqrt(moments.variance_of_mean()[:, :3]).reshape(rows, columns, 3)
    map_error = float(np.sqrt(np.square((spread * weight) @ LUMINANCE).sum()))
    samples = floor.samples("mis", range(16384))
    error = np.hypot(map_error, samples.std() / np.sqrt(len(samples)))
    assert abs(from_map - samples.mean()) < 4 * error + 0.02 * from_map


def test_all_techniques_agree_within_five_standard_errors(floor: Lesson) -> None:
    reference = floor.samples("mis", range(16384))
    for technique in TECHNIQUES[:-1]:
        values = floor.samples(technique, range(16384))
        error = np.hypot(values.std(), reference.std()) / np.sqrt(len(values))
        assert abs(values.mean() - reference.mean()) < 5 * error, technique


def test_samples_are_addressed_by_their_number(floor: Lesson) -> None:
    np.testing.assert_array_equal(floor.samples("mis", range(100))[40:60], floor.samples("mis", range(40, 60)))


def test_directions_lie_on_the_map_and_emitter_sampling_sees_the_lamp(floor: Lesson) -> None:
    for technique in TECHNIQUES[:-1]:
        drawn = floor.directions(technique, 200)
        assert len(drawn.u) + drawn.lost == 200
        assert ((drawn.u >= 0) & (drawn.u < 1) & (drawn.v >= 0) & (drawn.v < 1)).all()
    lamp = floor.directions("emitter", 200)
    assert lamp.found is not None
    assert lamp.found.any()
    # The lamp is a small part of the hemisphere; the cosine covers all of it.
    assert np.ptp(lamp.v) < 0.5 < np.ptp(floor.directions("cosine", 200).v)


def test_a_pixel_outside_the_picture_is_refused(floor: Lesson) -> None:
    with pytest.raises(renderer.errors.SettingsError, match="outside the picture"):
        Lesson(floor.scene, 512, 0)


@pytest.mark.parametrize("size", [1e-3, 1.0, 550.0, 1e5])
@pytest.mark.parametrize("place", [0.0, 3e4])
def test_the_vertex_is_told_in_the_units_of_the_scene_as_it_was_written(size: float, place: float) -> None:
    T = mitsuba().ScalarTransform4f
    place *= size
    scene = renderer.load_scene(
        {
            "type": "scene",
            "sensor": {
                "type": "perspective",
                "fov": 20,
                "near_clip": 0.01 * size,
                "far_clip": 1e3 * size,
                "to_world": T().look_at([place, 0, 4 * size], [place, 0, 0], [0, 1, 0]),
                "film": {"type": "hdrfilm", "width": 9, "height": 9},
            },
            "wall": {"type": "rectangle", "to_world": T().translate([place, 0, size]).scale(2 * size)},
            "sky": {"type": "constant"},
        },
        settings=renderer.Settings(colour="rgb"),
    )
    vertex = Lesson(scene, 4, 4).vertex
    assert vertex.distance == pytest.approx(2.99 * size, rel=1e-3)  # from the near plane, as the channel depth
    assert vertex.position == pytest.approx((place, 0, size), rel=1e-3, abs=0.02 * size)
    assert vertex.normal == pytest.approx((0, 0, 1), abs=1e-6)


def test_the_distance_is_that_of_the_depth_channel(floor: Lesson) -> None:
    small = floor.scene.sized(renderer.Settings(width=64, height=64, colour="rgb"))
    depth = small.channels(small.resolved(renderer.Settings(), 1), ("depth",))["depth"]
    assert Lesson(small, 21, 55).vertex.distance == pytest.approx(float(depth[55, 21].item()), rel=0.02)


def test_running_moments_end_with_those_of_all_samples() -> None:
    values = np.random.default_rng(3).exponential(size=1000) + 1e6
    values[::3] = 0.0
    steps = running(values, 0)
    last = steps[-1]
    off = values - values.mean()
    assert (last.n, last.lit) == (1000, 666)
    assert last.mean == pytest.approx(values.mean(), rel=1e-12)
    for power, found in ((2, last.m2), (3, last.m3), (4, last.m4)):
        assert found == pytest.approx((off**power).sum(), rel=1e-9)
    assert [step.n for step in steps[:-1]] == checkpoints(999)


def test_parts_have_their_steps_at_the_same_numbers_as_the_whole() -> None:
    values = np.arange(64.0)
    whole = {step.n for step in running(values, 0)}
    parts = {step.n for step in running(values[:24], 0)} | {24 + step.n for step in running(values[24:], 24)}
    assert whole <= parts
