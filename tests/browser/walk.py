"""`python -m tests.browser.walk FOLDER [PLACE …]`: a picture of every place of the page, to be looked at.

Each place of `places.py` at 1440, 900 and 420 pixels, dark and light: FOLDER/PLACE-WIDTH-THEME.png, the whole page.
"""

from __future__ import annotations

import argparse
import contextlib
import shutil
import sys
import tempfile
from pathlib import Path

from playwright.sync_api import TimeoutError, expect, sync_playwright

# `places` imports as the tests do, which run with this folder on the path.
sys.path.insert(0, str(Path(__file__).parent))
from places import PLACES, remember_theme, set_up
from running import CHROMIUM_ARGUMENTS, serve

WIDTHS = {1440: 900, 900: 900, 420: 860}


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("places", nargs="*", choices=[[], *PLACES], default=[], metavar="PLACE")
    parser.add_argument("--width", type=int, action="append", choices=list(WIDTHS))
    parser.add_argument("--theme", action="append", choices=["dark", "light"])
    asked = parser.parse_intermixed_args()
    asked.folder.mkdir(parents=True, exist_ok=True)
    expect.set_options(timeout=30_000)
    with tempfile.TemporaryDirectory() as folder, serve(Path(folder)) as service, sync_playwright() as playwright:
        stage = set_up(service, Path(folder), size=(384, 384), spp=32)
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=CHROMIUM_ARGUMENTS)
        for name in asked.places or PLACES:
            for width in asked.width or WIDTHS:
                for theme in asked.theme or ("dark", "light"):
                    viewport = {"width": width, "height": WIDTHS[width]}
                    context = browser.new_context(viewport=viewport, bypass_csp=True)  # type: ignore[arg-type]
                    page = context.new_page()
                    remember_theme(page, theme)
                    try:
                        PLACES[name](page, stage)
                    except Exception as problem:  # the other places are worth a look all the same
                        print(f"{name} at {width}, {theme}: {problem}")
                    # Pictures below the fold would wait for somebody to scroll.
                    page.evaluate("for (const image of document.images) image.loading = 'eager'")
                    with contextlib.suppress(TimeoutError):  # some places hold answers back on purpose
                        page.wait_for_function("[...document.images].every((image) => image.complete)", timeout=5000)
                    page.screenshot(path=asked.folder / f"{name}-{width}-{theme}.png", full_page=True)
                    context.close()
        browser.close()
    print(f"wrote {asked.folder}")


if __name__ == "__main__":
    main()
