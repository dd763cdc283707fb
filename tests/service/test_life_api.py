"""The life of a job over real HTTP: pause, resume, continue, delete, submit again."""

from __future__ import annotations

from typing import Any
from uuid import uuid4

import httpx
import pytest
from service_process import LONG, SMALL, Server

BOX = {"scene": {"gallery": "cornell-box"}, "settings": SMALL}


def step(client: httpx.Client, job_id: str, name: str, **body: Any) -> httpx.Response:
    return client.post(f"/api/jobs/{job_id}/{name}", json=body or None)


def test_a_running_job_is_paused_keeps_its_picture_and_goes_on(server: Server, client: httpx.Client) -> None:
    job_id = server.submit(LONG)["id"]
    server.wait(job_id, lambda job: job["frame_seq"] > 0)
    paused = step(client, job_id, "pause").json()
    assert paused["state"] == "paused"
    assert paused["finished_at"] is None
    assert client.get(f"/api/jobs/{job_id}/frames/latest").status_code == 200
    assert client.get(f"/api/jobs/{job_id}/image.exr").status_code == 200
    assert server.job(job_id)["samples"] == paused["samples"]
    again = step(client, job_id, "pause")
    assert again.status_code == 409
    assert "queued or running" in again.json()["detail"]

    resumed = step(client, job_id, "resume").json()
    assert resumed["state"] in ("queued", "running")
    on = server.wait(job_id, lambda job: job["samples"] > paused["samples"])
    assert on["frame_seq"] > paused["frame_seq"]
    assert step(client, job_id, "resume").status_code == 409
    assert server.cancel(job_id).json()["state"] == "cancelled"


def test_a_paused_job_can_be_cancelled(server: Server, client: httpx.Client) -> None:
    job_id = server.submit(LONG)["id"]
    step(client, job_id, "pause")
    assert server.cancel(job_id).json()["state"] == "cancelled"
    assert step(client, job_id, "resume").status_code == 409


def test_a_finished_job_goes_on_to_a_tighter_target_and_renders_nothing_twice(
    server: Server, client: httpx.Client
) -> None:
    done = server.wait_ended(server.submit({"spp": 64})["id"])
    assert done["spp"] == 64
    queued = step(client, done["id"], "continue", target={"spp": 96})
    assert queued.status_code == 200, queued.text
    assert queued.json()["target"]["spp"] == 96
    ended = server.wait_ended(done["id"])
    assert (ended["state"], ended["stopped_by"], ended["spp"]) == ("succeeded", "spp", 96)
    straight = server.wait_ended(server.submit({"spp": 96})["id"])
    frames = [client.get(f"/api/jobs/{job['id']}/frames/latest").content for job in (ended, straight)]
    planes = [frame[8 + int.from_bytes(frame[4:8], "little") :] for frame in frames]
    assert planes[0] == planes[1]


def test_a_cancelled_job_can_go_on(server: Server, client: httpx.Client) -> None:
    job_id = server.submit(LONG)["id"]
    server.wait(job_id, lambda job: job["frame_seq"] > 0)
    cancelled = server.cancel(job_id).json()
    goal = int(cancelled["spp"]) + 64
    assert step(client, job_id, "continue", target={"spp": goal}).status_code == 200
    assert server.wait_ended(job_id)["spp"] >= goal


@pytest.mark.parametrize(
    ("target", "field"),
    [
        ({"spp": 128}, "target.spp"),
        ({"seconds": 1e-3}, "target.seconds"),
        ({"error": 9.0}, "target.error"),
        ({"error": 0.01, "region": [60, 0, 9, 9]}, "target.region"),
    ],
)
def test_a_target_that_is_reached_already_or_out_of_reach_is_refused(
    client: httpx.Client, finished: dict[str, Any], target: dict[str, Any], field: str
) -> None:
    answer = step(client, finished["id"], "continue", target=target)
    assert answer.status_code == 422
    assert [error["field"] for error in answer.json()["errors"]] == [field]
    assert client.get(f"/api/jobs/{finished['id']}").json()["state"] == "succeeded"


