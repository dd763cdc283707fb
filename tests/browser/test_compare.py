"""Two jobs on the bench, the other views, the region, and what can be done with a job that is there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect
from running import Service
from screen import open_job, picture_colours

DETAILS = "aside"


@pytest.fixture(scope="module")
def pair(service: Service) -> tuple[str, str]:
    """Two ended jobs of one scene and size: mis, and bsdf alone."""
    ids = [service.submit({"spp": 128}, width=64, height=64, technique=name, seed=7) for name in ("mis", "bsdf")]
    for job_id in ids:
        assert service.wait_ended(job_id)["state"] == "succeeded"
    return ids[0], ids[1]


def settle(page: Page) -> None:
    """Waits until what was asked for is drawn."""
    page.wait_for_timeout(350)


def test_every_way_of_comparing_draws_something(
    page: Page, service: Service, pair: tuple[str, str], tmp_path: Path
) -> None:
    first, second = pair
    open_job(page, service, f"{first}?with={second}")
    strip = page.get_by_role("group", name="Comparison", exact=True)
    expect(strip).to_contain_text("mis")
    expect(strip).to_contain_text("bsdf")
    handle = page.get_by_role("slider", name="Wipe")
    handle.focus()
    before = handle.get_attribute("aria-valuenow")
    page.keyboard.press("Shift+ArrowRight")
    assert handle.get_attribute("aria-valuenow") != before
    page.locator("#viewer").focus()
    for key, pressed in (("s", "Side by side"), ("2", "Flip"), ("1", "Flip"), ("w", "Wipe"), ("d", "Difference")):
        page.keyboard.press(key)
        expect(page.get_by_role("button", name=pressed, exact=True)).to_have_attribute("aria-pressed", "true")
        settle(page)
        assert len(picture_colours(page, tmp_path)) > 60, pressed
    expect(page.get_by_role("group", name="Legend")).to_contain_text(re.compile(r"beyond ±1\.96, 5\s% expected"))
    # Not after so few rounds: a ratio without an interval is none.
    expect(page.get_by_role("region", name="Comparison in numbers")).to_contain_text("The efficiency ratio comes once")
    expect(page.get_by_role("region", name="Convergence")).to_contain_text("B: bsdf")

    page.keyboard.press("x")
    expect(strip).to_contain_text(re.compile("A.*bsdf.*B.*mis"))
    strip.get_by_role("button", name="Stop comparing").click()
    expect(strip).to_have_count(0)
    expect(page.get_by_role("button", name="Difference")).to_be_disabled()


def test_a_link_brings_back_what_was_looked_at(page: Page, service: Service, pair: tuple[str, str]) -> None:
    first, second = pair
    open_job(page, service, first)
    page.get_by_role("combobox", name="Compare with").select_option(second)
    page.keyboard.press("s")
    page.keyboard.press("h")
    page.keyboard.press("e")
    expect(page.get_by_role("button", name="Error", exact=True)).to_have_attribute("aria-pressed", "true")
    assert page.evaluate("location.hash") == f"#/jobs/{first}?view=error&ev=0.5&with={second}&layout=side"
    page.reload()
    expect(page.get_by_role("button", name="Side by side")).to_have_attribute("aria-pressed", "true")
    expect(page.get_by_role("button", name="Error", exact=True)).to_have_attribute("aria-pressed", "true")
    expect(page.get_by_label("Exposure in stops")).to_have_value("0.5")


@pytest.mark.parametrize(("mode", "says"), [("Samples", "samples per pixel"), ("Trust", "interval trusted")])
def test_samples_and_trust_are_maps(
    page: Page, service: Service, pair: tuple[str, str], tmp_path: Path, mode: str, says: str
) -> None:
    open_job(page, service, pair[1])
    plain = picture_colours(page, tmp_path)
    with page.expect_response(re.compile("maps=1")):
        page.get_by_role("button", name=mode, exact=True).click()
    expect(page.get_by_role("group", name="Legend")).to_contain_text(says)
    settle(page)
    shown = picture_colours(page, tmp_path)
    # Few colours: all pixels have about as many samples, and what is not trusted yet is striped.
    assert len(shown) >= 2
    assert {tuple(colour) for colour in shown.tolist()} != {tuple(colour) for colour in plain.tolist()}


def test_a_region_is_drawn_measured_and_handed_to_a_new_render(
    page: Page, service: Service, pair: tuple[str, str]
) -> None:
    open_job(page, service, pair[0])
    box = page.locator("#viewer").bounding_box()
    assert box is not None
    page.keyboard.press("o")
    expect(page.get_by_text("Drag a rectangle")).to_be_visible()
    centre = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.move(centre[0] - 60, centre[1] - 40)
    page.mouse.down()
    page.mouse.move(centre[0] + 60, centre[1] + 40, steps=4)
    page.mouse.up()
    card = page.get_by_role("region", name="Region of interest")
    expect(card).to_contain_text(re.compile(r"\d+ × \d+ pixels at \(\d+, \d+\)"))
    expect(card).to_contain_text(re.compile(r"\d\s%"))
    card.get_by_role("button", name="Render with the error counted there").click()
    dialog = page.get_by_role("dialog", name="New render")
    expect(dialog.get_by_role("textbox", name="Error counts in")).to_have_value(re.compile(r"^\d+, \d+, \d+, \d+$"))


def test_pause_resume_continue_and_delete(page: Page, service: Service) -> None:
    job_id = service.submit({"seconds": 600}, width=48, height=48, seed=3)
    open_job(page, service, job_id)
    details = page.locator(DETAILS)
    page.locator("#viewer").focus()
    page.keyboard.press("p")
    expect(details.get_by_role("button", name="Resume")).to_be_visible()
    assert service.job(job_id)["state"] == "paused"
    details.get_by_role("button", name="Resume").click()
    expect(details.get_by_role("button", name="Pause")).to_be_visible()
    details.get_by_role("button", name="Cancel").click()
    expect(details).to_contain_text("Cancelled")

    details.get_by_role("button", name="Continue…").click()
    dialog = page.get_by_role("dialog", name=re.compile("^Continue"))
    dialog.get_by_role("checkbox", name="Render time").uncheck()
    dialog.get_by_role("checkbox", name="Samples per pixel").check()
    reached = service.job(job_id)["spp"]
    dialog.get_by_role("textbox", name="Samples per pixel").fill(str(int(reached) + 64))
    dialog.get_by_role("button", name="Continue").click()
    expect(details).to_contain_text("All samples taken", timeout=30_000)
    assert service.job(job_id)["spp"] >= int(reached) + 64  # a cancel comes in the middle of a round

    with page.expect_download() as download:
        details.get_by_role("link", name="JSON").click()
    assert download.value.suggested_filename.endswith(".json")
    delete = details.get_by_role("button", name="Delete", exact=True)
    bar, rail = page.get_by_role("status", name="Deleted jobs"), page.locator("#rail")
    row = rail.locator(f'a[href*="{job_id}"]')
    for take_back in (lambda: bar.get_by_role("button", name="Undo").click(), lambda: page.keyboard.press("z")):
        delete.click()
        # The second where this was the only job.
        expect(page.get_by_role("heading", name=re.compile("Pick a scene|Nothing rendered yet"))).to_be_visible()
        expect(row).to_have_count(0)
        take_back()
        expect(row).to_be_visible()
        expect(details).to_contain_text("All samples taken")
    assert service.job(job_id)["state"] == "succeeded"
    delete.click()
    expect(bar).to_contain_text("Deleted")
    # Nobody takes it back: after ten seconds it is gone.
    expect(bar.get_by_role("button", name="Undo")).to_have_count(0, timeout=60_000)
    page.goto(f"{service.url}/#/jobs/{job_id}")
    expect(page.get_by_text("No job with this address.")).to_be_visible()


def test_the_chosen_scene_says_what_it_requires(page: Page, service: Service) -> None:
    page.goto(service.url)
    page.get_by_role("button", name="New render").click()
    dialog = page.get_by_role("dialog", name="New render")
    dialog.get_by_text("Cornell box").click()
    dialog.get_by_text("What this scene requires").click(timeout=60_000)
    expect(dialog).to_contain_text("rectangle")
