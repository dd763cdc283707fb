"""One job whose paths have no end leaves the others their share, and can be cancelled."""

from __future__ import annotations

import time

import httpx
from service_process import LONG, Server

WHITE_ROOM = """<scene version="3.0.0">
  <integrator type="path"><integer name="max_depth" value="1000000"/></integrator>
  <sensor type="perspective"><film type="hdrfilm"><integer name="width" value="64"/><integer name="height" value="64"/>
  </film></sensor>
  <shape type="cube"><boolean name="flip_normals" value="true"/>
    <bsdf type="diffuse"><rgb name="reflectance" value="1"/></bsdf></shape>
  <emitter type="point"><point name="position" x="0.3" y="0.2" z="-0.4"/></emitter>
</scene>
"""


def test_a_white_room_with_paths_of_a_million_leaves_others_their_share(own_server: Server) -> None:
    own_server.environment |= {"FREDHOLM_TURN_DEADLINE_SECONDS": "60"}
    server = own_server.start()
    with server.client() as http:
        scene = http.post("/api/scenes", files={"file": ("room.xml", WHITE_ROOM)}, timeout=120).json()["id"]
    honest = server.submit(LONG)["id"]
    server.wait(honest, lambda job: job["seconds"] > 0.2)
    room = server.submit(LONG, {"seed": 1}, id=scene)["id"]
    server.wait(room, lambda job: job["state"] == "running")
    server.wait(honest, lambda job: job["seconds"] > 3, seconds=120)
    before, began = server.job(honest)["seconds"], time.monotonic()
    server.wait(honest, lambda job: job["seconds"] > before + 3, seconds=120)
    share = 3 / (time.monotonic() - began)
    beginning = time.monotonic()
    answer = httpx.post(f"{server.url}/api/jobs/{room}/cancel", timeout=60)
    print(f"share {share:.2f}, cancelled after {time.monotonic() - beginning:.1f} s")
    assert answer.json()["state"] == "cancelled"
    assert server.job(honest)["state"] == "running"
    lost = [line for line in server.log() if line.get("event") == "job lost its render process"]
    assert not lost, "no turn was killed: each of them ended by itself"
