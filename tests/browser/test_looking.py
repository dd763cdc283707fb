"""Looking at a picture closely: layers, false colours, a region in numbers, the view as a file, links."""

from __future__ import annotations

import json
import re
from pathlib import Path

import httpx
import numpy as np
import pytest
from exr_files import names, values, write
from places import OWN_SCENE
from playwright.sync_api import Page, expect
from running import Service
from screen import open_job, picture_colours

REGION = "Region of interest"


@pytest.fixture(scope="module")
def layered(service: Service) -> str:
    """A job with layers, whose pixels are independent."""
    channels = ["albedo", "normal", "depth", "stokes"]
    job_id = service.submit({"spp": 256}, width=48, height=48, channels=channels, independent_pixels=True)
    assert service.wait_ended(job_id)["state"] == "succeeded"
    return job_id


def saved_view(page: Page, folder: Path) -> Path:
    with page.expect_download() as download:
        page.locator("#viewer").press("Shift+S")
    path = folder / download.value.suggested_filename
    download.value.save_as(path)
    return path


def test_layers_are_asked_for_shown_and_told(page: Page, service: Service, layered: str, tmp_path: Path) -> None:
    open_job(page, service, layered)
    layer = page.get_by_role("combobox", name="Layer")
    seen = {}
    for name, least in (("albedo", 4), ("normal", 3), ("depth", 40), ("S0", 40)):
        layer.select_option(name)
        expect(page.get_by_role("button", name="Error", exact=True)).to_be_disabled()
        expect(page.get_by_text(f"Reading {name}…")).to_have_count(0)
        page.wait_for_timeout(400)
        seen[name] = picture_colours(page, tmp_path)
        assert len(seen[name]) >= least, name
    layer.select_option("depth")
    expect(page.get_by_role("group", name="Legend")).to_contain_text("depth")
    path = tmp_path / "job.exr"
    path.write_bytes(page.request.get(f"{service.url}/api/jobs/{layered}/image.exr").body())
    depth = values(path)[..., names(path).index("depth")]
    low, high = (
        float(page.get_by_role("textbox", name=f"{end} end of the range").input_value()) for end in ("Left", "Right")
    )
    assert depth.min() <= low < high <= depth.max() * 1.001
    page.locator("#viewer").focus()
    page.keyboard.press("Enter")
    card = page.get_by_role("region", name="Layers at the pixel")
    expect(card).to_contain_text(re.compile(r"albedo[\s\S]*normal[\s\S]*depth|depth[\s\S]*normal"))
    told = re.search(r"depth\s+([\d.]+)", card.inner_text())
    assert told
    assert float(told[1]) == pytest.approx(float(depth[24, 24]), rel=1e-3)
    expect(card).to_contain_text("s.e.")


def test_layers_are_chosen_when_a_render_is_submitted(page: Page, service: Service) -> None:
    page.goto(f"{service.url}/#/")
    page.get_by_role("button", name="New render").click()
    dialog = page.get_by_role("dialog", name="New render")
    dialog.get_by_text("Cornell box").click()
    dialog.get_by_role("textbox", name="Width").fill("32")
    dialog.get_by_role("checkbox", name="Depth").check()
    dialog.get_by_role("checkbox", name="Normal").check()
    with page.expect_request(lambda request: request.method == "POST" and request.url.endswith("/api/jobs")) as sent:
        dialog.get_by_role("button", name="Start render").click()
    assert set(json.loads(sent.value.post_data or "")["settings"]["channels"]) == {"depth", "normal"}
    expect(page.get_by_role("combobox", name="Layer")).to_be_visible()
    service.wait_ended(page.evaluate("location.hash.match(/jobs.([^?]+)/)[1]"))


