"""The Learn view's API: questions about one pixel, answered by the render process."""

from __future__ import annotations

import math

import httpx

from service.frames import decode_frame

AT = {"x": 174, "y": 445}


def test_the_first_vertex_has_directions_of_every_technique(client: httpx.Client) -> None:
    answer = client.get("/api/learn/cornell-box", params=AT | {"n": 64}, timeout=60)
    assert answer.status_code == 200, answer.text
    vertex = answer.json()
    assert vertex["is_hit"]
    assert vertex["lobes"] == ["DiffuseReflection"]
    assert vertex["polar_range"] == math.pi / 2
    assert set(vertex["directions"]) == {"uniform", "cosine", "bsdf", "emitter"}
    assert len(vertex["directions"]["cosine"]["u"]) == 64


def test_a_scene_without_colour_has_its_lesson(client: httpx.Client) -> None:
    furnace = "/api/learn/furnace"
    at = {"x": 40, "y": 50}
    assert client.get(furnace, params=at, timeout=60).json()["is_hit"]
    answer = client.get(f"{furnace}/incident", params=at | {"replicates": 2}, timeout=60)
    _, planes = decode_frame(answer.content)
    assert (planes[..., 0] == planes[..., 2]).all(), "grey"
    assert client.get(f"{furnace}/samples", params=at | {"count": 64}, timeout=60).json()[-1]["mean"] > 0


def test_incident_radiance_is_a_frame(client: httpx.Client) -> None:
    answer = client.get("/api/learn/cornell-box/incident", params=AT | {"replicates": 4}, timeout=60)
    header, planes = decode_frame(answer.content)
    assert (header.width, header.height) == (128, 32)
    assert planes[..., :3].max() > 1, "the lamp is among what is seen"
    weighted = client.get(
        "/api/learn/cornell-box/incident", params=AT | {"replicates": 4, "weighted": True}, timeout=60
    )
    _, less = decode_frame(weighted.content)
    assert (less[..., :3] <= planes[..., :3] + 1e-3).all()


def test_parts_of_a_running_estimate_go_on_where_the_last_ended(client: httpx.Client) -> None:
    def ask(**query: int) -> list[dict[str, float]]:
        answer = client.get("/api/learn/cornell-box/samples", params=AT | query, timeout=60)
        assert answer.status_code == 200, answer.text
        return answer.json()

    whole = ask(count=512)[-1]
    first, second = ask(count=256)[-1], ask(first=256, count=256)[-1]
    assert whole["n"] == 512
    assert math.isclose(whole["mean"], (first["mean"] + second["mean"]) / 2, rel_tol=1e-9)


def test_what_is_not_there_is_refused(client: httpx.Client) -> None:
    assert client.get("/api/learn/no-such-scene", params=AT).status_code == 404
    refused = client.get("/api/learn/cornell-box", params={"x": 512, "y": 0})
    assert refused.status_code == 422
    assert "512" in refused.json()["detail"]
