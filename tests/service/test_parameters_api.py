"""Values for a scene's parameters, and cameras that are set from outside, over real HTTP."""

from __future__ import annotations

import io
import zipfile
from typing import Any

import httpx
import numpy as np
import pytest
from service_process import Server

from service.pixels import png_bytes

SCENE = """<scene version="3.0.0">
  <default name="grey" value="0.5"/><default name="side" value="8"/><default name="skin" value="skin.png"/>
  <default name="model" value="diffuse"/>
  <sensor type="perspective"><transform name="to_world"><lookat origin="0, 0, 5" target="0, 0, 0" up="0, 1, 0"/>
  </transform><film type="hdrfilm"><integer name="width" value="$side"/><integer name="height" value="6"/></film>
  </sensor>
  <sensor type="orthographic" id="flat"><film type="hdrfilm"><integer name="width" value="4"/>
  <integer name="height" value="4"/></film></sensor>
  <shape type="sphere"><bsdf type="$model"><rgb name="reflectance" value="$grey"/></bsdf></shape>
  <emitter type="constant"/>
</scene>"""
FREE = {"width": None, "height": None}


@pytest.fixture
def scene(client: httpx.Client) -> dict[str, Any]:
    answer = client.post("/api/scenes", files={"file": ("ball.xml", SCENE)}, timeout=60)
    assert answer.status_code in (200, 201), answer.text
    return answer.json()


def middle(client: httpx.Client, job: dict[str, Any]) -> float:
    """Luminance of the pixel in the middle of the ball."""
    width, height = job["settings"]["width"], job["settings"]["height"]
    return client.get(f"/api/jobs/{job['id']}/pixel", params={"x": width // 2, "y": height // 2}).json()["luminance"]


def test_a_scene_says_its_parameters_and_a_job_gives_them_values(
    server: Server, client: httpx.Client, scene: dict[str, Any]
) -> None:
    own = {"grey": "0.5", "side": "8", "skin": "skin.png", "model": "diffuse"}
    assert scene["requirements"]["parameters"] == own
    seen = []
    for parameters in ({}, {"grey": 0.25}, {"grey": "0.25", "side": 10}):
        job = server.wait_ended(server.submit({"spp": 64}, {**FREE, "parameters": parameters}, id=scene["id"])["id"])
        assert job["state"] == "succeeded", job["cause"]
        assert job["settings"]["parameters"] == {name: str(value) for name, value in parameters.items()}
        assert job["settings"]["width"] == parameters.get("side", 8)
        seen.append(middle(client, job))
    assert seen[1] == pytest.approx(seen[0] / 2, rel=0.02)
    assert seen[2] == pytest.approx(seen[1], rel=0.1)


def test_a_continued_job_keeps_its_parameters_and_camera(server: Server, client: httpx.Client, scene: Any) -> None:
    asked = {**FREE, "parameters": {"grey": "0.25"}, "camera": {"fov": 20}}
    job = server.wait_ended(server.submit({"spp": 32}, asked, id=scene["id"])["id"])
    first = middle(client, job)
    more = client.post(f"/api/jobs/{job['id']}/continue", json={"target": {"spp": 64}})
    assert more.status_code == 200, more.text
    done = server.wait_ended(job["id"])
    assert (done["state"], done["spp"], done["settings"]) == ("succeeded", 64, job["settings"])
    assert middle(client, done) == pytest.approx(first, rel=0.02)


@pytest.mark.parametrize(
    ("settings", "field", "says"),
    [
        ({"parameters": {"gray": 1}}, "settings.parameters", "no parameter 'gray'; its parameters are grey, side"),
        ({"parameters": {"grey": "$side"}}, "settings.parameters", "names a parameter itself"),
        ({"parameters": {"grey": "bright"}}, "settings.parameters", "bright"),
        ({"parameters": {"model": "bitmap"}}, "settings.parameters", "bitmap"),
        ({"parameters": {"side": 100_000}}, "settings.parameters", "100000"),
        ({"parameters": {f"p{i}": 1 for i in range(101)}}, "settings.parameters", "100"),
        ({"camera": {"fov": 180}}, "settings.camera.fov", "less than 180"),
        ({"camera": {"up": [0, 0, 0]}}, "settings.camera", "camera up is 0, 0, 0"),
        ({"camera": {"origin": [1, 2]}}, "settings.camera.origin", "3"),
        (
            {"camera": {"origin": [0, 1, 2], "target": [0, 1, 2]}},
            "settings.camera",
            "origin and target are both 0, 1, 2",
        ),
        (
            {"camera": {"origin": [0, 5, 0], "target": [0, 1, 0], "up": [0, 2, 0]}},
            "settings.camera",
            "camera up is 0, 2, 0, which is along the direction of its view",
        ),
        ({"camera": {"fov": 30}, "sensor": "flat"}, "settings.camera", "'flat' is of the type orthographic"),
    ],
)
def test_what_cannot_be_is_refused_by_its_field(
    client: httpx.Client, scene: dict[str, Any], settings: dict[str, Any], field: str, says: str
) -> None:
    body = {"scene": {"id": scene["id"]}, "target": {"spp": 4}, "settings": settings}
    answer = client.post("/api/jobs", json=body, timeout=60)
    assert answer.status_code == 422, answer.text
    told = answer.json()["errors"][0]
    assert (told["field"], says in told["message"]) == (field, True), told
    assert "/tmp" not in answer.text
    assert ".upload-" not in answer.text


def test_a_built_in_scene_has_no_parameters_and_a_camera(server: Server, client: httpx.Client) -> None:
    body = {"scene": {"gallery": "furnace"}, "target": {"spp": 4}, "settings": {"parameters": {"x": 1}}}
    answer = client.post("/api/jobs", json=body)
    assert (answer.status_code, "furnace has no parameters, and 'x' is given" in answer.text) == (422, True)
    small = {"width": 8, "height": 8}
    job = server.wait_ended(server.submit({"spp": 4}, {**small, "camera": {"fov": 12.5}}, gallery="cornell-box")["id"])
    camera = {"origin": None, "target": None, "up": None, "fov": 12.5}
    assert (job["state"], job["settings"]["camera"]) == ("succeeded", camera)


def test_a_parameter_names_no_file_outside_the_scene(client: httpx.Client) -> None:
    """What a value leads to is checked as the upload was."""
    text = SCENE.replace('<rgb name="reflectance" value="$grey"/>', "").replace(
        '<emitter type="constant"/>',
        '<emitter type="envmap"><string name="filename" value="$skin"/></emitter>',
    )
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("scene.xml", text)
        archive.writestr("skin.png", png_bytes(np.ones((2, 2, 3), np.float32), 0.0, "srgb"))
    answer = client.post("/api/scenes", files={"file": ("sky.zip", file.getvalue())}, timeout=60)
    assert answer.status_code in (200, 201), answer.text
    for name in ("/etc/passwd", "../../../../etc/hostname", "other.png"):
        body = {"scene": {"id": answer.json()["id"]}, "target": {"spp": 4}, "settings": {"parameters": {"skin": name}}}
        refused = client.post("/api/jobs", json=body, timeout=60)
        assert (refused.status_code, refused.json()["errors"][0]["field"]) == (422, "settings.parameters")
