"""Uploaded scenes over real HTTP."""

from __future__ import annotations

import io
import json
import os
import random
import signal
import time
import zipfile
from concurrent.futures import ThreadPoolExecutor

import httpx
import pytest
from service_process import PLAIN_SCENE, Server

OBJ = "v -1 -1 0\nv 1 -1 0\nv 0 1 0\nf 1 2 3\n"
WITH_MESH = PLAIN_SCENE.replace(
    '<shape type="sphere">', '<shape type="obj"><string name="filename" value="meshes/a.obj"/>'
)


def zipped(**files: str) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return packed.getvalue()


def upload(client: httpx.Client, name: str, content: str | bytes) -> httpx.Response:
    return client.post("/api/scenes", files={"file": (name, content)}, timeout=60)


def refusal(answer: httpx.Response) -> str:
    assert answer.status_code == 422, answer.text
    assert answer.headers["Content-Type"] == "application/problem+json"
    assert "/tmp" not in answer.text
    assert ".upload-" not in answer.text
    return answer.json()["detail"]


def test_an_xml_scene_is_taken_and_rendered(server: Server, client: httpx.Client) -> None:
    answer = upload(client, "ball <1>.xml", PLAIN_SCENE + "<!-- taken by no other test -->")
    assert answer.status_code == 201, answer.text
    scene = answer.json()
    assert (scene["name"], scene["width"], scene["height"]) == ("ball <1>", 32, 24)
    assert answer.headers["Location"] == f"/api/scenes/{scene['id']}"
    assert scene in client.get("/api/scenes").json()
    assert client.get(f"/api/scenes/{scene['id']}").json() == scene
    job = server.wait_ended(server.submit({"spp": 32}, {"seed": 3}, id=scene["id"])["id"])
    assert (job["state"], job["settings"]["width"], job["name"]) == ("succeeded", 32, "ball <1>")
    assert job["scene"] == {"gallery": None, "id": scene["id"], "name": "ball <1>"}


def test_polarised_light_is_rendered_with_its_stokes_vectors(server: Server, client: httpx.Client) -> None:
    asks = '<integrator type="stokes"><integrator type="path"/></integrator><sensor'
    scene = upload(client, "polarised.xml", PLAIN_SCENE.replace("<sensor", asks, 1)).json()
    assert scene["requirements"]["polarised_by"] == "stokes"
    assert "polarisation" in scene["requirements"]["features"]
    job = server.wait_ended(server.submit({"spp": 32}, {"seed": 3}, id=scene["id"])["id"])
    assert (job["state"], job["settings"]["channels"]) == ("succeeded", ["stokes"])
    assert client.get(f"/api/jobs/{job['id']}/image.png").status_code == 200
    picture = client.get(f"/api/jobs/{job['id']}/image.exr").content
    for name in (b"S0.R", b"S3.B", b"stderr.S1.G"):
        assert name in picture


def test_a_scene_says_what_it_requires_when_it_is_uploaded_and_after(client: httpx.Client) -> None:
    scene = upload(client, "a.xml", PLAIN_SCENE.replace("0.4", "0.35")).json()
    found = scene["requirements"]
    assert (found["shapes"], found["emitters"], found["is_coloured"]) == ({"sphere": 1}, {"constant": 1}, False)
    assert found["features"] == ["smooth", "environment", "visible emitters"]
    assert (found["unsupported"], found["warnings"]) == ([], [])
    assert client.get(f"/api/scenes/{scene['id']}").json()["requirements"] == found


