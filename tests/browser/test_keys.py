"""Every key of the table does what the help says; and single keys can be switched off."""

from __future__ import annotations

import pytest
from places import PLACES, Stage
from playwright.sync_api import Page, expect
from running import Service
from screen import open_job

PRESSED = "button[aria-pressed=true]"


def test_picture_keys(page: Page, service: Service, finished_job: str) -> None:
    open_job(page, service, finished_job)
    exposure = page.get_by_label("Exposure in stops")
    for key, value in (("e", "0.5"), ("e", "1"), ("Shift+E", "0.5"), ("r", "0")):
        page.keyboard.press(key)
        expect(exposure).to_have_value(value)
    page.keyboard.press("n")
    expect(exposure).not_to_have_value("0")
    tone = page.get_by_role("combobox", name="Tone map")
    for value in ("filmic", "reinhard", "srgb"):
        page.keyboard.press("t")
        expect(tone).to_have_value(value)
    shown = page.get_by_role("group", name="What is shown")
    page.keyboard.press("h")
    expect(shown.locator(PRESSED)).to_have_text("Error")
    page.keyboard.press("u")
    expect(page.get_by_role("button", name="Only above target")).to_have_attribute("aria-pressed", "true")
    page.keyboard.press("h")
    for name in ("Error", "Samples", "Trust", "Image"):
        page.keyboard.press("v")
        expect(shown.locator(PRESSED)).to_have_text(name)


def test_view_and_probe_keys(page: Page, service: Service, finished_job: str) -> None:
    open_job(page, service, finished_job)
    page.locator("#viewer").focus()
    factor = page.get_by_role("status", name="Zoom factor")
    page.keyboard.press("0")
    expect(factor).to_have_text("100\u202f%")
    page.keyboard.press("+")
    expect(factor).to_have_text("141\u202f%")
    page.keyboard.press("-")
    expect(factor).to_have_text("100\u202f%")
    pixel = page.locator("[data-part=pixel]")
    page.keyboard.press("Enter")
    expect(pixel).to_contain_text("(48, 48)")
    for key, place in (
        ("ArrowLeft", "(47, 48)"),
        ("ArrowUp", "(47, 47)"),
        ("ArrowRight", "(48, 47)"),
        ("ArrowDown", "(48, 48)"),
    ):
        page.keyboard.press(key)
        expect(pixel).to_contain_text(place)
    expect(pixel).to_contain_text("pinned")
    page.keyboard.press("Escape")
    expect(pixel).not_to_contain_text("pinned")
    for key in ("Shift+ArrowLeft", "Shift+ArrowRight", "Shift+ArrowUp", "Shift+ArrowDown"):
        page.keyboard.press(key)
    expect(page.get_by_role("button", name="Fit")).to_have_attribute("aria-pressed", "false")
    page.keyboard.press("f")
    expect(page.get_by_role("button", name="Fit")).to_have_attribute("aria-pressed", "true")
    page.keyboard.press("o")
    expect(page.get_by_text("Drag a rectangle")).to_be_visible()
    page.keyboard.press("Escape")
    expect(page.get_by_text("Drag a rectangle")).to_have_count(0)


TRIED_HERE = "e, Shift E, r, n, t, h, u, v, f, 0, +, -, Shift arrows, arrows, Enter, Esc, o, j, k, Shift N, ?"
TRIED_IN_COMPARING = "1, 2, x, w, s, d, p, z"
TRIED_ELSEWHERE = "c, Shift S, Shift C, g"  # test_looking.py, test_reference.py


def test_the_help_shows_the_keys_that_are_tried_here_and_in_comparing(
    page: Page, service: Service, finished_job: str
) -> None:
    open_job(page, service, finished_job)
    page.keyboard.press("?")
    assert sorted(page.locator("dialog kbd").all_inner_texts()) == sorted(
        f"{TRIED_HERE}, {TRIED_IN_COMPARING}, {TRIED_ELSEWHERE}".split(", ")
    )


FOCUSABLE = "a[href], button:enabled, input:enabled, select, textarea, summary, [tabindex]"


@pytest.mark.parametrize("place", ["difference", "side", "new-chosen", "failed"])
def test_everything_is_reached_with_tab(page: Page, stage: Stage, place: str) -> None:
    PLACES[place](page, stage)
    # Of a group of radio buttons Tab reaches one, and arrows the others. An open dialog holds the focus.
    count = page.evaluate(
        """(focusable) => {
             const area = document.querySelector('dialog[open]') ?? document;
             const groups = new Set();
             return [...area.querySelectorAll(focusable)].filter((element) => {
               if (element.tabIndex < 0 || !element.checkVisibility({ visibilityProperty: true })) return false;
               if (element.type === 'radio') return !groups.has(element.name) && groups.add(element.name);
               return true;
             }).map((element) => (element.dataset.wanted = '')).length;
           }""",
        FOCUSABLE,
    )
    assert count > 10
    page.evaluate("() => { window.reached = new Set(); }")
    for _ in range(count + 12):
        page.keyboard.press("Tab")
        page.evaluate("() => window.reached.add(document.activeElement)")
    missed = page.evaluate(
        """() => [...document.querySelectorAll('[data-wanted]')].filter((element) => {
             if (element.type === 'radio') return ![...window.reached].some((at) => at.name === element.name);
             return !window.reached.has(element);
           }).map((element) => element.outerHTML.slice(0, 160))"""
    )
    assert missed == []


def test_page_keys(page: Page, service: Service, finished_job: str) -> None:
    other = service.submit({"spp": 32}, width=32, height=32)
    service.wait_ended(other)
    open_job(page, service, other)
    page.keyboard.press("j")
    expect(page.locator("nav a[aria-current=page]").first).to_be_visible()
    page.wait_for_function(f"!location.hash.includes('{other}')")
    page.keyboard.press("k")
    page.wait_for_function(f"location.hash.includes('{other}')")


@pytest.mark.parametrize("key", ["?", "Shift+N"])
def test_dialogs_open_by_key_and_return_the_focus(page: Page, service: Service, finished_job: str, key: str) -> None:
    open_job(page, service, finished_job)
    page.locator("#viewer").focus()
    page.keyboard.press(key)
    expect(page.locator("dialog[open]")).to_be_visible()
    page.keyboard.press("Escape")
    expect(page.locator("dialog")).to_have_count(0)
    assert page.evaluate("document.activeElement.id") == "viewer"


def test_single_keys_can_be_switched_off(page: Page, service: Service, finished_job: str) -> None:
    open_job(page, service, finished_job)
    page.keyboard.press("?")
    page.get_by_role("checkbox", name="Single keys act everywhere").uncheck()
    page.keyboard.press("Escape")
    expect(page.locator("dialog")).to_have_count(0)
    exposure = page.get_by_label("Exposure in stops")
    page.locator("body").press("e")
    expect(exposure).to_have_value("0")
    page.locator("#viewer").focus()
    page.keyboard.press("e")
    expect(exposure).to_have_value("0.5")
