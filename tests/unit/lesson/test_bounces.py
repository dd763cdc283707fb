"""A pixel's light by the number of reflections: the terms of the Neumann series."""

from __future__ import annotations

import numpy as np
import pytest

import renderer
from renderer.lesson.bounces import by_bounces
from renderer.lesson.pixel import Lesson
from renderer.scene import gallery

COLOUR = renderer.Settings(colour="rgb")


def test_each_term_of_a_furnace_is_the_one_before_times_the_albedo() -> None:
    """Inside a sphere that shines evenly, T^k Le = albedo^k Le; the bound is 5 standard errors."""
    scene = renderer.load_scene("furnace", settings=COLOUR)
    terms = by_bounces(Lesson(scene, 40, 50), range(4096))
    n = terms.shape[1]
    assert terms[0] == pytest.approx(terms[0, 0]), "what is emitted has no noise"
    for k, term in enumerate(terms[:-1]):
        assert abs(term.mean() - terms[0, 0] * 0.75**k) <= 5 * term.std(ddof=1) / np.sqrt(n) + 1e-6, k
    assert not terms[-1].any(), "the scene's paths end after eight vertices"


@pytest.mark.parametrize("name", ["cornell-box", "gap", "plates"])
def test_the_terms_sum_to_the_pixel_sample_by_sample(name: str) -> None:
    found = gallery.find(name)
    lesson = Lesson(renderer.load_scene(name, settings=COLOUR), found.width // 3, 5 * found.height // 6)
    terms = by_bounces(lesson, range(512))
    np.testing.assert_allclose(terms.sum(0), lesson.samples("mis", range(512)), rtol=1e-6, atol=1e-9)
    # And to the pixel of other samples, within five standard errors.
    other = lesson.samples("mis", range(512, 4608))
    error = np.hypot(terms.sum(0).std() / np.sqrt(512), other.std() / 64)
    assert abs(terms.sum(0).mean() - other.mean()) < 5 * error


def test_a_term_that_is_limited_once_is_what_a_render_with_that_depth_shows() -> None:
    scene = renderer.load_scene("cornell-box", settings=COLOUR)
    lesson = Lesson(scene, 174, 445)
    direct = by_bounces(lesson, range(4096))[:2].sum(0)
    rendered = lesson.scene.resolved(renderer.Settings(max_depth=2, independent_pixels=True), 1)
    pixel = np.full(4096, 445 * scene.width + 174, dtype=np.uint32)
    radiance, *_ = scene.kernel(rendered).launch(pixel, np.arange(4096, 8192, dtype=np.uint32), 0)
    others = np.array(radiance, dtype=np.float64).T @ [0.2126, 0.7152, 0.0722]
    error = np.hypot(direct.std(), others.std()) / 64
    assert abs(direct.mean() - others.mean()) < 5 * error
