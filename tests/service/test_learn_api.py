"""The Learn view's API: questions about one pixel, answered by the render process."""

from __future__ import annotations

import math
import os
import signal
from typing import Any

import httpx
import pytest
from service_process import PLAIN_SCENE, Server

from tests.files import decode_frame

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


def test_a_scene_with_media_has_no_lesson_and_says_so(client: httpx.Client) -> None:
    known = {scene["name"]: scene["has_lesson"] for scene in client.get("/api/gallery").json()}
    assert known["cornell-box"]
    assert not known["fog"]
    answer = client.get("/api/learn/fog", params={"x": 4, "y": 5}, timeout=60)
    assert answer.status_code == 422
    assert "participating media" in answer.json()["detail"]


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


def test_pages_of_other_sites_cannot_set_the_renderer_to_work(client: httpx.Client) -> None:
    for headers in (
        {"Sec-Fetch-Site": "cross-site"},
        {"Sec-Fetch-Site": "same-site"},
        {"Origin": "http://127.0.0.1:1"},
    ):
        for part in ("", "/incident", "/kernel", "/bounces", "/paths", "/light-points", "/samples"):
            answer = client.get(f"/api/learn/cornell-box{part}", params=AT, headers=headers)
            assert answer.status_code == 403, (headers, part)


def test_the_same_question_again_is_answered_without_the_renderer(client: httpx.Client, server: Server) -> None:
    first = client.get("/api/learn/cornell-box/samples", params=AT | {"count": 100}, timeout=60)
    for pid in server.render_pids()[-1:]:
        os.kill(pid, signal.SIGSTOP)
        try:
            again = client.get("/api/learn/cornell-box/samples", params=AT | {"count": 100}, timeout=20)
        finally:
            os.kill(pid, signal.SIGCONT)
        assert again.content == first.content


def test_terms_of_the_series_sum_to_the_pixel(client: httpx.Client) -> None:
    told = client.get("/api/learn/cornell-box/bounces", params=AT | {"count": 512}, timeout=60).json()
    parts = [*told["terms"], told["more"]]
    assert math.isclose(sum(part["mean"] for part in parts), told["total"]["mean"], rel_tol=1e-9)
    assert math.isclose(told["reflected"]["mean"] + told["terms"][0]["mean"], told["total"]["mean"], rel_tol=1e-9)
    same = client.get("/api/learn/cornell-box/samples", params=AT | {"count": 512}, timeout=60).json()[-1]
    assert math.isclose(same["mean"], told["total"]["mean"], rel_tol=1e-6)
    direct = client.get("/api/learn/cornell-box/samples", params=AT | {"count": 512, "max_depth": 2}, timeout=60)
    assert math.isclose(direct.json()[-1]["mean"], told["terms"][0]["mean"] + told["terms"][1]["mean"], rel_tol=1e-6)


def test_the_kernel_of_the_equation_is_a_frame(client: httpx.Client) -> None:
    """f·cosθ of a diffuse floor: albedo/π · cosθ, brightest along the normal and the same all around it."""
    answer = client.get("/api/learn/cornell-box/kernel", params=AT, timeout=60)
    _, planes = decode_frame(answer.content)
    green = planes[..., 1]
    assert (abs(green - green[:, :1]) <= 2e-3 * green.max()).all()
    assert math.isclose(
        green[16, 0] / green[0, 0], math.cos(math.pi / 2 * 16.5 / 32) / math.cos(math.pi / 128), rel_tol=1e-2
    )


def test_a_path_is_told_vertex_by_vertex(client: httpx.Client) -> None:
    def ask(first: int) -> dict[str, Any]:
        answer = client.get("/api/learn/cornell-box/paths", params=AT | {"first": first}, timeout=60)
        assert answer.status_code == 200, answer.text
        return answer.json()

    told = ask(0)
    assert told["is_placed"]
    assert [path["number"] for path in told["paths"]] == list(range(16))
    assert ask(8)["paths"][:8] == told["paths"][8:], "a path is known by its number"
    for path in told["paths"]:
        first, *later = path["vertices"]
        assert first["throughput"] == 1
        assert math.hypot(first["column"] - (AT["x"] + 0.5), first["row"] - (AT["y"] + 0.5)) < 0.1
        assert math.isclose(path["sum"], sum(vertex["added"] for vertex in path["vertices"]), abs_tol=1e-9)
        for before, vertex in zip(path["vertices"], later, strict=False):
            assert vertex["is_sky"] == (vertex["position"] is None) == (vertex["distance"] is None)
            if not vertex["is_sky"]:
                # A ray begins a little off its surface, by up to 0.05 in this box of 556.
                way = math.dist(before["position"], vertex["position"])
                assert math.isclose(way, vertex["distance"], abs_tol=0.1)
    assert any(len(path["vertices"]) > 2 for path in told["paths"])


def test_points_on_lights_have_every_factor_of_the_area_form(client: httpx.Client) -> None:
    answer = client.get("/api/learn/cornell-box/light-points", params=AT | {"n": 128}, timeout=60)
    assert answer.status_code == 200, answer.text
    points = answer.json()["points"]
    assert len(points) == 128
    assert any(point["estimate"] > 0 for point in points)
    for point in points:
        assert point["has_area"]
        slants = abs(point["cos_theta"]) * max(point["cos_light"], 0)
        assert math.isclose(point["geometry"], slants / point["distance"] ** 2, rel_tol=1e-6)
        found = point["f"] * point["emitted"] * point["is_visible"] * point["geometry"] / point["pdf_area"]
        assert math.isclose(point["estimate"], found, rel_tol=0.02), "luminances, but colours multiply by channels"


