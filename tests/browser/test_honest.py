"""The page says no more than is known, keeps what was asked for, and loses nothing silently."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest
from places import OWN_SCENE, Stage, pretend, show
from playwright.sync_api import Page, Route, expect
from running import Service, serve
from screen import open_job

VIEWER_BOX = "() => JSON.stringify(document.querySelector('#viewer').getBoundingClientRect())"


@pytest.mark.parametrize("width", [1440, 900, 420])
def test_no_view_moves_the_picture(page: Page, stage: Stage, width: int) -> None:
    page.set_viewport_size({"width": width, "height": 900})
    show(page, stage, f"#/jobs/{stage.done}?with={stage.against}")
    before = page.evaluate(VIEWER_BOX)
    shown = page.get_by_role("group", name="What is shown")
    for key in ("h", "u", "h", "v", "v", "v", "v", "d"):
        page.keyboard.press(key)
        page.wait_for_timeout(150)
        assert page.evaluate(VIEWER_BOX) == before, f"{key}: {shown.locator('[aria-pressed=true]').inner_text()}"


def test_the_downloaded_png_is_the_picture_that_is_shown(page: Page, stage: Stage, tmp_path: Path) -> None:
    show(page, stage, f"#/jobs/{stage.done}?ev=2")
    page.locator("#viewer").focus()
    page.keyboard.press("0")
    pictures = {}
    for tone in ("srgb", "filmic", "reinhard"):
        page.get_by_role("combobox", name="Tone map").select_option(tone)
        page.wait_for_timeout(400)
        with page.expect_download() as download:
            page.get_by_role("link", name="PNG").click()
        download.value.save_as(tmp_path / "loaded.png")
        page.locator("#viewer").screenshot(path=tmp_path / "shown.png")
        loaded, shown = (_pixels(tmp_path / f"{name}.png") for name in ("loaded", "shown"))
        height, width, _ = loaded.shape
        top, left = (shown.shape[0] - height) // 2, (shown.shape[1] - width) // 2
        around = [
            np.abs(shown[top + y :, left + x :][:height, :width].astype(int) - loaded).mean()
            for y in (-1, 0, 1)
            for x in (-1, 0, 1)
        ]
        assert min(around) < 3, f"{tone}: the nearest is {min(around):.1f} levels off in the mean"
        pictures[tone] = loaded
    assert np.abs(pictures["filmic"].astype(int) - pictures["srgb"]).mean() > 5


@pytest.mark.parametrize("needs", [192, None])
def test_too_few_replicates_to_trust_any_pixel_are_told_with_the_samples_that_it_takes(
    page: Page, stage: Stage, needs: int | None
) -> None:
    health: dict[str, Any] = {"status": "uncertain", "invalid": 0, "invalid_pixels": 0, "empty_pixels": 0}
    health |= {"untrusted": 1.0, "cannot_see": [], "warnings": [], "needs_samples": needs}
    pretend(page, stage, health=health, share_trusted=0.0)
    card = page.get_by_label("Progress", exact=True)
    expect(card.get_by_text("Trusted pixels")).to_be_visible()
    said = card.get_by_text("samples per pixel on")
    expect(said).to_have_count(0 if needs is None else 1)
    if needs is not None:
        expect(said).to_contain_text("from 192 samples per pixel on")


def _pixels(path: Path) -> np.ndarray:
    pixels = oiio.ImageBuf(str(path)).get_pixels(oiio.UINT8)
    assert pixels is not None, oiio.geterror()
    return pixels[..., :3]


def test_again_and_continue_ask_for_all_that_was_asked_for(page: Page, service: Service) -> None:
    target = {"spp": 32, "error": 0.5, "confidence": 0.99, "share": 0.9}
    settings = {"width": 40, "height": 24, "channels": ["albedo", "depth"], "colour": "rgb", "seed": 12345678}
    job_id = service.submit(target, **settings)
    service.wait_ended(job_id)
    open_job(page, service, job_id)
    page.get_by_role("button", name="Again…").click()
    dialog = page.get_by_role("dialog", name="New render")
    for name, is_asked in (("Albedo", True), ("Depth", True), ("Normal", False)):
        expect(dialog.get_by_role("checkbox", name=name)).to_be_checked(checked=is_asked)
    expect(dialog).to_contain_text("99 % sure".replace(" %", "\u202f%"))
    with page.expect_request(lambda request: request.method == "POST") as sent:
        dialog.get_by_role("button", name="Start render").click()
    asked = json.loads(sent.value.post_data or "")
    assert {key: asked["settings"][key] for key in settings} == settings
    assert {key: asked["target"][key] for key in target} == target
    expect(dialog).to_have_count(0)

    open_job(page, service, job_id)
    page.get_by_role("button", name="Continue…").click()
    dialog = page.get_by_role("dialog", name=re.compile("^Continue"))
    dialog.get_by_role("textbox", name="Relative error").fill("1")
    page.route("**/continue", lambda route: route.fulfill(json=service.job(job_id)))
    with page.expect_request(re.compile("/continue$")) as sent:
        dialog.get_by_role("button", name="Continue").click()
    asked = json.loads(sent.value.post_data or "")["target"]
    assert (asked["error"], asked["confidence"], asked["share"]) == (0.01, 0.99, 0.9)


def test_a_width_alone_keeps_the_proportions(page: Page, stage: Stage) -> None:
    show(page, stage, "#/")
    page.get_by_role("button", name="New render").click()
    dialog = page.get_by_role("dialog", name="New render")
    dialog.get_by_text("Cornell box").click()
    dialog.get_by_role("textbox", name="Width").fill("48")
    expect(dialog.get_by_role("textbox", name="Height")).to_have_attribute("placeholder", "48")
    expect(dialog).to_contain_text("48 × 48")
    dialog.get_by_role("checkbox", name="Keep the proportions").uncheck()
    expect(dialog).to_contain_text("48 × 512")


def test_several_files_are_not_cut_to_the_first_one_silently(page: Page, stage: Stage) -> None:
    show(page, stage, "#/")
    page.evaluate(
        """(scene) => {
             const data = new DataTransfer();
             for (const name of ['scene.xml', 'wood.png', 'chair.obj']) data.items.add(new File([scene], name));
             window.dispatchEvent(new DragEvent('drop', { dataTransfer: data, bubbles: true, cancelable: true }));
           }""",
        OWN_SCENE,
    )
    dialog = page.get_by_role("dialog", name="New render")
    expect(dialog.get_by_role("alert")).to_contain_text("3 files")
    expect(dialog.get_by_role("alert")).to_contain_text(".zip")
    # Dropped on the open dialog, but beside its field: taken all the same.
    page.evaluate(
        """(scene) => {
             const data = new DataTransfer();
             data.items.add(new File([scene], 'dropped.xml'));
             const dropped = new DragEvent('drop', { dataTransfer: data, bubbles: true, cancelable: true });
             document.querySelector('dialog').dispatchEvent(dropped);
           }""",
        OWN_SCENE,
    )
    expect(dialog.get_by_role("radio", name="dropped")).to_be_checked()


UNKNOWN = {"error": None, "error_upper": None, "share_within": None, "share_trusted": 0.0, "forecast": None}


def test_an_error_that_is_not_known_is_said_in_a_sentence(page: Page, stage: Stage) -> None:
    pretend(page, stage, **UNKNOWN, stopped_by="seconds", target={"seconds": 45.0, "error": 0.02}, curve=[])
    details = page.get_by_role("region", name="Progress")
    expect(details).to_contain_text("not known")
    expect(details).not_to_contain_text("–")
    histogram = page.get_by_role("region", name="Relative error per pixel")
    expect(histogram).to_be_visible()
    rail = page.get_by_role("navigation", name="Jobs").locator("[aria-current=page]")
    expect(rail).not_to_contain_text("–")


def test_shares_are_of_all_pixels_and_add_up(page: Page, stage: Stage) -> None:
    show(page, stage, f"#/jobs/{stage.done}")
    card = page.get_by_role("region", name="Relative error per pixel")
    expect(card).to_contain_text("are below")
    numbers = [float(share) for share in re.findall(r"([\d.]+)\u202f% (?:of|have|are)", card.inner_text())]
    assert sum(numbers) <= 100.5


def test_the_relative_error_of_a_pixel_says_whether_the_floor_is_in_it(page: Page, stage: Stage) -> None:
    show(page, stage, f"#/jobs/{stage.done}")
    page.locator("#viewer").focus()
    page.keyboard.press("Enter")
    card = page.locator("[data-part=pixel]")
    expect(card).to_contain_text("of the value")
    expect(card).to_contain_text("dark floor")


def test_the_chart_draws_the_bound_that_decides(page: Page, stage: Stage) -> None:
    job_id = stage.service.submit({"error": 0.1, "spp": 256}, width=48, height=48)
    stage.service.wait_ended(job_id)
    show(page, stage, f"#/jobs/{job_id}")
    chart = page.get_by_role("region", name="Convergence")
    expect(chart).to_contain_text("bound")
    expect(chart).to_contain_text("decides")
    page.get_by_role("button", name="Table").click()
    expect(chart.get_by_role("columnheader")).to_have_count(4)


def test_the_same_estimator_is_not_called_more_efficient_than_itself(page: Page, service: Service) -> None:
    ids = [service.submit({"spp": spp}, width=48, height=48, seed=spp) for spp in (64, 512)]
    for job_id in ids:
        service.wait_ended(job_id)
    open_job(page, service, f"{ids[0]}?with={ids[1]}")
    card = page.get_by_role("region", name="Comparison in numbers")
    expect(card).to_contain_text("same estimator")
    expect(card).not_to_contain_text("times less")


def test_a_ratio_is_said_with_its_interval(page: Page, service: Service) -> None:
    ids = [service.submit({"spp": 4096}, width=160, height=120, technique=name) for name in ("mis", "bsdf")]
    for job_id in ids:  # long enough for five points of the curve on a fast machine too
        service.wait_ended(job_id)
    open_job(page, service, f"{ids[0]}?with={ids[1]}")
    card = page.get_by_role("region", name="Comparison in numbers")
    expect(card).to_contain_text(re.compile(r"[\d.]+ to [\d.]+( times less render time|, with 95 % confidence)"))


def test_a_link_that_recovers_shows_whole_pictures_again(page: Page, service: Service) -> None:
    """One frame that takes over 1.5 s, then a quick link; the job goes on."""
    job_id = service.submit({"seconds": 60}, width=64, height=64, seed=11)
    asked: list[str] = []

    def slow_once(route: Route) -> None:
        asked.append(route.request.url)
        if len(asked) == 1:
            page.wait_for_timeout(1800)
        route.continue_()

    page.route("**/frames/latest*", slow_once)
    open_job(page, service, job_id)
    for _ in range(100):
        if any("scale=2" in url for url in asked) and "scale=1" in asked[-1]:
            break
        page.wait_for_timeout(200)
    assert any("scale=2" in url for url in asked), "the slow link is noticed"
    assert "scale=1" in asked[-1], "and measured again"
    expect(page.get_by_text("2×2 means")).to_have_count(0)
    service.cancel(job_id)


def test_choosing_the_weighted_map_does_not_end_the_sampling(page: Page, service: Service) -> None:
    page.goto(f"{service.url}/#/learn/cornell-box?x=100&y=430")
    main = page.get_by_role("main", name="Learn")
    table = main.get_by_role("region", name="Estimates as a table")
    expect(table.locator("tbody tr").first).to_be_visible(timeout=60_000)
    main.get_by_role("button", name="f · L · cos θ").click()
    expect(table.locator("tbody tr")).to_have_count(5, timeout=60_000)
    expect(main.get_by_role("heading", name="What is integrated")).to_be_visible()
    expect(main.get_by_role("button", name="Twice the samples")).to_be_enabled(timeout=60_000)


def test_a_lesson_that_was_broken_off_goes_on_where_it_was(page: Page, service: Service) -> None:
    broken: list[str] = []

    def break_once(route: Route) -> None:
        if not broken and "technique=bsdf" in route.request.url:
            broken.append(route.request.url)
            route.abort()
        else:
            route.continue_()

    page.route("**/samples?*", break_once)
    page.goto(f"{service.url}/#/learn/cornell-box?x=110&y=430")
    main = page.get_by_role("main", name="Learn")
    main.get_by_role("button", name="Try again").click(timeout=60_000)
    expect(main.get_by_role("region", name="Estimates as a table").locator("tbody tr")).to_have_count(5, timeout=60_000)


def test_the_first_map_says_what_it_waits_for(page: Page, service: Service) -> None:
    held: list[Route] = []
    is_held = True

    def hold(route: Route) -> None:
        if is_held:
            held.append(route)
        else:
            route.continue_()

    page.route("**/incident?*", hold)
    page.goto(f"{service.url}/#/learn/cornell-box?x=120&y=430")
    main = page.get_by_role("main", name="Learn")
    expect(main.get_by_role("progressbar", name="Of this lesson")).to_be_visible()
    expect(main.get_by_role("status").first).to_contain_text(re.compile(r"Rendering what the surface sees… \d+ s"))
    is_held = False
    for route in held:
        route.continue_()
    expect(main.locator("dd").filter(has_text="scene units")).to_contain_text(re.compile(r"^1\d\d\d "))


@pytest.fixture(scope="module")
def crowded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """A service that runs one job at a time."""
    limits = {"FREDHOLM_MAX_RUNNING_JOBS": "1", "FREDHOLM_MAX_WAITING_JOBS": "300", "FREDHOLM_WARM_UP": "0"}
    with serve(tmp_path_factory.mktemp("crowded"), **limits) as running:
        yield running


def test_places_in_the_rail_never_contradict_each_other_and_all_jobs_are_reached(page: Page, crowded: Service) -> None:
    first = crowded.submit({"seconds": 600}, width=16, height=16)
    queued = [crowded.submit({"spp": 4}, width=8, height=8, seed=seed) for seed in range(209)]
    page.goto(f"{crowded.url}/#/jobs/{queued[1]}")
    rail = page.get_by_role("navigation", name="Jobs")
    rows = rail.locator("li")
    older = rail.get_by_role("button", name="Older jobs")
    expect(rail).to_contain_text("of 210 jobs")
    older.click()
    expect(rows).to_have_count(210)
    expect(older).to_have_count(0)

    def places() -> list[int]:
        return [int(place) for place in re.findall(r"(\d+)(?:st|nd|rd|th) in the queue", rail.inner_text())]

    def are_places(most: int) -> bool:
        """Whether each place up to `most` is told once: soon, and never two in contradiction for long."""
        for _ in range(60):
            if sorted(places()) == list(range(1, most + 1)):
                return True
            page.wait_for_timeout(500)
        return False

    assert are_places(209)
    crowded.delete(queued[0])
    expect(page.get_by_role("main")).to_contain_text("1st in the queue")
    assert are_places(208)
    expect(rows).to_have_count(209)
    # A search is over all jobs, also those that were not read yet.
    page.reload()
    expect(older).to_be_visible()
    rail.get_by_role("searchbox").fill(first)
    expect(rows).to_have_count(1)
    crowded.cancel(first)
