"""Every place and state of the page, in one list: axe is asked about each, and `walk` takes each one's picture."""

from __future__ import annotations

import json
import re
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import httpx
from exr_files import values, write
from playwright.sync_api import Page, Route, expect
from running import Service

DRAWN = "Number(document.querySelector('#viewer')?.dataset.frame) > 0"
OWN_SCENE = """<scene version="3.0.0">
  <sensor type="perspective">
    <transform name="to_world"><lookat origin="0, 0, 4" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="48"/><integer name="height" value="32"/></film>
  </sensor>
  <shape type="sphere"><bsdf type="diffuse"/></shape>
  <shape type="rectangle">
    <transform name="to_world"><scale value="2"/><lookat origin="0, 4, 2" target="0, 0, 0" up="0, 0, 1"/></transform>
    <emitter type="area"><rgb name="radiance" value="5"/></emitter>
  </shape>
</scene>"""
EVIL_SCENE = "<scene version='3.0.0'>\n  <shape type='nonsense'/>\n</scene>"


def own_zip(folder: Path, scene: str = OWN_SCENE) -> Path:
    """A person's own scene as people send them: a folder in a .zip, a space in its name."""
    path = folder / "my room.zip"
    with zipfile.ZipFile(path, "w") as bundle:
        bundle.writestr("room/scene.xml", scene)
    return path


@dataclass(frozen=True)
class Stage:
    """A service that runs one job at a time, with a job in every state that waits for a picture to be taken."""

    service: Service
    folder: Path
    done: str
    against: str

    def address(self, hash_: str) -> str:
        return f"{self.service.url}/{hash_}"

    def again(self, **changes: Any) -> dict[str, Any]:
        """The ended job's own words with some changed."""
        return self.service.job(self.done) | changes


def set_up(service: Service, folder: Path, size: tuple[int, int] = (96, 96), spp: int = 256) -> Stage:
    """Renders the two jobs that most places show."""
    width, height = size
    done, against = (
        service.submit({"spp": spp, "error": 0.02}, width=width, height=height, technique=technique)
        for technique in ("mis", "bsdf")
    )
    for job_id in (done, against):
        assert service.wait_ended(job_id, 300)["state"] == "succeeded"
    return Stage(service, folder, done, against)


def remember_theme(page: Page, theme: str) -> None:
    """As if it had been chosen on an earlier visit."""
    page.add_init_script(f"localStorage.setItem('fredholm.theme', '{theme}')")


def show(page: Page, stage: Stage, hash_: str) -> None:
    """Opens an address anew, as a link does, and waits for the picture where there is one."""
    page.goto(stage.address(hash_))
    if hash_.startswith("#/jobs"):
        page.wait_for_function(DRAWN)
        page.wait_for_timeout(250)


def pretend(page: Page, stage: Stage, **changes: Any) -> None:
    """Opens the ended job as if the service told it otherwise: states that last too short to be looked at."""
    told = stage.again(**changes)
    if told["frame_seq"] == 0:
        told["curve"] = []
    listed = [told if job["id"] == told["id"] else job for job in stage.service.jobs()]

    def answer(route: Route) -> None:
        is_one = f"api/jobs/{told['id']}" in route.request.url
        route.fulfill(json=told if is_one else {"jobs": listed, "total": len(listed)})

    page.route(re.compile(rf"api/jobs(/{told['id']}$|\?)"), answer)
    page.goto(stage.address(f"#/jobs/{told['id']}"))
    expect(page.locator("aside h2").first).to_be_visible()


# Places in the queue come from the event stream alone.
TELLS_QUEUE = """
  const Real = window.EventSource;
  window.EventSource = class extends Real {
    addEventListener(type, listener) {
      super.addEventListener(type, type === 'queue' ? () => listener({ data: QUEUE }) : listener);
    }
  };
"""
NO_PICTURE = {"frame_seq": 0, "error": None, "error_upper": None, "samples": 0, "spp": 0, "seconds": 0.0}
NO_PICTURE |= {"share_within": None, "share_trusted": None, "health": None, "finished_at": None, "stopped_by": None}
CAUSE = {
    "title": "The render process died",
    "detail": "Rendering was tried 3 times; the last attempt ended with signal 9 after 4 s.",
    "hint": "It was probably out of memory. Try fewer pixels.",
}


def empty(page: Page, stage: Stage) -> None:
    page.route(re.compile(r"api/jobs\?"), lambda route: route.fulfill(json={"jobs": [], "total": 0}))
    show(page, stage, "")
    expect(page.get_by_role("heading", name="Nothing rendered yet.")).to_be_visible()
    expect(page.get_by_role("button", name="Cornell box")).to_be_visible()


