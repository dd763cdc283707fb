"""A job on the screen, and what a screenshot shows, as numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray
from playwright.sync_api import Page
from running import Service


def open_job(page: Page, service: Service, address: str) -> None:
    """Shows a job once its picture is drawn. address: its id, with what follows in a link."""
    page.goto(f"{service.url}/#/jobs/{address}")
    page.wait_for_function("Number(document.querySelector('#viewer')?.dataset.frame) > 0", timeout=60_000)


def picture_colours(page: Page, folder: Path) -> NDArray[np.uint8]:
    """Distinct colours of the drawn picture, (n, 3) uint8: a blank canvas has one or two."""
    path = folder / "picture.png"
    page.locator("#viewer").screenshot(path=path)
    pixels = oiio.ImageBuf(str(path)).get_pixels(oiio.UINT8)
    assert pixels is not None, oiio.geterror()
    pixels = pixels[:, :, :3]
    return np.unique(pixels.reshape(-1, 3), axis=0)


def overlaps(page: Page, selectors: list[str]) -> list[str]:
    """Pairs of visible elements whose boxes share more than a pixel, as "a × b"."""
    found = page.evaluate(
        """(selectors) => selectors.flatMap((selector) => [...document.querySelectorAll(selector)].map((element, i) => {
             const { left, top, right, bottom } = element.getBoundingClientRect();
             return { name: `${selector}[${i}]`, left, top, right, bottom };
           })).filter((box) => box.right - box.left > 0 && box.bottom - box.top > 0)""",
        selectors,
    )
    pairs: list[str] = []
    for index, first in enumerate(found):
        for second in found[index + 1 :]:
            width = min(first["right"], second["right"]) - max(first["left"], second["left"])
            height = min(first["bottom"], second["bottom"]) - max(first["top"], second["top"])
            if width > 1 and height > 1:
                pairs.append(f"{first['name']} × {second['name']}")
    return pairs
