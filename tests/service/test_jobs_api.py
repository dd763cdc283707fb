"""Jobs over real HTTP, rendered by the real renderer."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any
from urllib.parse import urljoin

import httpx
import pytest
from service_process import LONG, SMALL, Server, wait_for

from tests.files import decode_frame


def test_the_gallery_lists_scenes_with_thumbnails(client: httpx.Client) -> None:
    scenes = client.get("/api/gallery").json()
    assert "cornell-box" in [scene["name"] for scene in scenes]
    for scene in scenes:
        assert scene["thumbnail"] == f"api/gallery/{scene['name']}/thumbnail.png"
    picture = client.get("/api/gallery/cornell-box/thumbnail.png")
    assert picture.status_code == 200
    assert picture.content.startswith(b"\x89PNG")


def test_a_job_is_queued_shows_frames_and_succeeds(server: Server, client: httpx.Client) -> None:
    body = {"scene": {"gallery": "cornell-box"}, "target": {"spp": 256}, "settings": SMALL}
    answer = client.post("/api/jobs", json=body)
    assert answer.status_code == 201
    job = answer.json()
    assert answer.headers["Location"] == f"/api/jobs/{job['id']}"
    assert (job["state"], job["frame_seq"], job["scene"]["gallery"]) == ("queued", 0, "cornell-box")
    assert {key: value for key, value in job["target"].items() if value is not None} == {"spp": 256}

    seen: list[int] = []

    def is_over() -> bool:
        frame = client.get(f"/api/jobs/{job['id']}/frames/latest", params={"after": seen[-1] if seen else 0})
        if frame.status_code == 200:
            header, planes = decode_frame(frame.content)
            assert header.seq == int(frame.headers["X-Frame-Seq"])
            assert planes.shape == (64, 64, 4)
            seen.append(header.seq)
        else:
            assert frame.status_code == 204
        return client.get(f"/api/jobs/{job['id']}").json()["state"] == "succeeded"

    wait_for(is_over, 60, "the job")
    ended = server.job(job["id"])
    assert seen == sorted(set(seen))
    assert seen
    assert (ended["stopped_by"], ended["spp"], ended["samples"]) == ("spp", 256, 256 * 64 * 64)
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z", ended["finished_at"])
    assert 0 < ended["error"] < 1
    assert ended["curve"]
    assert ended["curve"][-1]["spp"] == 256


def test_a_finished_job_still_has_its_frame(client: httpx.Client, finished: dict[str, Any]) -> None:
    address = f"/api/jobs/{finished['id']}/frames/latest"
    frame = client.get(address)
    header, planes = decode_frame(frame.content)
    assert header.seq == finished["frame_seq"]
    assert header.spp_mean == 128
    assert (planes[..., 3] < float("inf")).all()
    assert client.get(address, params={"after": header.seq}).status_code == 204
    again = client.get(address, headers={"If-None-Match": frame.headers["ETag"]})
    assert again.status_code == 304
    assert again.content == b""


@pytest.mark.parametrize("encoding", ["zstd", "gzip", "identity"])
def test_frames_are_encoded_as_the_client_accepts(
    client: httpx.Client, finished: dict[str, Any], encoding: str
) -> None:
    frame = client.get(f"/api/jobs/{finished['id']}/frames/latest", headers={"Accept-Encoding": encoding})
    assert frame.headers.get("Content-Encoding", "identity") == encoding
    assert frame.headers["Vary"] == "Accept-Encoding"
    assert decode_frame(frame.content)[0].width == 64


def test_a_frame_can_be_had_at_half_size(client: httpx.Client, finished: dict[str, Any]) -> None:
    frame = client.get(f"/api/jobs/{finished['id']}/frames/latest", params={"scale": 2})
    header, planes = decode_frame(frame.content)
    assert (header.width, header.height, header.reduce) == (32, 32, 2)
    assert planes.shape == (32, 32, 4)


def test_a_pixel_is_read_with_its_error_bars(client: httpx.Client, finished: dict[str, Any]) -> None:
    address = f"/api/jobs/{finished['id']}"
    pixel = client.get(f"{address}/pixel", params={"x": 20, "y": 40}).json()
    _, planes = decode_frame(client.get(f"{address}/frames/latest").content)
    assert pixel["value"] == pytest.approx(list(planes[40, 20, :3]), rel=1e-3)
    assert pixel["standard_error"][3] == pytest.approx(planes[40, 20, 3], rel=1e-3)
    low, high = pixel["interval"]
    assert low < pixel["luminance"] < high
    assert (
        pixel["samples"] == pixel["replicates"] * finished["replicate_size"] >= 64
    )  # adaptive: not every pixel has the mean of 128
    assert (high - low) / 2 > 1.96 * pixel["standard_error"][3]  # Student t, not normal


def test_the_exr_opens_in_openimageio(client: httpx.Client, finished: dict[str, Any], tmp_path: Path) -> None:
    import OpenImageIO as oiio

    answer = client.get(f"/api/jobs/{finished['id']}/image.exr")
    assert answer.headers["Content-Type"] == "image/x-exr"
    path = tmp_path / "out.exr"
    path.write_bytes(answer.content)
    image = oiio.ImageBuf(str(path))
    assert {"R", "G", "B", "stderr.Y", "count"} <= set(image.spec().channelnames)
    pixel = client.get(f"/api/jobs/{finished['id']}/pixel", params={"x": 20, "y": 40}).json()
    assert list(image.getpixel(20, 40))[:3] == pytest.approx(pixel["value"], rel=1e-5)


def test_the_exr_is_small_and_the_checkpoint_is_asked_for_by_name(
    client: httpx.Client, finished: dict[str, Any], tmp_path: Path
) -> None:
    from renderer import Estimate
    from renderer.errors import CheckpointError

    files = {name: tmp_path / name for name in ("image.exr", "checkpoint.exr", "half.exr")}
    for name, path in files.items():
        asked = "image.exr?half=1" if name == "half.exr" else name
        answer = client.get(f"/api/jobs/{finished['id']}/{asked}")
        assert answer.status_code == 200
        path.write_bytes(answer.content)
    whole, small, smaller = (files[name].stat().st_size for name in ("checkpoint.exr", "image.exr", "half.exr"))
    assert whole > 3 * small > 3 * smaller
    assert Estimate.read(files["checkpoint.exr"]).samples == finished["samples"]
    with pytest.raises(CheckpointError, match="is a picture, without the moments"):
        Estimate.read(files["image.exr"])


def test_the_png_is_a_picture_and_exposure_brightens_it(
    client: httpx.Client, finished: dict[str, Any], tmp_path: Path
) -> None:
    import OpenImageIO as oiio

    means: list[float] = []
    for exposure in (0, 1):
        answer = client.get(f"/api/jobs/{finished['id']}/image.png", params={"exposure": exposure})
        assert answer.headers["Content-Type"] == "image/png"
        path = tmp_path / f"{exposure}.png"
        path.write_bytes(answer.content)
        pixels = oiio.ImageBuf(str(path)).get_pixels(oiio.UINT8)
        assert pixels is not None
        assert pixels.shape == (64, 64, 3)
        means.append(float(pixels.mean()))
    assert 10 < means[0] < means[1]


def test_a_running_job_is_cancelled_and_keeps_its_picture(server: Server, client: httpx.Client) -> None:
    job = server.submit(LONG)
    server.wait(job["id"], lambda now: now["frame_seq"] > 0)
    answer = server.cancel(job["id"])
    assert answer.status_code == 200
    cancelled = answer.json()
    assert (cancelled["state"], cancelled["stopped_by"]) == ("cancelled", "cancelled")
    frame = client.get(f"/api/jobs/{job['id']}/frames/latest")
    assert decode_frame(frame.content)[0].spp_mean == pytest.approx(cancelled["spp"])
    assert client.get(f"/api/jobs/{job['id']}/image.exr").status_code == 200
    again = server.cancel(job["id"])
    assert again.status_code == 409
    assert "a job that is cancelled cannot be cancelled" in again.json()["detail"].lower()


def test_a_young_job_has_an_exr_as_soon_as_one_is_asked_for(server: Server, client: httpx.Client) -> None:
    job = server.submit(LONG)
    server.wait(job["id"], lambda now: now["frame_seq"] > 0)
    assert client.get(f"/api/jobs/{job['id']}/image.exr").status_code == 200
    server.cancel(job["id"])


def test_several_jobs_all_get_pictures_and_end(server: Server) -> None:
    jobs = [server.submit(LONG, SMALL | {"seed": seed})["id"] for seed in range(3)]
    for job_id in jobs:
        server.wait(job_id, lambda now: now["frame_seq"] >= 2)
    assert [server.cancel(job_id).json()["state"] for job_id in jobs] == ["cancelled"] * 3


def test_the_list_of_jobs_is_filtered_by_state_and_goes_on_where_it_ended(
    client: httpx.Client, finished: dict[str, Any]
) -> None:
    ask = {"limit": 1, "state": ["succeeded", "failed"]}
    first = client.get("/api/jobs", params=ask).json()["jobs"][0]
    older = client.get("/api/jobs", params=ask | {"before": first["id"], "limit": 1000}).json()["jobs"]
    assert {job["state"] for job in [first, *older]} <= {"succeeded", "failed"}
    assert finished["id"] in [job["id"] for job in [first, *older]]
    assert first["id"] not in [job["id"] for job in older]
    assert client.get("/api/jobs", params={"state": "paused", "limit": 1000}).json()["jobs"] == []
    for bad, told in (({"state": "asleep"}, "paused"), ({"before": "nobody"}, "there is no job 'nobody'")):
        refused = client.get("/api/jobs", params=bad)
        assert (refused.status_code, refused.headers["Content-Type"]) == (422, "application/problem+json")
        assert told in refused.text


def test_the_png_is_mapped_as_it_is_shown(client: httpx.Client, finished: dict[str, Any]) -> None:
    address = f"/api/jobs/{finished['id']}/image.png"
    bodies = [client.get(address, params={"tone": tone}) for tone in ("srgb", "filmic", "reinhard")]
    assert len({body.content for body in bodies}) == len({body.headers["etag"] for body in bodies}) == 3
    assert client.get(address).content == bodies[0].content
    assert client.get(address, params={"tone": "loud"}).status_code == 422


def test_a_list_says_how_many_jobs_there_are_beyond_it(
    server: Server, client: httpx.Client, finished: dict[str, Any]
) -> None:
    whole = client.get("/api/jobs", params={"limit": 1000}).json()
    assert whole["total"] == len(whole["jobs"]) >= 1
    assert client.get("/api/jobs", params={"limit": 1}).json()["total"] == whole["total"]
    ended = [job for job in whole["jobs"] if job["state"] == "succeeded"]
    assert client.get("/api/jobs", params={"limit": 1, "state": "succeeded"}).json()["total"] == len(ended)


def test_what_a_job_tells_of_its_settings_and_target_can_be_asked_for_again(
    server: Server, client: httpx.Client
) -> None:
    target = {"spp": 16, "error": 0.5, "confidence": 0.99, "share": 0.9, "region": [0, 0, 4, 4]}
    settings = {"width": 8, "height": 8, "channels": ["albedo", "depth"], "colour": "rgb", "adaptive": False}
    told = server.wait_ended(server.submit(target, settings)["id"])
    asked = {"scene": {"gallery": told["scene"]["gallery"]}, "target": told["target"], "settings": told["settings"]}
    again = client.post("/api/jobs", json=asked)
    assert again.status_code == 201, again.text
    assert again.json()["settings"] == told["settings"]
    assert again.json()["target"] == told["target"]
    server.wait_ended(again.json()["id"])


def test_the_curve_tells_the_bound_that_decides(server: Server) -> None:
    job = server.wait_ended(server.submit({"spp": 256}, {"width": 16, "height": 16})["id"])
    curve = server.job(job["id"])["curve"]
    assert curve
    known = [point for point in curve if point["upper"] is not None]
    assert known
    assert all(point["upper"] >= point["error"] for point in known)
    assert known[-1]["upper"] == job["error_upper"]


def test_jobs_are_listed_newest_first_without_curves(server: Server, client: httpx.Client) -> None:
    ids = [server.wait_ended(server.submit({"spp": 4})["id"])["id"] for _ in range(2)]
    listed = client.get("/api/jobs", params={"limit": 2}).json()["jobs"]
    assert [job["id"] for job in listed] == ids[::-1]
    assert "curve" not in listed[0]


def test_one_side_alone_scales_the_other(server: Server) -> None:
    job = server.submit({"spp": 4}, {"width": 32})
    assert (job["settings"]["width"], job["settings"]["height"]) == (32, 32)
    server.wait_ended(job["id"])


def test_an_error_target_is_reached_and_said(server: Server) -> None:
    job = server.wait_ended(server.submit({"error": 0.2, "seconds": 60})["id"])
    assert job["stopped_by"] == "error"
    assert job["error"] <= 0.2


@pytest.mark.parametrize(
    ("body", "field"),
    [
        ({"target": {"spp": 4}}, "scene"),
        ({"scene": {"gallery": "cornell-box", "id": "x"}, "target": {"spp": 4}}, "scene"),
        ({"scene": {"gallery": "cornell-box"}, "target": {}}, "target"),
        ({"scene": {"gallery": "cornell-box"}, "target": {"error": -1}}, "target.error"),
        ({"scene": {"gallery": "cornell-box"}, "target": {"spp": 4, "sp": 4}}, "target.sp"),
        ({"scene": {"gallery": "no-such"}, "target": {"spp": 4}}, "scene.gallery"),
        ({"scene": {"id": "no-such"}, "target": {"spp": 4}}, "scene.id"),
        (
            {"scene": {"gallery": "cornell-box"}, "target": {"spp": 4}, "settings": {"technique": "magic"}},
            "settings.technique",
        ),
        (
            {"scene": {"gallery": "cornell-box"}, "target": {"spp": 4}, "settings": {"guide": "maybe"}},
            "settings.guide",
        ),
        (
            {"scene": {"gallery": "cornell-box"}, "target": {"spp": 4}, "settings": {"width": 16384}},
            "settings.width",
        ),
    ],
)
def test_a_bad_request_names_its_field(client: httpx.Client, body: dict[str, Any], field: str) -> None:
    answer = client.post("/api/jobs", json=body)
    assert answer.status_code == 422
    assert answer.headers["Content-Type"] == "application/problem+json"
    problem = answer.json()
    assert problem["status"] == 422
    assert field in [error["field"] for error in problem["errors"]]
    assert all(error["message"] for error in problem["errors"])


def test_broken_json_is_told(client: httpx.Client) -> None:
    answer = client.post("/api/jobs", content=b"{nope", headers={"Content-Type": "application/json"})
    assert answer.status_code == 422
    assert "not valid JSON" in answer.json()["detail"]


@pytest.mark.parametrize(
    ("method", "path", "status"),
    [
        ("GET", "/api/jobs/nope", 404),
        ("POST", "/api/jobs/nope/cancel", 404),
        ("GET", "/api/jobs/nope/frames/latest", 404),
        ("GET", "/api/jobs/nope/image.exr", 404),
        ("GET", "/api/scenes/nope", 404),
        ("GET", "/api/gallery/nope/thumbnail.png", 404),
        ("GET", "/api/nothing/here", 404),
        ("DELETE", "/api/jobs", 405),
    ],
)
def test_every_error_is_a_problem_body(client: httpx.Client, method: str, path: str, status: int) -> None:
    answer = client.request(method, path)
    assert answer.status_code == status
    assert answer.headers["Content-Type"] == "application/problem+json"
    problem = answer.json()
    assert problem["status"] == status
    assert problem["title"]
    assert problem["detail"].endswith(".")


def test_a_pixel_outside_is_refused(client: httpx.Client, finished: dict[str, Any]) -> None:
    answer = client.get(f"/api/jobs/{finished['id']}/pixel", params={"x": 64, "y": 0})
    assert answer.status_code == 422
    assert answer.json()["errors"] == [{"field": "x", "message": "64 is outside the picture, whose width is 64"}]


def test_pages_of_other_sites_cannot_start_or_cancel_jobs(client: httpx.Client, finished: dict[str, Any]) -> None:
    address = f"/api/jobs/{finished['id']}/cancel"
    assert client.post(address, headers={"Sec-Fetch-Site": "cross-site"}).status_code == 403
    assert client.post(address, headers={"Sec-Fetch-Site": "same-origin"}).status_code == 409


def test_the_description_knows_problems_events_and_frames(client: httpx.Client) -> None:
    document = client.get("/api/openapi.json").json()
    assert {"Job", "JobDetail", "Problem", "Hello", "ProgressMessage", "FrameHeader", "Pixel"} <= set(
        document["components"]["schemas"]
    )
    submit = document["paths"]["/api/jobs"]["post"]["responses"]
    assert submit["422"]["content"] == {
        "application/problem+json": {"schema": {"$ref": "#/components/schemas/Problem"}}
    }
    assert "text/event-stream" in document["paths"]["/api/events"]["get"]["responses"]["200"]["content"]
    named = set(re.findall(r"#/components/schemas/(\w+)", client.get("/api/openapi.json").text))
    assert named <= set(document["components"]["schemas"])


def test_health_and_page(client: httpx.Client) -> None:
    assert client.get("/healthz").json() == {"status": "ok"}
    assert client.get("/readyz").json()["status"] == "ready"
    page = client.get("/")
    assert page.status_code == 200
    assert page.headers["Cache-Control"] == "no-cache"
    assert "Fredholm" in page.text


@pytest.mark.parametrize(
    ("typed", "leads_to"),
    [
        ("/jobs/abc?view=error", "/#/jobs/abc?view=error"),
        ("/jobs/", "/#/jobs"),
        ("/learn", "/#/learn"),
        ("/learn/a%20b%23?x=1", "/#/learn/a%20b%23?x=1"),
    ],
)
def test_an_address_that_lost_its_hash_leads_to_the_page(client: httpx.Client, typed: str, leads_to: str) -> None:
    answer = client.get(typed, headers={"Accept": "text/html,*/*;q=0.8"})
    assert answer.status_code == 307
    assert urljoin(typed, answer.headers["Location"]) == leads_to
    assert client.get(typed).status_code == 404, "programs are told that nothing is there"