def start(page: Page, stage: Stage) -> None:
    show(page, stage, "#/")
    expect(page.get_by_role("button", name="Cornell box")).to_be_visible()


def queued(page: Page, stage: Stage) -> None:
    soon = (datetime.now(UTC) + timedelta(seconds=90)).isoformat()
    told = json.dumps({"places": [{"id": stage.done, "position": 2, "expected_start": soon}]})
    page.add_init_script(TELLS_QUEUE.replace("QUEUE", json.dumps(told)))
    pretend(page, stage, **NO_PICTURE, state="queued", queue_position=2, started_at=None, expected_start=soon)
    expect(page.get_by_role("main")).to_contain_text("2nd in the queue")
    expect(page.get_by_role("main")).to_contain_text("starts in about")


def no_frame_yet(page: Page, stage: Stage) -> None:
    pretend(page, stage, **NO_PICTURE, state="running")
    expect(page.get_by_role("main")).to_contain_text("Waiting for the first samples")


def running(page: Page, stage: Stage) -> None:
    forecast = {"seconds_left": 40.0, "low": 31.0, "high": 55.0}
    pretend(page, stage, state="running", stopped_by=None, finished_at=None, forecast=forecast)
    page.wait_for_function(DRAWN)
    expect(page.locator("aside")).to_contain_text("of rendering left")


def paused(page: Page, stage: Stage) -> None:
    pretend(page, stage, state="paused", stopped_by=None, finished_at=None)
    page.wait_for_function(DRAWN)


def cancelled(page: Page, stage: Stage) -> None:
    pretend(page, stage, state="cancelled", stopped_by="cancelled")
    page.wait_for_function(DRAWN)
    expect(page.locator("aside")).to_contain_text("Cancelled")


def failed(page: Page, stage: Stage) -> None:
    pretend(page, stage, **NO_PICTURE, state="failed", cause=CAUSE)
    expect(page.get_by_role("alert")).to_contain_text("What to try")


def failed_with_picture(page: Page, stage: Stage) -> None:
    pretend(page, stage, state="failed", stopped_by=None, cause=CAUSE)
    page.wait_for_function(DRAWN)
    expect(page.get_by_role("alert")).to_contain_text("What to try")


def doubtful(page: Page, stage: Stage) -> None:
    health = {"status": "degraded", "invalid": 12, "invalid_pixels": 3, "empty_pixels": 0, "untrusted": 0.4}
    health |= {"cannot_see": ["point light 'lamp'"], "warnings": []}
    warnings = ["emission-without-area: an emitter of no area is only met by emitter sampling"]
    pretend(page, stage, invalid=12, health=health, warnings=warnings)
    page.wait_for_function(DRAWN)
    expect(page.locator("aside")).to_contain_text("cannot see")


def reconnecting(page: Page, stage: Stage) -> None:
    page.route("**/api/events", lambda route: route.fulfill(status=503, body="busy"))
    show(page, stage, f"#/jobs/{stage.done}")
    expect(page.get_by_role("banner")).to_contain_text("Connection lost")


def unknown(page: Page, stage: Stage) -> None:
    page.goto(stage.address("#/jobs/nothing-here"))
    expect(page.get_by_text("No job with this address.")).to_be_visible()


def without_webgl(page: Page, stage: Stage) -> None:
    page.add_init_script("delete HTMLCanvasElement.prototype.transferControlToOffscreen")
    page.goto(stage.address(f"#/jobs/{stage.done}"))
    expect(page.get_by_text("This browser cannot draw beside the page")).to_be_visible()


def done(page: Page, stage: Stage) -> None:
    show(page, stage, f"#/jobs/{stage.done}")


def view(name: str) -> Callable[[Page, Stage], None]:
    def go(page: Page, stage: Stage) -> None:
        show(page, stage, f"#/jobs/{stage.done}?view={name}")
        expect(page.get_by_role("group", name="Legend")).to_be_visible()

    return go


def compare(layout: str) -> Callable[[Page, Stage], None]:
    def go(page: Page, stage: Stage) -> None:
        show(page, stage, f"#/jobs/{stage.done}?with={stage.against}&layout={layout}")
        expect(page.get_by_role("group", name="Comparison", exact=True)).to_contain_text("bsdf")

    return go


def difference(page: Page, stage: Stage) -> None:
    show(page, stage, f"#/jobs/{stage.done}?view=difference&with={stage.against}")
    expect(page.get_by_role("group", name="Legend")).to_contain_text("standard errors")