def test_a_running_job_cannot_be_continued_or_deleted(server: Server, client: httpx.Client) -> None:
    job_id = server.submit(LONG)["id"]
    server.wait(job_id, lambda job: job["state"] == "running")
    assert step(client, job_id, "continue", target={"spp": 10**6}).status_code == 409
    refused = client.delete(f"/api/jobs/{job_id}")
    assert refused.status_code == 409
    assert "cancel it first" in refused.json()["detail"]
    server.cancel(job_id)
    assert client.delete(f"/api/jobs/{job_id}").status_code == 204


def test_a_deleted_job_is_gone_with_its_files(server: Server, client: httpx.Client) -> None:
    job_id = server.wait_ended(server.submit({"spp": 4})["id"])["id"]
    folder = server.data_dir / "estimates" / job_id
    assert folder.is_dir()
    assert client.delete(f"/api/jobs/{job_id}").status_code == 204
    assert not folder.exists()
    assert client.get(f"/api/jobs/{job_id}").status_code == 404
    assert client.get(f"/api/jobs/{job_id}/image.exr").status_code == 404
    assert client.delete(f"/api/jobs/{job_id}").status_code == 404
    assert job_id not in [job["id"] for job in client.get("/api/jobs").json()["jobs"]]


def test_a_repeated_submission_is_one_job(server: Server, client: httpx.Client) -> None:
    body, headers = BOX | {"target": {"spp": 4}}, {"Idempotency-Key": uuid4().hex}
    first = client.post("/api/jobs", json=body, headers=headers)
    again = client.post("/api/jobs", json=body, headers=headers)
    assert (first.status_code, again.status_code) == (201, 201)
    assert first.json()["id"] == again.json()["id"]
    assert again.headers["Idempotency-Replayed"] == "true"
    assert "Idempotency-Replayed" not in first.headers
    other = client.post("/api/jobs", json=BOX | {"target": {"spp": 8}}, headers=headers)
    assert other.status_code == 422
    assert other.json()["errors"][0]["field"] == "Idempotency-Key"
    server.wait_ended(first.json()["id"])


def test_every_answer_tells_browsers_to_be_careful(client: httpx.Client, finished: dict[str, Any]) -> None:
    for path in ("/", "/docs", "/docs.css", "/healthz", "/api/jobs", "/api/nothing", f"/api/jobs/{finished['id']}"):
        headers = client.get(path).headers
        assert headers["X-Content-Type-Options"] == "nosniff", path
        policy = headers["Content-Security-Policy"]
        assert "unsafe" not in policy
        assert "frame-ancestors 'none'" in policy
        assert policy.startswith("default-src 'none'" if path.startswith("/api/") else "default-src 'self'"), path
        assert "server" not in headers
        assert "access-control-allow-origin" not in headers


def test_the_reference_names_every_operation_and_needs_no_other_site(client: httpx.Client) -> None:
    text = client.get("/docs").text
    for path in client.get("/api/openapi.json").json()["paths"]:
        assert path in text
    assert "<script" not in text
    assert "style=" not in text
    assert "http://" not in text
    assert "https://" not in text


def test_a_job_whose_picture_is_gone_says_what_was_lost(server: Server, client: httpx.Client) -> None:
    job = server.wait_ended(server.submit({"spp": 4})["id"])
    for path in (server.data_dir / "estimates" / job["id"]).iterdir():
        path.unlink()
    for picture in ("image.png", "image.exr", "frames/latest", "pixel?x=1&y=1"):
        answer = client.get(f"/api/jobs/{job['id']}/{picture}")
        assert (answer.status_code, answer.json()["title"]) == (410, "The saved picture is damaged")
        assert "its file is missing" in answer.json()["detail"]
