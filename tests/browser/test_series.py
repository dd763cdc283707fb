"""Several pictures at once, from the form: values for parameters, all sensors, and the archive of what came of them."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path

from places import Stage, show
from playwright.sync_api import Page, expect

SENSOR = """<sensor type="perspective" id="{}"><transform name="to_world"><lookat origin="{}" target="0, 0, 0"
  up="0, 0, 1"/></transform><film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="8"/>
  </film></sensor>"""
SCENE = f"""<scene version="3.0.0"><default name="grey" value="0.5"/>{SENSOR.format("front", "0, 5, 0")}
  {SENSOR.format("side", "5, 0, 0")}<shape type="sphere"><bsdf type="diffuse">
  <rgb name="reflectance" value="$grey"/></bsdf></shape><emitter type="constant"/></scene>"""


def test_values_and_all_sensors_make_a_series_with_one_archive(page: Page, stage: Stage, tmp_path: Path) -> None:
    (tmp_path / "turn.xml").write_text(SCENE)
    show(page, stage, "#/")
    page.get_by_role("button", name="New render").click()
    dialog = page.get_by_role("dialog", name="New render")
    dialog.locator("input[type=file]").set_input_files(tmp_path / "turn.xml")
    dialog.get_by_role("textbox", name="grey").fill("0.2; 0.4")
    dialog.get_by_role("combobox", name="Camera").select_option("all")
    expect(dialog).to_contain_text("4 pictures")
    dialog.get_by_text("Move the camera").click()
    dialog.get_by_role("textbox", name="Field of view").fill("180")
    dialog.get_by_role("button", name="Start render").click()
    expect(dialog).to_contain_text("Above 0 and below 180 degrees.")
    dialog.get_by_role("textbox", name="Field of view").fill("35")
    dialog.get_by_role("button", name="Start render").click()
    expect(dialog).to_be_hidden()
    expect(page.get_by_role("region", name="Progress")).to_contain_text("One of 4 pictures, 4 of them done.")
    with page.expect_download() as started:
        page.get_by_role("link", name="All as ZIP").click()
    with zipfile.ZipFile(io.BytesIO(started.value.path().read_bytes())) as archive:
        told = json.loads(archive.read("series.json"))
    assert [(one["sensor"], one["parameters"]) for one in told] == [
        (sensor, {"grey": grey}) for grey in ("0.2", "0.4") for sensor in (0, 1)
    ]
    page.get_by_role("button", name="Again…").click()
    again = page.get_by_role("dialog", name="New render")
    expect(again.get_by_role("textbox", name="grey")).to_have_value("0.2")
    expect(again.get_by_role("textbox", name="Field of view")).to_have_value("35")