def zoomed(page: Page, stage: Stage) -> None:
    done(page, stage)
    page.locator("#viewer").focus()
    page.keyboard.press("Enter")
    for _ in range(14):
        page.keyboard.press("+")
    expect(page.locator("[data-part=pixel]")).to_contain_text("replicate")
    page.wait_for_timeout(250)


def region(page: Page, stage: Stage) -> None:
    done(page, stage)
    box = page.locator("#viewer").bounding_box()
    assert box is not None
    page.keyboard.press("o")
    middle = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.move(middle[0] - 60, middle[1] - 40)
    page.mouse.down()
    page.mouse.move(middle[0] + 60, middle[1] + 40, steps=4)
    page.mouse.up()
    expect(page.get_by_role("region", name="Region of interest")).to_be_visible()


def an_exr(stage: Stage, gain: float) -> Path:
    """The ended job's picture, brighter, as another renderer's file."""
    path = stage.folder / "reference.exr"
    path.write_bytes(httpx.get(f"{stage.service.url}/api/jobs/{stage.done}/image.exr", timeout=60).content)
    return write(path, values(path)[..., :3] * gain)


def reference(page: Page, stage: Stage) -> None:
    done(page, stage)
    page.get_by_label("Reference file").set_input_files(an_exr(stage, 1.03))
    expect(page.get_by_role("region", name="Against the reference")).to_contain_text("SSIM", timeout=60_000)
    page.wait_for_timeout(300)


def opened(page: Page, stage: Stage) -> None:
    show(page, stage, "#/")
    page.get_by_label("Picture file").set_input_files(an_exr(stage, 1.0))
    expect(page.get_by_role("region", name="File")).to_contain_text("reference.exr")
    page.wait_for_function(DRAWN)
    page.wait_for_timeout(300)


def colours(page: Page, stage: Stage) -> None:
    done(page, stage)
    page.get_by_role("combobox", name="Tone map or false colours").select_option("viridis")
    expect(page.get_by_role("textbox", name="Left end of the range")).to_be_visible()
    page.wait_for_timeout(300)


def layers(page: Page, stage: Stage) -> None:
    job = stage.service.submit({"spp": 32}, width=96, height=96, channels=["albedo", "normal", "depth"])
    stage.service.wait_ended(job)
    show(page, stage, f"#/jobs/{job}?layer=normal&px=40,40&region=20,20,30,30")
    expect(page.get_by_role("region", name="Layers at the pixel")).to_contain_text("normal")
    expect(page.get_by_role("region", name="Region of interest")).to_contain_text("mean")
    page.wait_for_timeout(300)


def table(page: Page, stage: Stage) -> None:
    done(page, stage)
    page.get_by_role("button", name="Table").click()


def menu(page: Page, stage: Stage) -> None:
    done(page, stage)
    if (button := page.get_by_role("button", name="Jobs")).is_visible():
        button.click()
        expect(page.get_by_role("navigation", name="Jobs")).to_be_visible()


def key_help(page: Page, stage: Stage) -> None:
    done(page, stage)
    page.keyboard.press("?")
    expect(page.get_by_role("dialog")).to_be_visible()


def go_on(page: Page, stage: Stage) -> None:
    done(page, stage)
    page.get_by_role("button", name="Continue…").click()
    expect(page.get_by_role("dialog")).to_be_visible()


def delete(page: Page, stage: Stage) -> None:
    # Other places show this job, too: it stays when this page is left.
    page.add_init_script(
        "const asked = window.fetch;"
        "window.fetch = (url, how) => (how?.method === 'DELETE' ? new Promise(() => {}) : asked(url, how))"
    )
    done(page, stage)
    page.locator("aside").get_by_role("button", name="Delete", exact=True).click()
    undo = page.get_by_role("button", name="Undo")
    expect(undo).to_be_visible()
    undo.hover()  # no time passes


def new_render(page: Page, stage: Stage) -> None:
    start(page, stage)
    page.get_by_role("button", name="New render").click()
    expect(page.get_by_role("dialog")).to_be_visible()


def new_chosen(page: Page, stage: Stage) -> None:
    new_render(page, stage)
    dialog = page.get_by_role("dialog")
    dialog.get_by_text("Cornell box").click()
    dialog.get_by_text("What this scene requires").click()
    expect(dialog).to_contain_text("rectangle")


def new_wrong(page: Page, stage: Stage) -> None:
    new_render(page, stage)
    dialog = page.get_by_role("dialog")
    dialog.get_by_role("textbox", name="Relative error").fill("much")
    dialog.get_by_role("textbox", name="Width").fill("99999")
    dialog.get_by_role("button", name="Start render").click()
    expect(dialog).to_contain_text("Pick a scene or drop a file.")


