"""At every width nothing overlaps or sticks out."""

from __future__ import annotations

import pytest
from playwright.sync_api import Page, expect
from running import Service
from screen import overlaps

APART = [
    "header",
    ".toolbar > *",
    ".well",
    ".legend",
    ".line.number",
    "section.chart",
    "aside > .card",
    "aside > .rest > .card",
]


def show_error_map(page: Page, service: Service, job_id: str) -> None:
    page.goto(f"{service.url}/#/jobs/{job_id}")
    page.wait_for_function("Number(document.querySelector('#viewer')?.dataset.frame) > 0")
    page.keyboard.press("h")
    expect(page.get_by_role("button", name="Only above target")).to_be_visible()


@pytest.mark.parametrize(("width", "height"), [(1440, 900), (900, 900), (420, 800)])
def test_nothing_overlaps_or_sticks_out(
    page: Page, service: Service, finished_job: str, width: int, height: int
) -> None:
    page.set_viewport_size({"width": width, "height": height})
    show_error_map(page, service, finished_job)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert overlaps(page, APART) == []
    if width >= 1100:
        assert page.evaluate("document.querySelector('.toolbar').offsetHeight") < 60, "the toolbar has wrapped"
        assert page.evaluate("document.documentElement.scrollHeight") <= height
        page.add_style_tag(content="#rail ul { min-height: 1500px }")
        assert page.evaluate("document.documentElement.scrollHeight") <= height, "a long list scrolls within the rail"
    page.keyboard.press("Shift+N")
    dialog = page.locator("dialog[open]")
    box = dialog.bounding_box()
    assert box is not None
    assert box["x"] >= 0
    assert box["x"] + box["width"] <= width
    expect(dialog.get_by_role("button", name="Start render")).to_be_in_viewport()


def test_the_rail_becomes_a_menu(page: Page, service: Service, finished_job: str) -> None:
    page.set_viewport_size({"width": 420, "height": 800})
    page.goto(f"{service.url}/#/jobs/{finished_job}")
    expect(page.get_by_role("navigation", name="Jobs")).to_be_hidden()
    page.get_by_role("button", name="Jobs").click()
    page.get_by_role("navigation", name="Jobs").get_by_role("link").first.click()
    expect(page.get_by_role("navigation", name="Jobs")).to_be_hidden()
