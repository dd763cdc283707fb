"""The chapters of the Learn view: each is whole, and its numbers are the renderer's."""

from __future__ import annotations

import re

import httpx
import pytest
from places import OWN_SCENE
from playwright.sync_api import Locator, Page, expect
from running import Service
from test_axe import AXE, axe_findings

AT = "#/learn/cornell-box?chapter={}&x=174&y=445"
ON_THE_FLOOR = AT.replace("445", "500")


def open_chapter(page: Page, service: Service, chapter: str, width: int = 1440, at: str = AT) -> Locator:
    page.set_viewport_size({"width": width, "height": 900})
    page.goto(f"{service.url}/{at.format(chapter)}")
    return page.get_by_role("main", name="Learn")


def fits(page: Page, width: int) -> None:
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    if AXE.is_file():
        assert axe_findings(page, AXE) == []


def test_the_bounces_add_up_to_the_pixel(page: Page, service: Service) -> None:
    main = open_chapter(page, service, "equation")
    expect(main).to_contain_text("4096 samples", timeout=60_000)
    bars = [float(bar.get_attribute("data-mean") or "nan") for bar in main.locator("[data-bounce]").all()]
    total = float(main.locator("[data-sum]").get_attribute("data-sum") or "nan")
    assert sum(bars) == pytest.approx(total, rel=1e-6)
    assert len(bars) > 4
    expect(main).to_contain_text("The intervals meet: the series is the pixel.")
    expect(main.get_by_role("button", name="Four times the samples")).to_be_enabled(timeout=60_000)
    main.get_by_role("button", name="Four times the samples").click()
    expect(main).to_contain_text("16.4 k samples".replace(" k", "\u202fk"), timeout=60_000)


@pytest.mark.parametrize("width", [1440, 420])
def test_a_term_lights_up_in_formula_list_and_map(page: Page, service: Service, width: int) -> None:
    main = open_chapter(page, service, "equation", width)
    expect(main).to_contain_text("4096 samples", timeout=60_000)
    expect(main.locator("math").first).to_be_visible()
    fits(page, width)
    before = main.locator(".map canvas").evaluate("(canvas) => canvas.toDataURL()")
    main.locator("[data-row=f]").focus()
    expect(main.locator("[data-term=f].lit")).to_have_count(1)
    expect(main.locator(".map")).to_have_attribute("aria-label", re.compile("kernel"))
    assert main.locator(".map canvas").evaluate("(canvas) => canvas.toDataURL()") != before
    box = main.locator("[data-term=p]").first.bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    expect(main.locator(".cross.lit")).to_be_visible()


def test_a_chosen_direction_survives_a_reload_and_is_moved_by_keys(page: Page, service: Service) -> None:
    main = open_chapter(page, service, "equation")
    chooser = main.get_by_role("button", name=re.compile("Arrows choose a direction"))
    expect(chooser).to_be_visible(timeout=60_000)
    chooser.click(position={"x": 200, "y": 60})
    told = main.locator("[data-row=wi]")
    expect(told).to_contain_text("θ")
    said = told.inner_text()
    page.reload()
    expect(chooser).to_be_visible(timeout=60_000)
    assert told.inner_text() == said
    chooser.focus()
    page.keyboard.press("ArrowDown")
    expect(told).not_to_have_text(said)


def test_the_lecture_is_told_in_italian_where_the_browser_is_and_one_may_choose(page: Page, service: Service) -> None:
    page.add_init_script("Object.defineProperty(navigator, 'languages', { get: () => ['it-IT', 'en'] })")
    main = open_chapter(page, service, "equation")
    expect(main.get_by_role("heading", name="Dall’equazione all’immagine")).to_be_visible()
    main.get_by_label("Lingua").select_option("en")
    expect(main.get_by_role("heading", name="From the equation to the picture")).to_be_visible()
    page.reload()
    expect(main.get_by_role("heading", name="From the equation to the picture")).to_be_visible()


def number_of(locator: Locator, name: str) -> float:
    return float(locator.get_attribute(name) or "nan")


