"""The Learn view: one pixel's lesson, computed while one waits."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import Page, expect
from running import Service
from test_axe import AXE, axe_findings


def test_a_lesson_about_one_pixel(page: Page, service: Service) -> None:
    page.goto(f"{service.url}/#/learn/cornell-box?x=174&y=445")
    main = page.get_by_role("main", name="Learn")
    expect(main).to_contain_text("diffuse reflection", timeout=60_000)
    expect(main).to_contain_text(re.compile("needs about .* times the samples of mis"), timeout=60_000)
    colours = page.evaluate(
        """() => { const canvas = document.querySelector('.map canvas');
             const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
             return new Set(new Uint32Array(data.buffer)).size; }"""
    )
    assert colours > 100
    expect(main.get_by_text(re.compile("4096 samples each"))).to_be_visible(timeout=60_000)
    if AXE.is_file():
        assert axe_findings(page, AXE) == []
    more = main.get_by_role("button", name="Twice the samples")
    expect(more).to_be_enabled(timeout=60_000)
    more.click()
    expect(main.get_by_text(re.compile("8192 samples each"))).to_be_visible(timeout=60_000)

    picker = page.get_by_role("button", name=re.compile("Pixel of Cornell box"))
    picker.focus()
    page.keyboard.press("Shift+ArrowLeft")
    expect(page.get_by_role("spinbutton", name="x")).to_have_value("173")
    assert page.evaluate("location.hash") == "#/learn/cornell-box?x=173&y=445"


@pytest.mark.parametrize("width", [1440, 900, 420])
def test_the_lesson_fits(page: Page, service: Service, width: int) -> None:
    page.set_viewport_size({"width": width, "height": 900})
    page.goto(f"{service.url}/#/learn/cornell-box?x=174&y=445")
    expect(page.get_by_role("main", name="Learn")).to_contain_text("diffuse reflection", timeout=60_000)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
