"""The page against the real service: one render from the dialog to the file, and what may go wrong on the way."""

from __future__ import annotations

import re
from pathlib import Path

import httpx
from places import own_zip
from playwright.sync_api import Page, Route, expect
from running import Service
from screen import open_job, picture_colours

SECONDS = 5


def test_a_render_from_the_dialog_to_the_file(page: Page, service: Service, tmp_path: Path) -> None:
    page.goto(service.url)
    page.get_by_role("button", name="New render").click()
    dialog = page.get_by_role("dialog", name="New render")
    dialog.get_by_text("Cornell box").click()
    for side in ("Width", "Height"):
        dialog.get_by_role("textbox", name=side).fill("96")
    dialog.get_by_role("textbox", name="Relative error").fill("0.5")
    dialog.get_by_role("textbox", name="Render time").fill(str(SECONDS))
    expect(dialog).to_contain_text(re.compile(r"at most 0\.5\s%\sor\s5\ss of rendering have passed"))
    dialog.get_by_role("button", name="Start render").click()
    expect(dialog).to_be_hidden()

    viewer = page.locator("#viewer")
    page.wait_for_function("Number(document.querySelector('#viewer')?.dataset.frame) > 0")
    first = viewer.get_attribute("data-frame")
    page.wait_for_function(f"Number(document.querySelector('#viewer').dataset.frame) > {first}")

    assert len(picture_colours(page, tmp_path)) > 500

    viewer.focus()
    for _ in range(3):
        page.keyboard.press("ArrowRight")
    expect(page.locator("[data-part=pixel]")).to_contain_text("replicate")
    expect(page.locator("[aria-live=polite]", has_text="Pixel")).to_contain_text("luminance")

    # The job ends by itself, and says by what.
    expect(page.locator("aside")).to_contain_text("Time used up", timeout=30_000)
    expect(page.locator("aside")).to_contain_text(re.compile(r"target was 0\.5\s%"))
    expect(page.locator("[data-part=interval]")).to_contain_text(re.compile(r"± \d"))

    page.keyboard.press("h")
    expect(page.get_by_role("button", name="Only above target")).to_be_visible()
    page.wait_for_timeout(200)
    assert len(picture_colours(page, tmp_path)) > 50

    with page.expect_download() as download:
        page.get_by_role("link", name="EXR").click()
    assert download.value.suggested_filename.endswith(".exr")
    assert Path(download.value.path()).read_bytes()[:4] == b"\x76\x2f\x31\x01"


def tab_to(page: Page, name: str) -> None:
    """Presses Tab until what is called `name` has the focus."""
    for _ in range(80):
        page.keyboard.press("Tab")
        focused = "document.activeElement.getAttribute('aria-label') ?? document.activeElement.textContent"
        if name in (page.evaluate(focused) or ""):
            return
    raise AssertionError(f"{name!r} cannot be reached with Tab")


def test_an_own_zip_from_the_empty_page_to_the_exr_by_keyboard(page: Page, service: Service, tmp_path: Path) -> None:
    page.goto(f"{service.url}/#/")
    expect(page.get_by_role("button", name="Cornell box")).to_be_visible()
    with page.expect_file_chooser() as chooser:
        tab_to(page, "Choose a file…")
        page.keyboard.press("Enter")
    chooser.value.set_files(own_zip(tmp_path))
    dialog = page.get_by_role("dialog", name="New render")
    expect(dialog.get_by_role("radio", name="my room")).to_be_checked(timeout=60_000)
    tab_to(page, "What this scene requires")
    page.keyboard.press("Enter")
    expect(dialog).to_contain_text("sphere")
    expect(dialog).to_contain_text("my room, 48 × 32.")
    tab_to(page, "Start render")
    page.keyboard.press("Enter")
    expect(page.locator("aside")).to_contain_text("Reached", timeout=60_000)
    with page.expect_download() as download:
        tab_to(page, "EXR")
        page.keyboard.press("Enter")
    assert re.fullmatch(r"my-room-\w+\.exr", download.value.suggested_filename)
    assert Path(download.value.path()).read_bytes()[:4] == b"\x76\x2f\x31\x01"


