"""A real service and a real browser: the page is tried as a person meets it.

Chromium is the system's own (`chromium` on the PATH), or the one that `playwright install chromium` brings. WebGL2 runs
on the processor through SwiftShader, so no graphics device is needed.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest
from playwright.sync_api import Browser, Page, sync_playwright
from playwright.sync_api import Error as BrowserError

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "service" / "static" / "index.html"
START_SECONDS = 60
CHROMIUM_ARGUMENTS = [
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
    "--disable-quic",
]


@dataclass(frozen=True)
class Service:
    """A running service."""

    url: str

    def submit(self, target: dict[str, Any], **settings: Any) -> str:
        """Id of a new job of the Cornell box."""
        body = {"scene": {"gallery": "cornell-box"}, "target": target, "settings": settings}
        answer = httpx.post(f"{self.url}/api/jobs", json=body, timeout=30)
        assert answer.status_code == 201, answer.text
        return answer.json()["id"]

    def job(self, job_id: str) -> dict[str, Any]:
        return httpx.get(f"{self.url}/api/jobs/{job_id}", timeout=30).json()

    def wait_ended(self, job_id: str, seconds: float = 60) -> dict[str, Any]:
        ends = time.monotonic() + seconds
        while (job := self.job(job_id))["state"] not in ("succeeded", "failed", "cancelled"):
            assert time.monotonic() < ends, f"job {job_id} did not end within {seconds:g} s: {job}"
            time.sleep(0.1)
        return job


@pytest.fixture(scope="session")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """A service of its own process, on a free port, with an empty data folder."""
    if not PAGE.is_file():
        pytest.skip("the page is not built: python hatch_build.py builds it")
    folder = tmp_path_factory.mktemp("browser")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    code = "import sys, pathlib as p; from service.serve import run; run(None, int(sys.argv[1]), p.Path(sys.argv[2]))"
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    with (folder / "log.txt").open("wb") as log:
        process = subprocess.Popen(
            [sys.executable, "-c", code, str(port), str(folder / "data")],
            cwd=ROOT,
            env=environment,
            stdout=log,
            stderr=log,
        )
    running = Service(f"http://127.0.0.1:{port}")
    try:
        _wait_ready(running, process, folder / "log.txt")
        yield running
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(20)
        except subprocess.TimeoutExpired:
            process.kill()


def _wait_ready(service: Service, process: subprocess.Popen[bytes], log: Path) -> None:
    ends = time.monotonic() + START_SECONDS
    while time.monotonic() < ends:
        assert process.poll() is None, log.read_text()
        with contextlib.suppress(httpx.TransportError):
            if httpx.get(f"{service.url}/readyz", timeout=5).status_code == 200:
                return
        time.sleep(0.1)
    pytest.fail(f"the service was not ready within {START_SECONDS} s\n{log.read_text()}")


@pytest.fixture(scope="session")
def finished_job(service: Service) -> str:
    """Id of a small job that has ended."""
    job_id = service.submit({"spp": 256}, width=96, height=96)
    assert service.wait_ended(job_id)["state"] == "succeeded"
    return job_id


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """Headless Chromium with WebGL2. Ends with its module: an open Playwright keeps an event loop running, in which
    tests that start their own fail.
    """
    with sync_playwright() as playwright:
        try:
            running = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=CHROMIUM_ARGUMENTS)
        except BrowserError as error:
            pytest.skip(f"no Chromium to try the page with: {error.message.splitlines()[0]}")
        yield running
        running.close()


@pytest.fixture
def page(browser: Browser) -> Iterator[Page]:
    """A fresh page of 1440×900; errors in its scripts fail the test."""
    # Playwright's wait_for_function evaluates text, which the service's policy forbids; test_policy.py keeps to it.
    context = browser.new_context(viewport={"width": 1440, "height": 900}, accept_downloads=True, bypass_csp=True)
    context.set_default_timeout(20_000)
    opened = context.new_page()
    errors: list[str] = []
    opened.on("pageerror", lambda error: errors.append(str(error)))
    yield opened
    context.close()
    assert not errors
