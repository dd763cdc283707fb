"""At every width nothing overlaps or sticks out, and axe finds nothing to say."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect
from running import ROOT, Service
from screen import overlaps

AXE = ROOT / "web" / "node_modules" / "axe-core" / "axe.min.js"
APART = [
    "header",
    ".toolbar > *",
    ".well",
    ".legend",
    ".line.number",
    "section.chart",
    "aside > *",
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


@pytest.mark.skipif(not AXE.is_file(), reason="axe-core is not installed: python hatch_build.py installs it")
@pytest.mark.parametrize("theme", ["dark", "light"])
def test_axe_is_clean(page: Page, service: Service, finished_job: str, theme: str) -> None:
    page.add_init_script(f"localStorage.setItem('fredholm.theme', '{theme}')")
    show_error_map(page, service, finished_job)
    found = {"error map": axe_findings(page, AXE)}
    for place, key in (("new render", "Shift+N"), ("help", "?")):
        page.keyboard.press(key)
        expect(page.locator("dialog[open]")).to_be_visible()
        found[place] = axe_findings(page, AXE)
        page.keyboard.press("Escape")
        expect(page.locator("dialog")).to_have_count(0)
    other = service.submit({"spp": 64}, width=96, height=96, technique="bsdf")
    service.wait_ended(other)
    page.get_by_role("combobox", name="Compare with").select_option(other)
    expect(page.get_by_role("slider", name="Wipe")).to_be_visible()
    page.keyboard.press("d")
    found["difference"] = axe_findings(page, AXE)
    page.get_by_role("button", name="Continue…").click()
    found["continue"] = axe_findings(page, AXE)
    page.keyboard.press("Escape")
    expect(page.locator("dialog")).to_have_count(0)
    page.set_viewport_size({"width": 420, "height": 800})
    page.get_by_role("button", name="Jobs").click()
    found["menu"] = axe_findings(page, AXE)
    page.goto(f"{service.url}/#/jobs/nothing")
    expect(page.get_by_text("No job with this address.")).to_be_visible()
    found["unknown job"] = axe_findings(page, AXE)
    assert not any(found.values()), found


def axe_findings(page: Page, script: Path) -> list[str]:
    """Violations, and what axe could not decide, one line each."""
    page.evaluate(script.read_text(encoding="utf-8"))
    report = page.evaluate("axe.run(document, { resultTypes: ['violations', 'incomplete'] })")
    return [
        f"{kind} {rule['id']}: {node['html'][:160]} {json.dumps(node['any'][:1])[:300]}"
        for kind in ("violations", "incomplete")
        for rule in report[kind]
        for node in rule["nodes"]
    ]