def test_cancelling_keeps_the_picture(page: Page, service: Service, tmp_path: Path) -> None:
    job_id = service.submit({"seconds": 600}, width=64, height=64)
    open_job(page, service, job_id)
    page.locator("aside").get_by_role("button", name="Cancel").click()
    expect(page.locator("aside")).to_contain_text("Cancelled")
    assert service.wait_ended(job_id)["state"] == "cancelled"
    assert len(picture_colours(page, tmp_path)) > 200


def test_zoom_probe_and_numbers(page: Page, service: Service, finished_job: str, tmp_path: Path) -> None:
    open_job(page, service, finished_job)
    box = page.locator("#viewer").bounding_box()
    assert box is not None
    centre = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.click(*centre)
    expect(page.locator("[data-part=pixel]")).to_contain_text(re.compile(r"\(4[78], 4[78]\)"))
    expect(page.locator("[data-part=pixel]")).to_contain_text("pinned")
    page.mouse.wheel(0, -1200)
    expect(page.get_by_role("status", name="Zoom factor")).to_contain_text(re.compile(r"\d{4}"))
    page.wait_for_timeout(200)
    # A handful of pixels fill the view: more colours than that are the numbers in them.
    assert len(picture_colours(page, tmp_path)) > 200
    page.keyboard.press("f")
    expect(page.get_by_role("button", name="Fit")).to_have_attribute("aria-pressed", "true")


def test_an_http_error_in_mid_stream_is_survived(page: Page, service: Service, finished_job: str) -> None:
    refused: list[str] = []

    def refuse(route: Route) -> None:
        refused.append(route.request.url)
        route.fulfill(status=503, body="busy")

    page.route("**/api/events", refuse)
    page.goto(f"{service.url}/#/jobs/{finished_job}")
    expect(page.get_by_role("banner")).to_contain_text("Connection lost")
    page.unroute("**/api/events")
    expect(page.get_by_role("banner")).to_contain_text("Live", timeout=10_000)
    expect(page.locator("aside")).to_contain_text("All samples taken")
    assert refused


def test_a_refused_file_is_told_beside_the_drop_zone(page: Page, service: Service) -> None:
    page.goto(service.url)
    page.get_by_role("button", name="New render").click()
    file = {
        "name": "evil.xml",
        "mimeType": "text/xml",
        "buffer": b"<scene version='3.0.0'><shape type='nonsense'/></scene>",
    }
    page.get_by_role("dialog", name="New render").get_by_label("Scene file").set_input_files([file])  # type: ignore[list-item]
    alert = page.get_by_role("group", name="Scene").get_by_role("alert")
    expect(alert).to_contain_text("evil.xml was refused", timeout=30_000)
    expect(alert).to_contain_text("nonsense")


def test_an_unknown_address_says_so(page: Page, service: Service) -> None:
    page.goto(f"{service.url}/#/jobs/nothing-here")
    expect(page.get_by_text("No job with this address.")).to_be_visible()


def test_without_webgl_the_png_stands_in(page: Page, service: Service, finished_job: str) -> None:
    page.add_init_script("delete HTMLCanvasElement.prototype.transferControlToOffscreen")
    page.goto(f"{service.url}/#/jobs/{finished_job}")
    expect(page.get_by_text("This browser cannot draw beside the page")).to_be_visible()
    still = page.get_by_role("img", name="Picture of Cornell box")
    page.wait_for_function("(image) => image.naturalWidth > 0", arg=still.element_handle())


def test_all_uploads_can_be_chosen(page: Page, service: Service) -> None:
    """Not the newest few alone."""
    for i in range(8):
        scene = f"""<scene version="3.0.0"><emitter type="constant"/><sensor type="perspective">
            <float name="fov" value="{30 + i}"/></sensor></scene>"""
        sent = httpx.post(f"{service.url}/api/scenes", files={"file": (f"room-{i}.xml", scene.encode())}, timeout=60)
        assert sent.is_success, sent.text
    page.goto(service.url)
    page.get_by_role("button", name="New render").click()
    dialog = page.get_by_role("dialog", name="New render")
    expect(dialog.get_by_text("room-7")).to_be_visible()
    expect(dialog.get_by_text("room-0")).to_have_count(0)
    dialog.get_by_role("button", name=re.compile(r"All \d+ uploads")).click()
    dialog.get_by_text("room-0").click()
    expect(dialog.get_by_role("radio", name=re.compile("room-0"))).to_be_checked()
    expect(dialog.get_by_role("button", name=re.compile(r"All \d+ uploads"))).to_have_count(0)