@pytest.mark.parametrize("width", [1440, 420])
def test_a_path_grows_ray_by_ray_over_the_picture(page: Page, service: Service, width: int) -> None:
    main = open_chapter(page, service, "rays", width, ON_THE_FLOOR)
    vertices = main.locator("[data-vertex]")
    expect(vertices.nth(2)).to_be_visible(timeout=60_000)
    expect(main.get_by_role("status")).to_contain_text("The camera’s ray meets the scene at")
    marks = main.locator(".framed svg circle")
    expect(marks).to_have_count(1)
    main.get_by_role("button", name="Cast the ray").click()
    expect(vertices.nth(1)).to_have_class(re.compile("now"))
    expect(marks).to_have_count(2)
    expect(main.get_by_role("status")).to_contain_text("scene units away")
    fits(page, width)

    main.get_by_role("button", name="To the end").click()
    expect(vertices.last).to_have_class(re.compile("now"))
    added = [number_of(cell, "data-added") for cell in main.locator("[data-added]").all()]
    assert sum(added) == pytest.approx(number_of(main.locator("[data-path-sum]"), "data-path-sum"), abs=1e-9)
    said = main.get_by_role("status").inner_text()
    page.reload()
    expect(main.get_by_role("status")).to_have_text(said, timeout=60_000)
    main.get_by_role("button", name="Another path").click()
    expect(main).to_contain_text("path 1")
    expect(vertices.first).to_have_class(re.compile("now"))


def test_a_path_beyond_those_told_together_is_asked_for(page: Page, service: Service) -> None:
    page.goto(f"{service.url}/{AT.format('rays')}&path=15")
    main = page.get_by_role("main", name="Learn")
    expect(main.locator("[data-path-sum]")).to_be_visible(timeout=60_000)
    main.get_by_role("button", name="Another path").click()
    expect(main).to_contain_text("path 16")
    expect(main.locator("[data-path-sum]")).to_be_visible(timeout=60_000)


@pytest.mark.parametrize("width", [1440, 420])
def test_both_forms_are_one_integral_and_a_point_has_its_factors(page: Page, service: Service, width: int) -> None:
    main = open_chapter(page, service, "forms", width, ON_THE_FLOOR)
    forms = main.locator("[data-form]")
    expect(forms).to_have_count(3, timeout=60_000)
    fits(page, width)
    # Of the two with the least spread, by the spread that the table tells.
    told = {}
    for form in forms.all():
        spread = float(form.locator("td").nth(1).inner_text().split("%")[0].strip()) / 100
        told[form.get_attribute("data-form")] = (number_of(form, "data-mean"), spread / 64)
    (cosine, by_cosine), (area, by_area) = told["cosine"], told["emitter"]
    assert by_area < by_cosine
    assert abs(cosine - area) < 5 * (cosine * by_cosine + area * by_area)

    points = main.get_by_role("region", name="Points on the lights")
    expect(points).to_contain_text(re.compile(r"point \d+ of 64"))
    expect(points.locator("[data-row=V]")).to_contain_text("1")
    points.locator("[data-row=G]").focus()
    expect(main.locator("[data-term=G].lit").first).to_be_visible()
    geometry = points.locator("[data-row=G] .value")
    before = geometry.inner_text()
    points.get_by_role("button", name="Next").click()
    expect(geometry).not_to_have_text(before)
    said = geometry.inner_text()
    page.reload()
    expect(geometry).to_have_text(said, timeout=60_000)


def test_points_that_are_hidden_are_counted_and_crossed_out(page: Page, service: Service) -> None:
    """In the soft edge of the small box's shadow on the floor."""
    main = open_chapter(page, service, "forms", at="#/learn/cornell-box?chapter={}&x=256&y=500")
    told = main.locator("[data-hidden]")
    expect(told).to_be_visible(timeout=60_000)
    hidden = int(number_of(told, "data-hidden"))
    assert 0 < hidden < 64
    expect(main.locator(".framed svg path[stroke='#ff8278']")).to_have_count(hidden)
    expect(main.locator(".framed svg circle")).to_have_count(64 - hidden)


def test_four_times_the_points_halve_the_error_in_a_table_that_grows(page: Page, service: Service) -> None:
    main = open_chapter(page, service, "monte-carlo")
    table = main.get_by_role("region", name="Four times the points halve the error")
    for n in (16, 64, 256, 1024):
        expect(table.locator(f"[data-n='{n}']")).to_be_visible(timeout=60_000)
        table.get_by_role("button", name="Four times the points").click()
    ratio = float(table.locator("[data-n='1024'] td").last.inner_text())
    assert 1.7 < ratio < 2.3
    fits(page, 1440)
    page.reload()
    expect(main.locator("[data-row=n]")).to_contain_text("4096", timeout=60_000)