def test_a_scene_as_json_is_taken_and_rendered(server: Server, client: httpx.Client) -> None:
    document = {
        "type": "scene",
        "sensor": {
            "type": "perspective",
            "to_world": [{"look_at": {"origin": [0, 0, 5], "target": [0, 0, 0], "up": [0, 1, 0]}}],
            "film": {"type": "hdrfilm", "width": 16, "height": 12},
        },
        "sky": {"type": "constant"},
        "ball": {"type": "sphere", "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.4] * 3}}},
    }
    answer = upload(client, "ball.json", json.dumps(document))
    assert answer.status_code == 201, answer.text
    job = server.wait_ended(server.submit({"spp": 16}, {"seed": 3}, id=answer.json()["id"])["id"])
    assert (job["state"], job["settings"]["width"], job["name"]) == ("succeeded", 16, "ball")
    assert "scene.ball.radius" in refusal(
        upload(client, "b.json", json.dumps(document | {"ball": {"type": "sphere", "radius": None}}))
    )


def test_a_built_in_scene_says_what_it_requires(client: httpx.Client) -> None:
    found = client.get("/api/gallery/cornell-box/requirements", timeout=60)
    assert found.status_code == 200, found.text
    assert found.json()["shapes"] == {"rectangle": 6, "cube": 2}
    assert client.get("/api/gallery/teapot/requirements").status_code == 404


def test_the_same_content_is_the_same_scene(client: httpx.Client) -> None:
    content = PLAIN_SCENE.replace("0.4", "0.3")
    first, second = upload(client, "a.xml", content), upload(client, "b.xml", content)
    assert (first.status_code, second.status_code) == (201, 200)
    assert first.json() == second.json()


def test_a_scene_is_deleted_once_no_job_needs_it(server: Server, client: httpx.Client) -> None:
    content = PLAIN_SCENE.replace("0.4", "0.28")
    scene_id = upload(client, "a.xml", content).json()["id"]
    address, folder = f"/api/scenes/{scene_id}", server.data_dir / "scenes" / scene_id
    job = server.wait_ended(server.submit({"spp": 4}, {}, id=scene_id)["id"])
    needed = client.delete(address)
    assert (needed.status_code, needed.headers["Content-Type"]) == (409, "application/problem+json")
    assert "1 job still needs this scene" in needed.json()["detail"]
    assert folder.is_dir()
    assert client.delete(f"/api/jobs/{job['id']}").status_code == 204
    assert [client.delete(address).status_code for _ in range(2)] == [204, 404]
    assert not folder.exists()
    body = {"scene": {"id": scene_id}, "target": {"spp": 4}}
    assert "upload it first" in client.post("/api/jobs", json=body).json()["detail"]
    assert upload(client, "a.xml", content).status_code == 201


def test_uploads_stop_where_the_room_for_them_ends(own_server: Server) -> None:
    own_server.environment |= {"FREDHOLM_MAX_STORED_BYTES": str(2**20), "FREDHOLM_WARM_UP": "0"}
    own_server.start()
    (own_server.data_dir / "scenes" / "left-by-a-kill").mkdir()
    noise = random.Random(1)

    def large(n: int) -> bytes:
        mesh = OBJ + "".join(f"# {noise.randbytes(300).hex()}\n" for _ in range(n))
        return zipped(**{"scene.xml": WITH_MESH, "meshes/a.obj": mesh})

    with httpx.Client(base_url=own_server.url) as client:
        assert upload(client, "small.zip", large(1000)).status_code == 201
        refused = upload(client, "large.zip", large(1500))
        assert (refused.status_code, refused.headers["Content-Type"]) == (507, "application/problem+json")
        for part in ("FREDHOLM_MAX_STORED_BYTES", "of the 1 MiB", "0.8"):
            assert part in refused.json()["detail"]
        (first,) = client.get("/api/scenes").json()
        own_server.kill()
        own_server.start(port=own_server.port)
        assert [one.name for one in (own_server.data_dir / "scenes").iterdir()] == [first["id"]]
        assert upload(client, "large.zip", large(1500)).status_code == 507, "what is stored is known after a start"
        assert client.delete(f"/api/scenes/{first['id']}").status_code == 204
        assert upload(client, "large.zip", large(1500)).status_code == 201


def test_a_zip_with_a_mesh_is_taken_and_rendered(server: Server, client: httpx.Client) -> None:
    answer = upload(client, "mesh.zip", zipped(**{"room/scene.xml": WITH_MESH, "room/meshes/a.obj": OBJ}))
    assert answer.status_code == 201, answer.text
    job = server.wait_ended(server.submit({"spp": 16}, {}, id=answer.json()["id"])["id"])
    assert job["state"] == "succeeded", job["cause"]


def test_broken_xml_is_refused_with_its_line(client: httpx.Client) -> None:
    detail = refusal(upload(client, "a.xml", "<scene>\n<sensor></scene>"))
    assert "scene.xml:2" in detail


def test_a_scene_that_mitsuba_refuses_is_refused_with_its_reason(client: httpx.Client) -> None:
    detail = refusal(upload(client, "a.xml", PLAIN_SCENE.replace('type="sphere"', 'type="spheroid"')))
    assert "spheroid" in detail


def test_a_missing_mesh_is_refused(client: httpx.Client) -> None:
    assert "a.obj" in refusal(upload(client, "a.zip", zipped(**{"scene.xml": WITH_MESH})))


@pytest.mark.parametrize(
    "element",
    [
        '<shape type="obj"><string name="filename" value="/etc/passwd"/></shape>',
        '<shape type="obj"><string name="filename" value="../../fredholm.sqlite"/></shape>',
        '<include filename="/etc/passwd"/>',
        '<path value="/etc"/>',
        '<emitter type="envmap"><string name="filename" value="~/x.exr"/></emitter>',
        '<default name="d" value=".."/><shape type="obj"><string name="filename" value="$d/$d/a.obj"/></shape>',
    ],
)
def test_files_outside_the_upload_are_refused(client: httpx.Client, element: str) -> None:
    detail = refusal(upload(client, "a.xml", PLAIN_SCENE.replace("</scene>", element + "</scene>")))
    assert "outside the upload" in detail


def test_a_parameter_in_an_include_is_refused(client: httpx.Client) -> None:
    element = '<default name="d" value="/etc/passwd"/><include filename="$d"/></scene>'
    assert "parameter" in refusal(upload(client, "a.xml", PLAIN_SCENE.replace("</scene>", element)))


def test_document_types_are_refused(client: httpx.Client) -> None:
    bomb = '<!DOCTYPE s [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]>' + PLAIN_SCENE
    assert "DOCTYPE" in refusal(upload(client, "a.xml", bomb))


def test_a_bundle_with_code_is_refused_because_mitsuba_would_run_it(client: httpx.Client) -> None:
    # Mitsuba looks for plugins/TYPE.so in the scene's folder first, also for types that it has itself.
    assert "is code" in refusal(
        upload(client, "a.zip", zipped(**{"scene.xml": PLAIN_SCENE, "plugins/diffuse.so": "x"}))
    )


def test_a_hostile_zip_is_refused(client: httpx.Client) -> None:
    assert "'..'" in refusal(upload(client, "a.zip", zipped(**{"../scene.xml": PLAIN_SCENE})))
    assert "damaged" in refusal(upload(client, "a.zip", b"PK\x03\x04garbage"))
    many = zipped(**{f"{i}.xml": "" for i in range(30)})
    assert "more than 20 files" in refusal(upload(client, "a.zip", many))


def uploaded_while(server: Server, client: httpx.Client, radiance: str, *signals: signal.Signals) -> httpx.Response:
    """The answer to an upload during whose check its process gets signals."""
    upload(client, "a.xml", PLAIN_SCENE.replace("0.4", "0.2"))
    pid = server.render_pids(engine="inspect")[-1]
    os.kill(pid, signal.SIGSTOP)
    with ThreadPoolExecutor() as threads:
        answer = threads.submit(upload, client, "a.xml", PLAIN_SCENE.replace("0.4", radiance))
        time.sleep(0.5)
        for one in signals:
            os.kill(pid, one)
        return answer.result()


def test_a_scene_during_which_the_process_dies_is_refused_and_the_next_is_not(
    server: Server, client: httpx.Client
) -> None:
    answer = uploaded_while(server, client, "0.21", signal.SIGSEGV, signal.SIGCONT)
    assert "the render process died" in refusal(answer)
    assert upload(client, "a.xml", PLAIN_SCENE.replace("0.4", "0.22")).status_code == 201


def test_a_scene_whose_process_is_killed_from_outside_is_checked_again(server: Server, client: httpx.Client) -> None:
    answer = uploaded_while(server, client, "0.23", signal.SIGKILL)
    assert answer.status_code == 201, answer.text


def test_an_upload_over_the_limit_is_told_the_limit(client: httpx.Client) -> None:
    answer = upload(client, "a.xml", b"x" * (2 << 20))
    assert answer.status_code == 413
    assert answer.headers["Content-Type"] == "application/problem+json"
    assert "1 MiB" in answer.json()["detail"]


def test_an_upload_over_the_limit_without_a_length_is_cut_off(client: httpx.Client) -> None:
    def chunks() -> object:
        yield b'--x\r\nContent-Disposition: form-data; name="file"; filename="a.xml"\r\n\r\n'
        for _ in range(40):
            yield b"y" * 65536

    headers = {"Content-Type": "multipart/form-data; boundary=x"}
    try:
        answer = client.post("/api/scenes", content=chunks(), headers=headers)  # type: ignore[arg-type]
    except httpx.WriteError:
        return  # the server closed the connection before all was sent
    assert answer.status_code == 413


def test_an_upload_without_a_file_is_told(client: httpx.Client) -> None:
    answer = client.post("/api/scenes", files={"other": ("a.xml", PLAIN_SCENE)})
    assert answer.status_code == 422
    assert answer.json()["errors"][0]["field"] == "file"


def test_few_uploads_are_unpacked_at_once(server: Server) -> None:
    """Unpacked, each may take a large part of the disk."""
    seen: list[int] = []

    def one(i: int) -> int:
        with server.client() as client:
            return upload(client, "a.xml", PLAIN_SCENE.replace("0.4", f"0.3{i}")).status_code

    with ThreadPoolExecutor(8) as pool:
        answers = [pool.submit(one, i) for i in range(8)]
        while not all(answer.done() for answer in answers):
            seen.append(len(list((server.data_dir / "inspection").glob("*/incoming/.upload-*"))))
            time.sleep(0.005)
    assert {answer.result() for answer in answers} <= {200, 201}
    assert max(seen) == 1


THREE_SENSORS = """<scene version="3.0.0"><sensor type="perspective" id="front"><film type="hdrfilm">
<integer name="width" value="16"/><integer name="height" value="12"/></film></sensor>
<sensor type="perspective" id="detail"><film type="hdrfilm"><integer name="width" value="400"/>
<integer name="height" value="200"/><integer name="crop_width" value="100"/><integer name="crop_height" value="100"/>
<integer name="crop_offset_x" value="50"/><integer name="crop_offset_y" value="20"/></film></sensor>
<sensor type="orthographic"><film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="8"/>
</film></sensor><emitter type="constant"/><shape type="sphere"/></scene>"""


def test_a_job_names_its_sensor_and_gets_the_size_of_that_ones_picture(server: Server, client: httpx.Client) -> None:
    answer = upload(client, "three.xml", THREE_SENSORS).json()
    found = answer["requirements"]["sensor_choices"]
    assert [(one["name"], one["width"], one["height"]) for one in found] == [
        ("front", 16, 12),
        ("detail", 100, 100),
        ("", 8, 8),
    ]
    said = "3 sensors: the picture is the first one's, 'front'; choose another by name: 'detail', 2"
    assert said in answer["warnings"]
    asked = [({}, 16, 12, None), ({"sensor": "detail"}, 100, 100, 1), ({"sensor": 2}, 8, 8, 2)]
    asked += [({"sensor": "detail", "width": 20}, 20, 20, 1), ({"sensor": 0, "height": 24}, 32, 24, 0)]
    for settings, width, height, index in asked:
        sides = {"width": None, "height": None}
        job = server.wait_ended(server.submit({"spp": 4}, sides | settings, id=answer["id"])["id"])
        told = job["settings"]
        assert (job["state"], told["width"], told["height"], told["sensor"]) == ("succeeded", width, height, index)
        assert (said in job["warnings"]) == (index is None)
    body = {"scene": {"id": answer["id"]}, "target": {"spp": 4}, "settings": {"sensor": "top"}}
    refused = client.post("/api/jobs", json=body)
    assert (refused.status_code, refused.json()["errors"][0]["field"]) == (422, "settings.sensor")
    assert "the scene has 0 'front', 1 'detail', 2" in refused.json()["detail"]


def test_more_sensors_than_are_listed_are_told_and_can_all_be_asked_for(server: Server, client: httpx.Client) -> None:
    film = '<film type="hdrfilm"><integer name="width" value="{}"/><integer name="height" value="4"/></film>'
    every = "".join(f'<sensor type="perspective">{film.format(4 + i)}</sensor>' for i in range(150))
    scene = f'<scene version="3.0.0">{every}<emitter type="constant"/><shape type="sphere"/></scene>'
    answer = upload(client, "many.xml", scene).json()
    for told in (answer["requirements"], client.get(f"/api/scenes/{answer['id']}").json()["requirements"]):
        assert len(told["sensor_choices"]) == 100
        assert (
            "150 sensors, the first 100 of which are listed: ask for another by its name or its number, 0 to 149"
            in (told["notes"])
        )
    body = {"scene": {"id": answer["id"]}, "target": {"spp": 4}, "settings": {"sensor": 149}}
    job = client.post("/api/jobs", json=body)
    assert job.status_code == 201, job.text
    assert (job.json()["settings"]["width"], job.json()["settings"]["sensor"]) == (153, 149)
    assert server.wait_ended(job.json()["id"])["state"] == "succeeded"
