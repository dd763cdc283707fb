"""What the page says in each state of a job, and how it gets over a service that goes away."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from places import PLACES, Stage
from playwright.sync_api import Page, Route, expect
from running import Service, serve
from screen import open_job, picture_colours

from service.clients import Keys
from service.store import Database
from service.store.keys import KeyStore


@pytest.fixture(scope="module")
def narrow(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """A service that runs one job at a time, and that a test may kill."""
    settings = {"FREDHOLM_MAX_RUNNING_JOBS": "1", "FREDHOLM_CHECKPOINT_SECONDS": "0.3", "FREDHOLM_WARM_UP": "0"}
    running = Service(tmp_path_factory.mktemp("narrow"), settings)
    running.start()
    yield running
    running.stop()


def test_the_empty_page_offers_scenes(page: Page, stage: Stage) -> None:
    PLACES["empty"](page, stage)
    expect(page.get_by_role("main")).to_contain_text("Pick a scene or drop a Mitsuba .xml or .zip here.")
    page.get_by_role("button", name="Cornell box").click()
    dialog = page.get_by_role("dialog", name="New render")
    expect(dialog.get_by_role("radio", name="Cornell box")).to_be_checked()


@pytest.mark.slow
def test_queued_paused_and_a_restart(page: Page, narrow: Service, tmp_path: Path) -> None:
    running = narrow.submit({"seconds": 600}, width=64, height=64)
    waiting = narrow.submit({"spp": 64}, width=32, height=32)
    page.goto(f"{narrow.url}/#/jobs/{waiting}")
    expect(page.get_by_role("main")).to_contain_text("1st in the queue")
    page.locator("aside").get_by_role("button", name="Pause").click()
    expect(page.get_by_role("main")).to_contain_text("Paused before the first samples.")
    expect(page.get_by_role("navigation", name="Jobs")).to_contain_text("paused")

    open_job(page, narrow, running)
    expect(page.locator("aside")).to_contain_text("relative error")
    refused: list[str] = []

    def refuse(route: Route) -> None:
        refused.append(route.request.url)
        route.fulfill(status=503, body="busy")

    # A stream that was live is answered 503 when the browser takes it up again: for EventSource that is the end.
    page.route("**/api/events", refuse)
    narrow.kill()
    expect(page.get_by_role("banner")).to_contain_text("Connection lost")
    expect(page.locator("[role=status]", has_text="Picture from")).to_be_visible()
    assert len(picture_colours(page, tmp_path)) > 200, "the picture stays"
    before = float(page.locator("#viewer").get_attribute("data-frame") or 0)
    narrow.start()
    page.wait_for_timeout(4000)
    page.unroute("**/api/events")
    assert refused
    expect(page.get_by_role("banner")).to_contain_text("Live", timeout=30_000)
    page.wait_for_function(
        f"Number(document.querySelector('#viewer')?.dataset.frame) !== {before:g}"
        " && Number(document.querySelector('#viewer')?.dataset.frame) > 0",
        timeout=30_000,
    )
    expect(page.locator("aside")).to_contain_text("relative error")
    page.locator("aside").get_by_role("button", name="Cancel").click()
    expect(page.locator("aside")).to_contain_text("Cancelled")


def test_a_failed_job_says_why_and_what_to_try(page: Page, service: Service) -> None:
    job_id = service.submit({"spp": 16}, width=16, height=16)
    failed = service.wait_ended(job_id) | {
        "state": "failed",
        "frame_seq": 0,
        "error": None,
        "cause": {
            "title": "The render process died",
            "detail": "Rendering was tried 3 times.",
            "hint": "Try fewer pixels.",
        },
    }

    # A scene that kills the renderer is no stable thing to ship: the service's own answer with another end.
    page.route(f"**/api/jobs/{job_id}", lambda route: route.fulfill(json=failed))
    page.route("**/api/jobs?limit=*", lambda route: route.fulfill(json={"jobs": [failed], "total": 1}))
    page.goto(f"{service.url}/#/jobs/{job_id}")
    card = page.get_by_role("alert")
    expect(card).to_contain_text("The render process died")
    expect(card).to_contain_text("What to try: Try fewer pixels.")
    expect(page.get_by_role("navigation", name="Jobs")).to_contain_text("The render process died")
    card.get_by_role("button", name="Edit and retry").click()
    expect(page.get_by_role("dialog", name="New render").get_by_role("textbox", name="Width")).to_have_value("16")


def test_a_job_deleted_elsewhere_leaves_the_page(page: Page, service: Service) -> None:
    job_id = service.submit({"spp": 16}, width=16, height=16)
    service.wait_ended(job_id)
    open_job(page, service, job_id)
    row = page.get_by_role("navigation", name="Jobs").locator(f"a[href*='{job_id}']")
    expect(row).to_have_count(1)
    service.delete(job_id)
    expect(page.get_by_text("No job with this address.")).to_be_visible()
    expect(row).to_have_count(0)


def test_a_key_that_opens_nothing_leads_to_the_form(page: Page, service: Service) -> None:
    refusal = {"type": "key-needed", "title": "Who are you?", "status": 401, "detail": "This key opens nothing."}
    page.route("**/api/**", lambda route: route.fulfill(status=401, json=refusal))
    page.goto(f"{service.url}/#/")
    expect(page.get_by_label("API key")).to_be_visible()


@pytest.mark.slow
def test_a_reader_signs_in_looks_and_signs_out(page: Page, tmp_path: Path) -> None:
    with serve(tmp_path, FREDHOLM_API_KEYS="on", FREDHOLM_WARM_UP="0") as keyed:
        database = Database(f"sqlite:///{tmp_path / 'data' / 'fredholm.sqlite'}")
        key = Keys(KeyStore(database), tmp_path / "data" / "secret").create("alice", "read")[1]
        database.close()
        page.goto(keyed.url)
        page.get_by_label("API key").fill(key)
        page.get_by_role("button", name="Open").click()
        expect(page.get_by_role("banner")).to_contain_text("alice")
        expect(page.get_by_role("button", name="New render")).to_be_disabled()
        page.get_by_role("button", name="Sign out").click()
        expect(page.get_by_label("API key")).to_be_visible()
        page.goto(keyed.url)
        expect(page.get_by_label("API key")).to_be_visible()


@pytest.mark.slow
def test_a_slow_link_gets_smaller_frames(page: Page, service: Service) -> None:
    job_id = service.submit({"seconds": 30}, width=64, height=64)
    session = page.context.new_cdp_session(page)
    session.send("Network.enable")
    page.goto(f"{service.url}/#/jobs/{job_id}")
    with page.expect_request("**/frames/latest*scale=2*", timeout=60_000):
        slow = {"offline": False, "latency": 1700, "downloadThroughput": 200_000, "uploadThroughput": 200_000}
        session.send("Network.emulateNetworkConditions", slow)
    expect(page.get_by_role("main")).to_contain_text("2×2 means: slow link", timeout=60_000)
    session.send(
        "Network.emulateNetworkConditions", slow | {"latency": 0, "downloadThroughput": -1, "uploadThroughput": -1}
    )
    page.locator("aside").get_by_role("button", name="Cancel").click()
    expect(page.locator("aside")).to_contain_text("Cancelled")
    expect(page.get_by_role("main")).not_to_contain_text("2×2 means", timeout=30_000)