def test_a_density_like_the_function_leaves_no_variance_and_a_blind_one_is_told(page: Page, service: Service) -> None:
    main = open_chapter(page, service, "monte-carlo", 420)
    main.get_by_label("Density p").select_option("best")
    expect(main).to_contain_text("V = 0: every point gives I by itself.", timeout=60_000)
    expect(main.locator("[data-met=true]")).to_have_count(3)
    expect(main.locator("[data-runs='200']")).to_have_count(2, timeout=60_000)
    fits(page, 420)
    main.get_by_role("textbox", name="f(x) =").fill("x^2")
    main.get_by_role("textbox", name="f(x) =").press("Enter")
    main.get_by_label("Density p").select_option("typed")
    main.get_by_role("textbox", name="p(x) =").fill("step(1 - x)")
    main.get_by_role("textbox", name="p(x) =").press("Enter")
    expect(main.locator("[data-met=false]").last).to_contain_text("no interval tells", timeout=60_000)
    main.get_by_role("textbox", name="f(x) =").fill("import os")
    main.get_by_role("textbox", name="f(x) =").press("Enter")
    expect(main.get_by_role("alert").first).to_contain_text("no expression of x", timeout=60_000)


MEASURED = 180_000  # ms, on a machine with other work to do


@pytest.mark.parametrize("width", [1440, 420])
def test_what_certainty_costs_is_measured_in_the_page(page: Page, service: Service, width: int) -> None:
    main = open_chapter(page, service, "trade", width, "#/learn/cornell-box?chapter={}")
    expect(main.locator("[data-setting]")).to_have_count(5, timeout=60_000)
    expect(main.locator("[data-seconds='2']")).to_be_visible(timeout=MEASURED)
    expect(main.locator(".costs")).to_contain_text(re.compile("2 % costs you .+, 1 % .+"))
    told = page.request.get(f"{service.url}/api/learn/cornell-box/trade?seconds=2&step=0").json()
    shown = [float(row.get_attribute("data-times") or "nan") for row in main.locator("[data-times]").all()]
    assert shown[0] == 1
    assert {setting["technique"] for setting in told["settings"]} == {"mis", "bsdf", "emitter", "cosine", "uniform"}
    expect(main.locator("[data-without]")).to_have_count(2)
    assert number_of(main.locator(".plot"), "data-points") > 0
    fits(page, width)


def test_leaving_the_trade_ends_its_questions(page: Page, service: Service) -> None:
    main = open_chapter(page, service, "trade", at="#/learn/cornell-box?chapter={}&group=sampling")
    expect(main.get_by_role("status")).to_be_visible()
    main.get_by_role("link", name=re.compile("^4 ")).click()
    expect(main.get_by_role("heading", name="An integral from random points")).to_be_visible()
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.wait_for_timeout(2500)
    assert not [url for url in asked if "/trade" in url]


@pytest.mark.parametrize("width", [1440, 420])
def test_a_naive_formula_fails_beside_ours(page: Page, service: Service, width: int) -> None:
    main = open_chapter(page, service, "extremes", width, "#/learn?chapter={}&extreme=many-samples")
    rows = main.locator("[data-at]")
    expect(rows).to_have_count(7, timeout=120_000)
    last = rows.last
    exact, naive, ours = (number_of(last, f"data-{name}") for name in ("exact", "naive", "ours"))
    assert number_of(last, "data-at") == 1e8
    assert abs(naive / exact - 1) > 0.5
    assert abs(ours / exact - 1) < 1e-6
    fits(page, width)
    main.get_by_role("button", name="A small variance").click()
    expect(main.locator("[data-at='1000000']")).to_be_visible(timeout=60_000)
    assert "extreme=small-variance" in page.url


def test_an_uploaded_scene_has_its_lesson_too(page: Page, service: Service) -> None:
    answer = httpx.post(f"{service.url}/api/scenes", files={"file": ("mine.xml", OWN_SCENE.encode())}, timeout=120)
    scene = answer.json()["id"]
    main = open_chapter(page, service, "pixel", at=f"#/learn/{scene}?x=16&y=12&chapter={{}}")
    expect(main.get_by_role("combobox", name="Scene")).to_have_value(scene, timeout=60_000)
    expect(main).to_contain_text("diffuse reflection", timeout=60_000)
    expect(main).to_contain_text("Of your uploads")
    page.wait_for_function("document.querySelector('.picture img').naturalWidth > 0", timeout=60_000)
