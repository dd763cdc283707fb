"""A real service and a real browser: the page is tried as a person meets it.

Chromium is the system's own (`chromium` on the PATH), or the one that `playwright install chromium` brings.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator

import pytest
from places import Stage
from playwright.sync_api import Browser, Page, expect, sync_playwright
from playwright.sync_api import Error as BrowserError
from running import CHROMIUM_ARGUMENTS, PAGE, Service, serve

# A machine with other work to do is slow, not wrong.
WAIT_MS = 30_000
expect.set_options(timeout=WAIT_MS)


@pytest.fixture(scope="session")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """A service of its own process, on a free port, with an empty data folder."""
    if not PAGE.is_file():
        pytest.skip("the page is not built: python hatch_build.py builds it")
    with serve(tmp_path_factory.mktemp("browser")) as running:
        yield running


@pytest.fixture(scope="session")
def finished_job(service: Service) -> str:
    """Id of a small job that has ended."""
    job_id = service.submit({"spp": 256}, width=96, height=96)
    assert service.wait_ended(job_id)["state"] == "succeeded"
    return job_id


@pytest.fixture(scope="session")
def stage(service: Service, finished_job: str, tmp_path_factory: pytest.TempPathFactory) -> Stage:
    """What every place of the page shows: an ended job, and one of the same size to compare it with."""
    against = service.submit({"spp": 64}, width=96, height=96, technique="bsdf")
    assert service.wait_ended(against)["state"] == "succeeded"
    return Stage(service, tmp_path_factory.mktemp("stage"), finished_job, against)


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
    context.set_default_timeout(WAIT_MS)
    opened = context.new_page()
    errors: list[str] = []
    opened.on("pageerror", lambda error: errors.append(str(error)))
    yield opened
    context.close()
    assert not errors