def uploading(page: Page, stage: Stage) -> None:
    """On a link so slow that it stays."""
    new_render(page, stage)
    slow = {"offline": False, "latency": 30_000, "downloadThroughput": -1, "uploadThroughput": 100}
    session = page.context.new_cdp_session(page)
    session.send("Network.enable")
    session.send("Network.emulateNetworkConditions", slow)
    page.locator("input[type=file]").last.set_input_files(own_zip(stage.folder))
    expect(page.get_by_role("dialog")).to_contain_text("my room.zip")
    expect(page.get_by_role("button", name="Cancel upload")).to_be_visible()


def refused(page: Page, stage: Stage) -> None:
    new_render(page, stage)
    page.locator("input[type=file]").last.set_input_files(own_zip(stage.folder, EVIL_SCENE))
    expect(page.get_by_role("dialog").get_by_role("alert")).to_contain_text("was refused")


def uploaded(page: Page, stage: Stage) -> None:
    new_render(page, stage)
    page.locator("input[type=file]").last.set_input_files(own_zip(stage.folder))
    expect(page.get_by_role("dialog").get_by_role("radio", name="my room")).to_be_checked()


def lesson(page: Page, stage: Stage) -> None:
    show(page, stage, "#/learn/cornell-box?x=174&y=445")
    expect(page.get_by_text(re.compile("4096 samples each"))).to_be_visible(timeout=60_000)
    page.wait_for_timeout(500)


def chapter_equation(page: Page, stage: Stage) -> None:
    show(page, stage, "#/learn/cornell-box?chapter=equation&x=174&y=445")
    expect(page.get_by_text("The intervals meet")).to_be_visible(timeout=60_000)
    page.wait_for_timeout(500)


def chapter_rays(page: Page, stage: Stage) -> None:
    show(page, stage, "#/learn/cornell-box?chapter=rays&x=174&y=500&path=13&vertex=4")
    expect(page.locator("[data-path-sum]")).to_be_visible(timeout=60_000)
    page.wait_for_timeout(500)


def chapter_forms(page: Page, stage: Stage) -> None:
    show(page, stage, "#/learn/cornell-box?chapter=forms&x=256&y=500")
    expect(page.locator("[data-form]")).to_have_count(3, timeout=60_000)
    page.wait_for_timeout(500)


def chapter_monte_carlo(page: Page, stage: Stage) -> None:
    show(page, stage, "#/learn/cornell-box?chapter=monte-carlo&x=174&y=445")
    expect(page.locator("[data-runs='200']")).to_have_count(2, timeout=60_000)
    page.wait_for_timeout(500)


def chapter_trade(page: Page, stage: Stage) -> None:
    show(page, stage, "#/learn/cornell-box?chapter=trade")
    expect(page.locator("[data-seconds]")).to_be_visible(timeout=180_000)
    page.wait_for_timeout(500)


def chapter_extremes(page: Page, stage: Stage) -> None:
    show(page, stage, "#/learn?chapter=extremes&extreme=many-samples")
    expect(page.locator("[data-at]")).to_have_count(7, timeout=120_000)
    page.wait_for_timeout(500)


PLACES: dict[str, Callable[[Page, Stage], None]] = {
    "empty": empty,
    "start": start,
    "new": new_render,
    "new-chosen": new_chosen,
    "new-wrong": new_wrong,
    "uploading": uploading,
    "refused": refused,
    "uploaded": uploaded,
    "queued": queued,
    "no-frame-yet": no_frame_yet,
    "running": running,
    "paused": paused,
    "cancelled": cancelled,
    "failed": failed,
    "failed-with-picture": failed_with_picture,
    "doubtful": doubtful,
    "reconnecting": reconnecting,
    "unknown": unknown,
    "without-webgl": without_webgl,
    "done": done,
    "error": view("error"),
    "samples": view("samples"),
    "trust": view("trust"),
    "wipe": compare("wipe"),
    "side": compare("side"),
    "flip": compare("flip"),
    "difference": difference,
    "zoomed": zoomed,
    "region": region,
    "reference": reference,
    "opened": opened,
    "colours": colours,
    "layers": layers,
    "table": table,
    "menu": menu,
    "help": key_help,
    "continue": go_on,
    "delete": delete,
    "lesson": lesson,
    "equation": chapter_equation,
    "rays": chapter_rays,
    "forms": chapter_forms,
    "monte-carlo": chapter_monte_carlo,
    "trade": chapter_trade,
    "extremes": chapter_extremes,
}
