"""`python -m tests.benchmarks.page`: how long a person waits for the page, in a real Chromium with software graphics.

    weight          bytes of the built page, gzipped
    first paint     from opening the address to the first text, on loopback, of a browser that is already running
    first picture   from pressing Start render to the first picture, 512×512, on a warm service
    frames          new pictures a second in the 8 s after that
    frame           from the bytes of a 1280×720 frame to its picture on the screen: decoding, upload, drawing
    4K pause        longest time that the page does not answer while a 3840×2160 frame arrives and is drawn (--large)
    behind          how old the shown picture gets before the next one, with the page busy for 300 of every 400 ms

The times depend on the machine; they are printed, not asserted.
"""

from __future__ import annotations

import argparse
import gzip
import itertools
import json
import shutil
import statistics
import tempfile
import threading
import time
from pathlib import Path

import httpx
from playwright.sync_api import Browser, Page, sync_playwright

from tests.browser.running import CHROMIUM_ARGUMENTS, ROOT, Service, serve

AIMS = {
    "weight_kb": "under 120",
    "first_paint_ms": "under 500",
    "first_picture_ms": "under 1000",
    "frames_a_second": "at least 1",
    "frame_ms": "under 60",
    "pause_4k_ms": "under 100",
    "behind_ms": "under 500",
}


def weight_kb() -> float:
    """Of all that a browser loads, gzipped, in kB."""
    static = ROOT / "service" / "static"
    files = [static / "index.html", static / "favicon.svg", *(static / "assets").iterdir()]
    return sum(len(gzip.compress(path.read_bytes(), 9)) for path in files) / 1000


def opened(browser: Browser, service: Service, address: str = "") -> Page:
    """A page of its own, as a first visit."""
    page = browser.new_page(viewport={"width": 1440, "height": 900}, bypass_csp=True)
    page.goto(f"{service.url}/{address}")
    return page


def first_paint_ms(browser: Browser, service: Service) -> float:
    """First contentful paint."""
    page = opened(browser, service)
    page.wait_for_function("performance.getEntriesByName('first-contentful-paint').length > 0")
    taken: float = page.evaluate("performance.getEntriesByName('first-contentful-paint')[0].startTime")
    page.close()
    return taken


def first_pictures(browser: Browser, service: Service) -> tuple[float, float]:
    """Milliseconds from the button to the picture, and pictures a second from then on."""
    page = opened(browser, service, "#/")
    page.get_by_role("button", name="New render").click()
    dialog = page.get_by_role("dialog", name="New render")
    dialog.get_by_text("Cornell box").click()
    dialog.get_by_role("textbox", name="Relative error").fill("0.5")
    page.wait_for_timeout(1500)
    taken, rate = page.evaluate(
        """async () => {
             const buttons = [...document.querySelectorAll('dialog button')];
             const button = buttons.find((entry) => entry.textContent.includes('Start render'));
             const start = performance.now();
             button.click();
             const seen = [];
             let last = 0;
             while (seen.length === 0 || performance.now() < seen[0] + 8000) {
               const seq = Number(document.querySelector('#viewer')?.dataset.frame ?? 0);
               if (seq > last) seen.push(performance.now());
               last = seq;
               await new Promise((resolve) => setTimeout(resolve, 4));
             }
             return [seen[0] - start, (seen.length - 1) / 8];
           }"""
    )
    job_id = page.evaluate("location.hash").split("/")[-1].split("?")[0]
    httpx.post(f"{service.url}/api/jobs/{job_id}/cancel", timeout=30)
    page.close()
    return taken, rate


def frame_ms(browser: Browser, service: Service) -> list[float]:
    """Bytes to screen, of a finished picture shown again and again: nothing renders beside it."""
    job_id = service.submit({"spp": 4}, width=1280, height=720)
    service.wait_ended(job_id, 240)
    page = opened(browser, service, f"#/jobs/{job_id}")
    page.wait_for_function("Number(document.querySelector('#viewer')?.dataset.frame) > 0")
    times = []
    for round_ in range(12):
        page.evaluate(f"location.hash = '#/jobs/nothing-{round_}'")
        page.wait_for_timeout(150)
        page.evaluate(f"location.hash = '#/jobs/{job_id}'")
        page.wait_for_function("Number(document.querySelector('#viewer')?.dataset.milliseconds) > 0")
        times.append(float(page.locator("#viewer").get_attribute("data-milliseconds") or "nan"))
    page.close()
    return times[2:]