def test_false_colours_keep_to_a_range_by_hand_and_the_view_is_saved(
    page: Page, service: Service, tmp_path: Path
) -> None:
    """One pixel of each of four values: their colours are those of the map's ends and between."""
    ramp = np.repeat(np.array([[0.0, 1.0], [2.0, 3.0]], np.float32)[..., None], 3, axis=-1)
    page.goto(f"{service.url}/#/")
    page.get_by_label("Picture file").set_input_files(write(tmp_path / "ramp.exr", ramp))
    page.wait_for_function("Number(document.querySelector('#viewer')?.dataset.frame) > 0")
    page.locator("#viewer").focus()
    page.keyboard.press("c")
    expect(page.get_by_role("combobox", name="Tone map or false colours")).to_have_value("viridis")
    right = page.get_by_role("textbox", name="Right end of the range")
    right.fill("2")
    right.press("Enter")
    page.get_by_role("textbox", name="Left end of the range").fill("1")
    page.get_by_role("textbox", name="Left end of the range").press("Enter")
    page.wait_for_timeout(400)
    view = values(saved_view(page, tmp_path), "uint8")[..., :3].astype(int)
    height, width, _ = view.shape
    at = {(y, x): view[(2 * y + 1) * height // 4, (2 * x + 1) * width // 4] for y in (0, 1) for x in (0, 1)}
    for place in ((0, 0), (0, 1)):
        assert np.abs(at[place] - [68, 1, 84]).max() <= 3, "at and below the left end: viridis begins"
    for place in ((1, 0), (1, 1)):
        assert np.abs(at[place] - [253, 231, 37]).max() <= 3, "at and above the right end: it ends"
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    page.locator("#viewer").press("Shift+C")
    expect(page.get_by_role("status").filter(has_text="Copied as a picture.")).to_be_visible()
    kinds = page.evaluate("navigator.clipboard.read().then((items) => items.flatMap((item) => item.types))")
    assert kinds == ["image/png"]
    page.get_by_role("button", name="Auto").click()
    page.wait_for_timeout(400)
    view = values(saved_view(page, tmp_path), "uint8")[..., :3].astype(int)
    assert np.abs(view[height // 4, 3 * width // 4] - [49, 104, 142]).max() <= 6, "a third: viridis at 0.33"


def drag(page: Page, fraction: float) -> None:
    box = page.locator("#viewer").bounding_box()
    assert box is not None
    page.keyboard.press("o")
    side = min(box["width"], box["height"]) * fraction / 2
    middle = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.move(middle[0] - side, middle[1] - side)
    page.mouse.down()
    page.mouse.move(middle[0] + side, middle[1] + side, steps=4)
    page.mouse.up()


def test_a_region_tells_each_channel_with_its_interval(
    page: Page, service: Service, layered: str, tmp_path: Path
) -> None:
    open_job(page, service, layered)
    drag(page, 0.5)
    card = page.get_by_role("region", name=REGION)
    expect(card).to_contain_text("± 95 %")
    box = [
        int(n)
        for n in re.findall(
            r"\d+", card.inner_text().split("pixels")[0] + card.inner_text().split("at (")[1].split(")")[0]
        )
    ]
    width, height, x, y = box
    path = tmp_path / "job.exr"
    path.write_bytes(page.request.get(f"{service.url}/api/jobs/{layered}/image.exr").body())
    channels = dict(zip(names(path), np.moveaxis(values(path).astype(float), -1, 0), strict=True))
    inside = (slice(y, y + height), slice(x, x + width))
    shown, half = (float(n) for n in card.locator("[data-part=mean]").first.inner_text().split("±"))
    assert shown == pytest.approx(channels["R"][inside].mean(), abs=half)
    error = np.sqrt((channels["stderr.R"][inside] ** 2).sum()) / (width * height)
    assert 1.8 * error < half < 2.3 * error  # half is told with two digits
    expect(card).to_contain_text("have a trusted interval")
    expect(card.get_by_role("img", name=re.compile("Histogram of R, G and B"))).to_be_visible()


def test_where_pixels_share_samples_a_region_tells_a_bound(page: Page, service: Service) -> None:
    """A film's own filter is a Gaussian, which reaches over neighbouring pixels."""
    sent = httpx.post(f"{service.url}/api/scenes", files={"file": ("own.xml", OWN_SCENE.encode())}, timeout=60)
    assert sent.is_success, sent.text
    ids = []
    for seed in (1, 2):
        body = {"scene": {"id": sent.json()["id"]}, "target": {"spp": 64}, "settings": {"seed": seed}}
        ids.append(httpx.post(f"{service.url}/api/jobs", json=body, timeout=60).json()["id"])
        assert service.wait_ended(ids[-1])["state"] == "succeeded"
    open_job(page, service, f"{ids[0]}?with={ids[1]}&region=18,4,10,8")
    card = page.get_by_role("region", name=REGION)
    expect(card).to_contain_text("± at most")
    expect(card.locator("[data-part=bound]")).to_contain_text("share samples")
    expect(card.locator("[data-part=z]")).to_contain_text("not known: neighbouring pixels share samples")


def test_two_independent_pictures_have_a_z_between_regions(page: Page, service: Service, layered: str) -> None:
    other = service.submit({"spp": 128}, width=48, height=48, seed=5, independent_pixels=True)
    assert service.wait_ended(other)["state"] == "succeeded"
    open_job(page, service, f"{layered}?with={other}&region=8,8,20,20")
    told = page.get_by_role("region", name=REGION).locator("[data-part=z]")
    expect(told).to_contain_text("standard errors of the mean")
    found = re.search(r"([−\d.]+) standard errors", told.inner_text())
    assert found
    assert abs(float(found[1].replace("−", "-"))) < 4.5


def test_a_link_carries_zoom_pixel_region_colours_and_layer(page: Page, service: Service, layered: str) -> None:
    look = "layer=depth&map=cividis&range=1,5&log=1&zoom=6&at=20,30&px=7,9&region=2,3,10,12"
    open_job(page, service, f"{layered}?{look}")
    expect(page.get_by_role("combobox", name="Layer")).to_have_value("depth")
    expect(page.get_by_role("combobox", name="Tone map or false colours")).to_have_value("cividis")
    expect(page.get_by_role("textbox", name="Right end of the range")).to_have_value("5")
    expect(page.get_by_role("button", name="Logarithmic")).to_have_attribute("aria-pressed", "true")
    expect(page.get_by_label("Zoom factor")).to_have_text(re.compile("600"))
    expect(page.get_by_role("region", name="Pixel", exact=True)).to_contain_text("(7, 9)")
    expect(page.get_by_role("region", name=REGION)).to_contain_text("10 × 12 pixels at (2, 3)")
    page.wait_for_timeout(600)
    assert page.evaluate("location.hash") == f"#/jobs/{layered}?{look}"
    # What is changed here is in the link again.
    page.locator("#viewer").focus()
    page.keyboard.press("ArrowRight")
    page.keyboard.press("f")
    page.wait_for_function("location.hash.includes('px=8,9') && !location.hash.includes('zoom')")
