"""Facts about what a notebook shows of an estimate. One notebook is run, in a kernel of its own."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import nbclient
import nbformat
import numpy as np
import OpenImageIO as oiio
import pytest

import renderer
from renderer.estimate.moments import Moments
from renderer.image.card import LONGEST_SIDE, error_sentence

CELLS = (
    "import fredholm\nestimate = fredholm.render('furnace', fredholm.Target(spp=256), "
    "fredholm.Settings(width=16, height=12))",
    "estimate",
)


@pytest.fixture(scope="module")
def estimate() -> renderer.Estimate:
    return renderer.render("furnace", renderer.Target(spp=256), renderer.Settings(width=16, height=12))


def decoded(png: bytes, folder: Path) -> np.ndarray:
    (folder / "picture.png").write_bytes(png)
    return np.asarray(oiio.ImageBuf(str(folder / "picture.png")).get_pixels(oiio.UINT8))


def test_a_notebook_shows_picture_error_and_trust(tmp_path: Path) -> None:
    cells = [nbformat.v4.new_code_cell(text) for text in CELLS]
    kernel = {"kernelspec": {"name": "python3", "display_name": "Python", "language": "python"}}
    notebook = nbformat.v4.new_notebook(cells=cells, metadata=kernel)
    nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    (shown,) = notebook.cells[1].outputs
    assert shown.output_type == "execute_result"
    assert {"text/html", "image/png"} <= shown.data.keys()
    assert "% with 95 % confidence" in shown.data["text/html"]
    assert "error bars that can be believed" in shown.data["text/html"]
    assert "furnace, 16 × 12" in shown.data["text/html"]


def test_the_png_is_the_picture(estimate: renderer.Estimate, tmp_path: Path) -> None:
    assert np.array_equal(decoded(estimate._repr_png_(), tmp_path), estimate.picture())


def test_the_error_is_that_of_the_file(estimate: renderer.Estimate, tmp_path: Path) -> None:
    *_, last = renderer.progressive("furnace", renderer.Target(spp=256), renderer.Settings(width=16, height=12))
    assert last.error is not None
    assert error_sentence(last.estimate).startswith(f"{100 * last.error:.3g} %, below ")
    assert error_sentence(last.estimate) == error_sentence(estimate)


def test_an_error_that_is_not_known_is_said_so() -> None:
    one = renderer.render("furnace", renderer.Target(spp=1), renderer.Settings(width=8, height=8))
    card = one._repr_html_()
    assert "%, below" not in card
    assert error_sentence(one) in card
    assert "not" in error_sentence(one)


def test_names_and_warnings_of_a_scene_are_no_markup(estimate: renderer.Estimate) -> None:
    identity = replace(estimate.identity, scene_name="<script>alert('x')</script>")
    card = replace(estimate, identity=identity, notes={"warnings": ["<img src=x>"]})._repr_html_()
    assert "<script" not in card
    assert "<img src=x>" not in card
    assert "&lt;img src=x&gt;" in card


def test_a_large_picture_is_reduced(estimate: renderer.Estimate, tmp_path: Path) -> None:
    n = 3 * LONGEST_SIDE
    wide = replace(estimate, width=n, height=1, moments=Moments.empty(n), look=None)
    assert decoded(wide._repr_png_(), tmp_path).shape == (1, LONGEST_SIDE, 3)
