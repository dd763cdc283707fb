"""`python -m tests.browser.screenshot [FILE]`: the picture of the page that the README shows, made by rendering.

Two techniques on one scene with the same target, in a wipe, with their curves and the efficiency ratio.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

from playwright.sync_api import sync_playwright

from tests.browser.running import CHROMIUM_ARGUMENTS, ROOT, serve

TARGET = ROOT / "web" / "page.png"
SECONDS = 90


def main(arguments: list[str]) -> None:
    """Render, open, take."""
    target = Path(arguments[0]) if arguments else TARGET
    with tempfile.TemporaryDirectory() as folder, serve(Path(folder)) as service, sync_playwright() as playwright:
        limits = {"error": 0.05, "seconds": SECONDS}
        ids = [service.submit(limits, "plates", technique=name, width=480, height=320) for name in ("mis", "bsdf")]
        for job_id in ids:
            service.wait_ended(job_id, 6 * SECONDS)
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=CHROMIUM_ARGUMENTS)
        page = browser.new_page(viewport={"width": 1440, "height": 900}, bypass_csp=True)
        page.goto(f"{service.url}/#/jobs/{ids[0]}?with={ids[1]}")
        page.wait_for_function("Number(document.querySelector('#viewer')?.dataset.frame) > 0")
        page.get_by_text("times less render time").wait_for()
        box = page.locator("#viewer").bounding_box()
        assert box is not None
        page.mouse.click(box["x"] + 0.36 * box["width"], box["y"] + 0.62 * box["height"])
        page.locator("[data-part=pixel]").get_by_text("replicate").wait_for()
        page.wait_for_timeout(500)
        page.screenshot(path=target)
        browser.close()
    print(f"wrote {target}")


if __name__ == "__main__":
    main(sys.argv[1:])
