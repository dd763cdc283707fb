"""The page under the service's own content security policy, which the other tests bypass."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import Browser, expect
from running import Service


@pytest.mark.parametrize("place", ["", "#/jobs/{job}", "docs"])
def test_the_page_breaks_no_rule_of_its_policy(
    browser: Browser, service: Service, finished_job: str, place: str
) -> None:
    context = browser.new_context(viewport={"width": 1440, "height": 900})
    page = context.new_page()
    told: list[str] = []
    page.on("console", lambda message: told.append(message.text) if message.type in ("error", "warning") else None)
    page.on("pageerror", lambda error: told.append(str(error)))
    page.goto(f"{service.url}/{place.format(job=finished_job)}")
    if place.startswith("#/jobs"):
        expect(page.locator("#viewer")).to_have_attribute("data-frame", re.compile("^[1-9]"), timeout=20_000)
        page.locator("#viewer").focus()
        for key in ("h", "h", "d", "ArrowRight"):
            page.keyboard.press(key)
    page.wait_for_timeout(500)
    # How far the page is styled shows that its style sheet was let through.
    assert page.evaluate("getComputedStyle(document.body).fontFamily").startswith("system-ui")
    context.close()
    assert not [text for text in told if "Content Security Policy" in text or "Error" in text]
