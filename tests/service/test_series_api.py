"""Series over real HTTP: all sensors and sets of values in one request, one progress, one archive."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path
from typing import Any

import httpx
import pytest
from service_process import Server, wait_for

import renderer

SENSOR = """<sensor type="perspective" id="{}"><transform name="to_world"><lookat origin="{}" target="0, 0, 0"
  up="0, 1, 0"/></transform><film type="hdrfilm"><integer name="width" value="{}"/><integer name="height" value="6"/>
  </film></sensor>"""
SCENE = f"""<scene version="3.0.0"><default name="grey" value="0.5"/>
  {SENSOR.format("left", "-3, 1, 3", 8)}{SENSOR.format("right", "3, 1, 3", 10)}
  <shape type="sphere"><bsdf type="diffuse"><rgb name="reflectance" value="$grey"/></bsdf></shape>
  <emitter type="constant"/></scene>"""


@pytest.fixture
def scene(client: httpx.Client) -> str:
    answer = client.post("/api/scenes", files={"file": ("turn.xml", SCENE)}, timeout=60)
    assert answer.status_code in (200, 201), answer.text
    return answer.json()["id"]


def ask(client: httpx.Client, scene: str, headers: dict[str, str] | None = None, **more: Any) -> httpx.Response:
    body = {"scene": {"id": scene}, "target": {"spp": 16}, **more}
    return client.post("/api/series", json=body, headers=headers, timeout=60)


def test_a_series_makes_a_job_of_each_sensor_and_set_of_values(
    server: Server, client: httpx.Client, scene: str, tmp_path: Path
) -> None:
    answer = ask(client, scene, sensors="all", sweep=[{"grey": 0.2}, {"grey": 0.8}])
    assert answer.status_code == 201, answer.text
    made = answer.json()
    address = f"/api/series/{made['id']}"
    assert answer.headers["Location"] == address
    wait_for(lambda: client.get(address).json()["ended"] == 4, 60, "the series")
    told = client.get(address).json()
    assert (told["done"], [job["id"] for job in told["jobs"]]) == (4, [job["id"] for job in made["jobs"]])
    assert [job["name"] for job in told["jobs"]] == [
        f"{name} · grey = {grey} · turn" for grey in ("0.2", "0.8") for name in ("left", "right")
    ]
    assert {client.get(f"/api/jobs/{job['id']}").json()["series"] for job in told["jobs"]} == {made["id"]}
    archive = client.get(f"{address}/images.zip", timeout=60)
    assert (archive.status_code, archive.headers["Content-Type"]) == (200, "application/zip")
    with zipfile.ZipFile(io.BytesIO(archive.content)) as files:
        lines = json.loads(files.read("series.json"))
        files.extractall(tmp_path)
    assert len(files.namelist()) == 5
    scene_file = tmp_path / "turn.xml"
    scene_file.write_text(SCENE)
    for line, job in zip(lines, told["jobs"], strict=True):
        assert (line["job"], line["error"]) == (job["id"], job["error"])
        assert len(line["readings"]) == job["settings"]["width"] * 6
        source = renderer.SceneFile(scene_file, line["parameters"])
        alone = renderer.render(source, renderer.Target(spp=16), renderer.Settings(sensor=line["sensor"]))
        assert line["readings"][20]["value"]["Y"] == pytest.approx(float(alone.moments.luminance()[20]), rel=1e-6)
        assert (tmp_path / line["file"]).stat().st_size > 100


def test_a_repeated_series_is_the_same_one(client: httpx.Client, scene: str) -> None:
    key = {"Idempotency-Key": f"series-{scene}"}
    first, again = (ask(client, scene, key, sensors=["right", 0]) for _ in range(2))
    assert (first.status_code, again.headers["Idempotency-Replayed"]) == (201, "true")
    assert first.json()["id"] == again.json()["id"]
    assert [job["settings"]["sensor"] for job in again.json()["jobs"]] == [1, 0]
    assert ask(client, scene, key, sensors="all").status_code in (409, 422)
    wait_for(lambda: client.get(f"/api/series/{first.json()['id']}").json()["ended"] == 2, 60, "the series")


def test_a_series_can_be_cancelled_as_one(client: httpx.Client, scene: str) -> None:
    made = ask(client, scene, sensors="all", target={"seconds": 1e6}).json()
    ended = client.post(f"/api/series/{made['id']}/cancel")
    assert (ended.status_code, ended.json()["ended"], ended.json()["done"]) == (200, 2, 0)


@pytest.mark.parametrize(
    ("more", "field", "says"),
    [
        ({"sensors": ["top"]}, "settings.sensor", "'left', 1 'right'"),
        ({"sensors": []}, "sensors", "the list is empty"),
        ({"sweep": [{"gray": 1}]}, "settings.parameters", "no parameter 'gray'"),
        ({"sweep": [{"grey": 1}] * 300}, "sweep", "300 sets of values are more jobs than may wait"),
        ({"sensors": [0] * 300}, "sensors", "more jobs than may wait"),
    ],
)
def test_series_that_cannot_be_are_refused_whole(
    client: httpx.Client, scene: str, more: dict[str, Any], field: str, says: str
) -> None:
    before = client.get("/api/jobs").json()["total"]
    answer = ask(client, scene, **more)
    assert answer.status_code == 422, answer.text
    told = answer.json()["errors"][0]
    assert (told["field"], says in told["message"]) == (field, True), told
    assert client.get("/api/jobs").json()["total"] == before


def test_a_series_that_is_not_there_is_not_found(client: httpx.Client) -> None:
    for way in ("", "/images.zip"):
        assert client.get(f"/api/series/0123456789ab{way}").status_code == 404