def test_a_sky_has_no_area_form(client: httpx.Client) -> None:
    answer = client.get("/api/learn/glass-sky/light-points", params={"x": 4, "y": 5, "n": 8}, timeout=60)
    assert answer.status_code == 200, answer.text
    for point in answer.json()["points"]:
        assert not point["has_area"]
        assert point["geometry"] is point["pdf_area"] is point["cos_light"] is point["distance"] is None


def test_more_points_or_paths_than_there_are_numbers_for_are_refused(client: httpx.Client) -> None:
    for part, query in (("light-points", {"n": 0}), ("light-points", {"n": 1025}), ("paths", {"first": -1})):
        refused = client.get(f"/api/learn/cornell-box/{part}", params=AT | query)
        assert refused.status_code == 422, (part, query)
        assert next(iter(query)) in refused.text


def test_an_uploaded_scene_has_its_lesson_and_one_that_is_not_there_has_none(client: httpx.Client) -> None:
    file = {"file": ("mine.xml", PLAIN_SCENE.encode())}
    scene = client.post("/api/scenes", files=file, timeout=60).json()["id"]
    told = client.get(f"/api/learn/{scene}", params={"x": 16, "y": 12, "n": 8}, timeout=60)
    assert told.status_code == 200, told.text
    assert (told.json()["width"], told.json()["height"]) == (32, 24)
    assert told.json()["lobes"] == ["DiffuseReflection"]
    # A sky of 0.5 over a convex body of albedo 0.4: what is reflected is 0.2, in every sample but for its noise.
    last = client.get(f"/api/learn/{scene}/samples", params={"x": 16, "y": 12, "count": 4096}, timeout=60).json()[-1]
    assert last["mean"] == pytest.approx(0.2, rel=0.02)
    picture = client.get(f"/api/learn/{scene}/picture.png", timeout=60)
    assert picture.content.startswith(b"\x89PNG")
    refused = client.get(f"/api/learn/{scene}", params={"x": 32, "y": 0})
    assert refused.status_code == 422
    assert "whose width is 32" in refused.json()["detail"]


def test_an_uploaded_scene_with_media_has_no_lesson(client: httpx.Client) -> None:
    fog = '<medium type="homogeneous" name="interior"><float name="sigma_t" value="1"/></medium>'
    foggy = PLAIN_SCENE.replace('<shape type="sphere">', f'<shape type="sphere">{fog}')
    scene = client.post("/api/scenes", files={"file": ("fog.xml", foggy.encode())}, timeout=60).json()["id"]
    answer = client.get(f"/api/learn/{scene}", params={"x": 16, "y": 12}, timeout=60)
    assert answer.status_code == 422
    assert "participating media" in answer.json()["detail"]


def measured(client: httpx.Client, path: str, **query: Any) -> list[dict[str, Any]]:
    """All turns of a measurement."""
    turns = []
    while not turns or not turns[-1]["is_done"]:
        assert len(turns) < 400
        answer = client.get(path, params=query | {"step": len(turns)}, timeout=120)
        assert answer.status_code == 200, answer.text
        turns.append(answer.json())
    return turns


def test_error_against_time_is_measured_turn_by_turn(client: httpx.Client) -> None:
    turns = measured(client, "/api/learn/cornell-box/trade", seconds=0.3)
    assert len(turns) > 1, "others have their turns between"
    assert [turn["share"] for turn in turns] == sorted(turn["share"] for turn in turns)
    last = turns[-1]
    assert last["share"] == 1
    assert last["width"] * last["height"] * last["full_size"] == last["full_width"] * last["full_height"]
    default, *others = last["settings"]
    assert default["times"] == 1
    assert {other["technique"] for other in others} == {"bsdf", "emitter", "cosine", "uniform"}
    two, one = (next(t for t in default["times_to"] if t["target"] == target) for target in (0.02, 0.01))
    for point in default["curve"]:
        assert point["low"] <= point["error"] <= point["high"]
    if not two["is_measured"]:  # then both follow from the one constant
        assert one["seconds"] == pytest.approx(4 * two["seconds"])
        assert two["seconds"] == pytest.approx(default["work"] / 0.02**2)
    again = client.get("/api/learn/cornell-box/trade", params={"seconds": 0.3, "step": len(turns) - 1}, timeout=60)
    assert again.json() == last


def test_what_the_lean_kernel_saves_is_measured(client: httpx.Client) -> None:
    last = measured(client, "/api/learn/cornell-box/kernels")[-1]
    assert last["left_out"]
    assert min(last["full"]["operations"], last["lean"]["operations"]) > 0
    assert last["lean"]["render_ratio"] == 1
    assert last["full"]["low"] <= last["full"]["render_ratio"] <= last["full"]["high"]


def test_an_extreme_is_computed_both_ways(client: httpx.Client) -> None:
    far = client.get("/api/extremes/many-samples", params={"k": 4}, timeout=60).json()
    assert far["at"] == 1e6
    assert abs(far["naive"] / far["exact"] - 1) > 5e-3
    assert abs(far["ours"] / far["exact"] - 1) < 1e-6
    assert client.get("/api/extremes/nothing").status_code == 422
    assert client.get("/api/extremes/many-samples", params={"k": 7}).status_code == 422
