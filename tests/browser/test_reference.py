"""Pictures from files, opened in the browser: by themselves, or as the reference of a job, seen and measured."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from exr_files import values, write
from numpy.typing import NDArray
from playwright.sync_api import Page, expect
from running import Service
from screen import open_job, picture_colours

REFERENCE = "Against the reference"


def radiance_of(page: Page, service: Service, job_id: str, folder: Path) -> NDArray[np.float32]:
    """A job's picture (H, W, 3), by its download."""
    path = folder / "job.exr"
    path.write_bytes(page.request.get(f"{service.url}/api/jobs/{job_id}/image.exr").body())
    return values(path)[..., :3]


@pytest.fixture
def reference(page: Page, service: Service, finished_job: str, tmp_path: Path) -> Path:
    """The job's own picture, a tenth brighter."""
    return write(
        tmp_path / "reference.exr", radiance_of(page, service, finished_job, tmp_path) * 1.1, compression="piz"
    )


def number(card: str, name: str) -> float:
    found = re.search(rf"{name}\s*([\d.e−-]+)", card)
    assert found, card
    return float(found[1].replace("−", "-"))


def test_a_dropped_picture_is_the_reference_of_the_job(
    page: Page, service: Service, finished_job: str, reference: Path, tmp_path: Path
) -> None:
    open_job(page, service, finished_job)
    page.evaluate(
        """(bytes) => {
          const data = new DataTransfer();
          data.items.add(new File([new Uint8Array(bytes)], 'reference.exr'));
          window.dispatchEvent(new DragEvent('drop', { dataTransfer: data, cancelable: true }));
        }""",
        list(reference.read_bytes()),
    )
    expect(page.get_by_role("button", name="True error")).to_have_attribute("aria-pressed", "true")
    expect(page.get_by_role("group", name="Comparison", exact=True)).to_contain_text("reference.exr")
    expect(page.get_by_role("group", name="Legend")).to_contain_text("|A − B| over B")
    card = page.get_by_role("region", name=REFERENCE)
    expect(card).to_contain_text("SSIM")
    shown = card.inner_text()
    b = radiance_of(page, service, finished_job, tmp_path).astype(np.float64) * 1.1
    squared = (b - b / 1.1) ** 2
    assert number(shown, "relMSE") == pytest.approx(np.mean(squared / (b**2 + (0.1 * b.mean()) ** 2)), rel=2e-3)
    assert number(shown, r"\nMSE") == pytest.approx(squared.mean(), rel=2e-3)
    assert 0 < number(shown, "FLIP") < 1
    assert number(shown, "SSIM") < 1
    expect(card.locator("[data-part=coverage]")).to_contain_text("have the reference in it")
    page.wait_for_timeout(300)
    assert len(picture_colours(page, tmp_path)) > 20
    # With the keyboard: the picture and back.
    page.locator("#viewer").focus()
    page.keyboard.press("g")
    expect(page.get_by_role("button", name="Image", exact=True)).to_have_attribute("aria-pressed", "true")
    page.keyboard.press("g")
    expect(page.get_by_role("button", name="True error")).to_have_attribute("aria-pressed", "true")


def test_a_job_holds_its_own_picture(page: Page, service: Service, finished_job: str, tmp_path: Path) -> None:
    same = write(tmp_path / "same.exr", radiance_of(page, service, finished_job, tmp_path), compression="zip")
    open_job(page, service, finished_job)
    page.get_by_label("Reference file").set_input_files(same)
    card = page.get_by_role("region", name=REFERENCE)
    expect(card).to_contain_text("SSIM")
    assert number(card.inner_text(), "relMSE") == 0
    assert number(card.inner_text(), "SSIM") == 1
    expect(card.locator("[data-part=coverage]")).to_contain_text(re.compile(r"^100"))


def test_two_jobs_are_measured_when_that_is_asked_for(page: Page, service: Service, finished_job: str) -> None:
    other = service.submit({"spp": 256}, width=96, height=96, seed=11)
    assert service.wait_ended(other)["state"] == "succeeded"
    open_job(page, service, f"{finished_job}?with={other}")
    card = page.get_by_role("region", name=REFERENCE)
    card.get_by_role("button", name="Measure").click()
    # The other estimate has errors of its own.
    expect(card.locator("[data-part=coverage]")).to_contain_text("within both errors")
    found = re.search(r"([\d.]+)\s%", card.locator("[data-part=coverage]").inner_text())
    assert found
    assert 85 < float(found[1]) <= 100


def test_a_picture_opens_by_itself_and_closes(page: Page, service: Service, tmp_path: Path) -> None:
    y, x = np.mgrid[0:40, 0:64]
    pixels = np.stack([x / 64, y / 40, np.full(x.shape, 0.25)], axis=-1).astype(np.float32)
    page.goto(service.url + "/#/")
    page.get_by_label("Picture file").set_input_files(write(tmp_path / "ramp.exr", pixels, compression="rle"))
    page.wait_for_function("Number(document.querySelector('#viewer')?.dataset.frame) > 0")
    card = page.get_by_role("region", name="File")
    expect(card).to_contain_text("ramp.exr")
    expect(card).to_contain_text("64 × 40")
    page.wait_for_timeout(300)
    assert len(picture_colours(page, tmp_path)) > 200
    page.locator("#viewer").focus()
    page.keyboard.press("Enter")
    expect(page.get_by_role("region", name="Pixel", exact=True)).to_contain_text("0.5000")
    assert page.evaluate("location.hash").startswith("#/jobs/file-1")
    card.get_by_role("button", name="Close").click()
    expect(page.get_by_role("heading", name=re.compile("Pick a scene|Nothing rendered"))).to_be_visible()


def test_what_is_no_picture_is_refused_with_its_reason(
    page: Page, service: Service, finished_job: str, tmp_path: Path
) -> None:
    (tmp_path / "letter.exr").write_text("dear reader")
    small = write(tmp_path / "small.exr", np.ones((8, 8, 3), np.float32))
    open_job(page, service, finished_job)
    page.get_by_label("Reference file").set_input_files(tmp_path / "letter.exr")
    expect(page.get_by_role("alert")).to_contain_text("letter.exr: this is neither an OpenEXR nor a Radiance .hdr file")
    page.get_by_role("alert").get_by_role("button", name="Close").click()
    # Of another size: by itself; against the job it can be laid, and says why it is not measured.
    page.get_by_label("Reference file").set_input_files(small)
    expect(page.get_by_role("region", name="File")).to_contain_text("small.exr")
    page.goto(f"{service.url}/#/jobs/{finished_job}")
    page.get_by_role("combobox", name="Compare with").select_option(label="small.exr")
    expect(page.get_by_role("region", name=REFERENCE)).to_contain_text("only pictures of one size can be measured")
    expect(page.get_by_role("button", name="True error")).to_have_count(0)