def pause_4k_ms(browser: Browser, service: Service) -> float:
    """The worst of a few: what the page's own thread is held up for by 66 MB of picture."""
    job_id = service.submit({"spp": 2}, width=3840, height=2160, adaptive=False)
    service.wait_ended(job_id, 280)
    page = opened(browser, service, "#/")
    page.wait_for_timeout(2000)
    worst = 0.0
    for _ in range(3):
        worst = max(
            worst,
            page.evaluate(
                """async (address) => {
                     let longest = 0, before = performance.now(), isThere = false;
                     location.hash = address;
                     while (!isThere) {
                       await new Promise((resolve) => setTimeout(resolve, 0));
                       const now = performance.now();
                       longest = Math.max(longest, now - before);
                       before = now;
                       isThere = Number(document.querySelector('#viewer')?.dataset.frame) > 0;
                     }
                     return longest;
                   }""",
                f"#/jobs/{job_id}",
            ),
        )
        page.evaluate("location.hash = '#/'")
        page.wait_for_timeout(500)
    page.close()
    return worst


def behind_ms(browser: Browser, service: Service) -> list[float]:
    """Age of what is shown: from when the next frame was ready at the service until a newer one was on the screen."""
    job_id = service.submit({"seconds": 60}, width=512, height=512)
    page = opened(browser, service, f"#/jobs/{job_id}")
    page.wait_for_function("Number(document.querySelector('#viewer')?.dataset.frame) > 0")
    ready: dict[int, float] = {}
    is_over = threading.Event()

    def watch() -> None:
        with httpx.Client(base_url=service.url, timeout=10) as client:
            while not is_over.wait(0.02):
                ready.setdefault(client.get(f"/api/jobs/{job_id}").json()["frame_seq"], time.time() * 1000)

    watcher = threading.Thread(target=watch)
    watcher.start()
    page.evaluate("setInterval(() => { const end = performance.now() + 300; while (performance.now() < end); }, 400)")
    seen: list[list[float]] = page.evaluate(
        """async () => {
             const seen = [], viewer = document.querySelector('#viewer');
             let last = 0;
             const note = () => {
               const seq = Number(viewer.dataset.frame);
               if (seq !== last) seen.push([seq, performance.timeOrigin + performance.now()]);
               last = seq;
             };
             new MutationObserver(note).observe(viewer, { attributes: true });
             await new Promise((resolve) => setTimeout(resolve, 15000));
             return seen;
           }"""
    )
    is_over.set()
    watcher.join()
    httpx.post(f"{service.url}/api/jobs/{job_id}/cancel", timeout=30)
    page.close()
    ages = []
    for (before, _), (_, shown_at) in itertools.pairwise(seen):
        newer = [at for seq, at in ready.items() if seq > before]
        if newer:
            ages.append(max(shown_at - min(newer), 0.0))
    return ages


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, help="write the numbers to this file, too")
    parser.add_argument("--large", action="store_true", help="with the 4K picture, whose rendering takes a while")
    asked = parser.parse_args()
    found: dict[str, float] = {"weight_kb": weight_kb()}
    with tempfile.TemporaryDirectory() as folder, serve(Path(folder)) as service, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=CHROMIUM_ARGUMENTS)
        opened(browser, service).close()
        found["first_paint_ms"] = statistics.median(first_paint_ms(browser, service) for _ in range(3))
        starts = [first_pictures(browser, service) for _ in range(3)]
        found["first_picture_ms"] = statistics.median(first for first, _ in starts)
        found["frames_a_second"] = statistics.median(rate for _, rate in starts)
        found["frame_ms"] = statistics.median(frame_ms(browser, service))
        found["behind_ms"] = statistics.median(behind_ms(browser, service))
        if asked.large:
            found["pause_4k_ms"] = pause_4k_ms(browser, service)
        browser.close()
    for name, value in found.items():
        print(f"{name.replace('_', ' '):18} {value:8.1f}   aim: {AIMS[name]}")
    if asked.json:
        asked.json.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
