"""Who may do what: every route of the API tried with every role, and with other clients' jobs."""

from __future__ import annotations

import asyncio
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from event_stream import EventStream
from service_process import LONG, PLAIN_SCENE, ROOT, SMALL, Server, wait_for

from service.clients import Keys
from service.store import Database
from service.store.keys import KeyStore

ROLES = {"nobody": 0, "read": 1, "submit": 2, "admin": 3}
# The role that each operation needs; 0: everyone may ask. A new route must be named here.
NEEDED = {
    "GET /healthz": 0,
    "GET /readyz": 0,
    "GET /metrics": 3,
    "GET /api/session": 1,
    "POST /api/session": 0,
    "DELETE /api/session": 0,
    "GET /api/gallery": 1,
    "GET /api/gallery/{name}/requirements": 1,
    "GET /api/gallery/{name}/thumbnail.png": 1,
    "GET /api/scenes": 1,
    "POST /api/scenes": 2,
    "GET /api/scenes/{scene_id}": 1,
    "DELETE /api/scenes/{scene_id}": 2,
    "GET /api/jobs": 1,
    "POST /api/jobs": 2,
    "GET /api/jobs/{job_id}": 1,
    "DELETE /api/jobs/{job_id}": 2,
    "POST /api/jobs/{job_id}/pause": 2,
    "POST /api/jobs/{job_id}/resume": 2,
    "POST /api/jobs/{job_id}/cancel": 2,
    "POST /api/jobs/{job_id}/continue": 2,
    "GET /api/jobs/{job_id}/frames/latest": 1,
    "GET /api/jobs/{job_id}/pixel": 1,
    "GET /api/jobs/{job_id}/image.exr": 1,
    "GET /api/jobs/{job_id}/checkpoint.exr": 1,
    "GET /api/jobs/{job_id}/image.png": 1,
    "POST /api/series": 2,
    "GET /api/series/{series_id}": 1,
    "POST /api/series/{series_id}/cancel": 2,
    "GET /api/series/{series_id}/images.zip": 1,
    "GET /api/integral": 1,
    "GET /api/integral/runs": 1,
    "GET /api/learn/{scene}": 1,
    "GET /api/learn/{scene}/incident": 1,
    "GET /api/learn/{scene}/kernel": 1,
    "GET /api/learn/{scene}/bounces": 1,
    "GET /api/learn/{scene}/paths": 1,
    "GET /api/learn/{scene}/light-points": 1,
    "GET /api/learn/{scene}/samples": 1,
    "GET /api/learn/{scene}/picture.png": 1,
    "GET /api/learn/{scene}/trade": 1,
    "GET /api/learn/{scene}/kernels": 1,
    "GET /api/extremes/{name}": 1,
    "GET /api/events": 1,
}
BOX = {"scene": {"gallery": "cornell-box"}, "settings": SMALL}


@pytest.fixture(scope="module")
def keyed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Server, dict[str, str]]]:
    """A service that asks for keys, and keys of each role; bob is a second client that may submit."""
    server = Server(
        tmp_path_factory.mktemp("keyed") / "data",
        {
            "FREDHOLM_API_KEYS": "on",
            "FREDHOLM_WARM_UP": "0",
            "FREDHOLM_MAX_STREAMS_PER_CLIENT": "2",
            "FREDHOLM_MAX_WAITING_PER_CLIENT": "3",
            "FREDHOLM_MAX_RUNNING_JOBS": "1",
            "FREDHOLM_REQUESTS_BURST": "150",
            "FREDHOLM_PING_SECONDS": "2",
            "FREDHOLM_REQUESTS_PER_SECOND": "40",
        },
    ).start()
    database = Database(f"sqlite:///{server.data_dir / 'fredholm.sqlite'}")
    keys = Keys(KeyStore(database), server.data_dir / "secret")
    made = {role: keys.create(f"{role}er", role)[1] for role in ("read", "submit", "admin")}
    made["bob"] = keys.create("bob", "submit")[1]
    made["alice-reads"] = keys.create("submiter", "read")[1]
    database.close()
    yield server, made
    server.stop()


def ask(keyed: tuple[Server, dict[str, str]], who: str, method: str, path: str, **more: Any) -> httpx.Response:
    server, keys = keyed
    headers = {"Authorization": f"Bearer {keys[who]}"} if who in keys else {}
    return httpx.request(method, server.url + path, headers=headers | more.pop("headers", {}), timeout=30, **more)


def test_every_operation_of_the_api_is_in_the_table(keyed: tuple[Server, dict[str, str]]) -> None:
    described = ask(keyed, "nobody", "GET", "/api/openapi.json").json()
    operations = {f"{method.upper()} {path}" for path, methods in described["paths"].items() for method in methods}
    assert operations == set(NEEDED)


@pytest.mark.parametrize("operation", [one for one in NEEDED if one != "GET /api/events"])
@pytest.mark.parametrize("role", ROLES)
def test_a_role_may_do_what_the_table_says(keyed: tuple[Server, dict[str, str]], operation: str, role: str) -> None:
    method, _, path = operation.partition(" ")
    path = path.format(name="cornell-box", scene="nothere", scene_id="nothere", job_id="nothere", series_id="0") + (
        "?x=0&y=0" * path.endswith("pixel")
    )
    body = {"key": "x"} if operation == "POST /api/session" else {"target": {"spp": 1}}
    answer = ask(keyed, role, method, path, json=body if method == "POST" else None)
    if ROLES[role] >= NEEDED[operation]:
        assert answer.status_code != 403
        assert answer.status_code != 401 or operation == "POST /api/session"
        assert answer.status_code < 500 or path == "/readyz"
    else:
        assert answer.status_code == (401 if role == "nobody" else 403)
        assert answer.headers["Content-Type"] == "application/problem+json"
        assert "x-frame-options" in answer.headers


def test_streams_need_a_key(keyed: tuple[Server, dict[str, str]]) -> None:
    assert ask(keyed, "nobody", "GET", "/api/events").status_code == 401


def test_a_client_sees_and_changes_only_its_own_jobs(keyed: tuple[Server, dict[str, str]]) -> None:
    job = ask(keyed, "submit", "POST", "/api/jobs", json=BOX | {"target": LONG}).json()
    for method, path in [one.split(" ") for one in NEEDED if "{job_id}" in one]:
        address = path.format(job_id=job["id"]) + ("?x=0&y=0" * path.endswith("pixel"))
        body = {"target": {"spp": 10**6}} if method == "POST" else None
        assert ask(keyed, "bob", method, address, json=body).status_code == 404, path
    listed = {who: ask(keyed, who, "GET", "/api/jobs").json()["jobs"] for who in ("submit", "bob", "admin", "read")}
    sees = {who: job["id"] in [one["id"] for one in jobs] for who, jobs in listed.items()}
    assert sees == {"submit": True, "bob": False, "admin": True, "read": False}
    # Another key of the same client may read it, and change nothing.
    assert ask(keyed, "alice-reads", "GET", f"/api/jobs/{job['id']}").status_code == 200
    assert ask(keyed, "alice-reads", "POST", f"/api/jobs/{job['id']}/cancel").status_code == 403
    assert ask(keyed, "admin", "POST", f"/api/jobs/{job['id']}/cancel").json()["state"] == "cancelled"


def test_a_stream_tells_of_own_jobs_only(keyed: tuple[Server, dict[str, str]]) -> None:
    server, keys = keyed
    with EventStream(server.url, key=keys["submit"]) as own, EventStream(server.url, key=keys["bob"]) as others:
        job = ask(keyed, "submit", "POST", "/api/jobs", json=BOX | {"target": {"spp": 4}}).json()
        own.wait(lambda events: any(e.kind == "job" and e.data["state"] == "succeeded" for e in events))
        mine = ask(keyed, "bob", "POST", "/api/jobs", json=BOX | {"target": {"spp": 4}}).json()
        others.wait(lambda events: any(e.kind == "job" and e.data["id"] == mine["id"] for e in events))
        assert not [event for event in others.events if event.data.get("id") == job["id"]]


def test_streams_of_one_client_have_a_limit(keyed: tuple[Server, dict[str, str]]) -> None:
    server, keys = keyed
    wait_for(lambda: ask(keyed, "admin", "GET", "/metrics").text.count("fredholm_event_streams 0.0") == 1, 60, "quiet")
    with EventStream(server.url, key=keys["bob"]), EventStream(server.url, key=keys["bob"]):
        refused = ask(keyed, "bob", "GET", "/api/events")
        assert refused.status_code == 429
        assert refused.headers["Retry-After"]
        with EventStream(server.url, key=keys["submit"]):
            pass


def test_streams_opened_at_once_are_counted_one_by_one(keyed: tuple[Server, dict[str, str]]) -> None:
    server, keys = keyed

    async def open_all() -> list[int]:
        async with httpx.AsyncClient(base_url=server.url, timeout=30) as client:
            client.headers["Authorization"] = f"Bearer {keys['bob']}"
            requests = [client.build_request("GET", "/api/events") for _ in range(20)]
            answers = await asyncio.gather(*(client.send(request, stream=True) for request in requests))
            for answer in answers:
                await answer.aclose()
            return [answer.status_code for answer in answers]

    assert sorted(asyncio.run(open_all())) == [200] * 2 + [429] * 18


def test_a_stream_ends_when_its_key_is_revoked(keyed: tuple[Server, dict[str, str]]) -> None:
    server, _ = keyed
    database = Database(f"sqlite:///{server.data_dir / 'fredholm.sqlite'}")
    store = KeyStore(database)
    record, key = Keys(store, server.data_dir / "secret").create("carol", "read")
    with EventStream(server.url, key=key) as stream:
        assert store.revoke(record.id)
        assert stream.is_over.wait(60)
    database.close()


def test_queued_jobs_of_one_client_have_a_limit(keyed: tuple[Server, dict[str, str]]) -> None:
    def state(who: str, job_id: str) -> str:
        return ask(keyed, who, "GET", f"/api/jobs/{job_id}").json()["state"]

    made = [ask(keyed, "bob", "POST", "/api/jobs", json=BOX | {"target": LONG})]
    # Once it has the one slot, all others wait and nothing about them changes by itself.
    wait_for(lambda: state("bob", made[0].json()["id"]) == "running", 60, "the first job in its slot")
    made += [ask(keyed, "bob", "POST", "/api/jobs", json=BOX | {"target": LONG}) for _ in range(5)]
    assert {answer.status_code for answer in made} == {201, 429}
    assert "the limit of one client" in made[-1].json()["detail"]
    # Nor can it be passed by: a paused job does not wait, and must find room when it is resumed.
    waiting = made[1].json()["id"]
    assert ask(keyed, "bob", "POST", f"/api/jobs/{waiting}/pause").json()["state"] == "paused"
    made.append(ask(keyed, "bob", "POST", "/api/jobs", json=BOX | {"target": LONG}))
    assert made[-1].status_code == 201
    assert ask(keyed, "bob", "POST", f"/api/jobs/{waiting}/resume").status_code == 429
    other = ask(keyed, "submit", "POST", "/api/jobs", json=BOX | {"target": {"spp": 4}})
    assert other.status_code == 201

    # The one slot is bob's, and a client without a running job need not wait for it.
    wait_for(lambda: state("submit", other.json()["id"]) == "succeeded", 60, "the other client's job")
    for answer in made:
        if answer.status_code == 201:
            ask(keyed, "bob", "POST", f"/api/jobs/{answer.json()['id']}/cancel")


def test_uploaded_scenes_are_seen_by_who_uploaded_them(keyed: tuple[Server, dict[str, str]]) -> None:
    for who, name in (("submit", "mine.xml"), ("bob", "also-mine.xml")):
        answer = ask(keyed, who, "POST", "/api/scenes", files={"file": (name, PLAIN_SCENE)})
        assert answer.status_code in (200, 201), answer.text
        scene_id = answer.json()["id"]
    assert [scene["name"] for scene in ask(keyed, "bob", "GET", "/api/scenes").json()] == ["also-mine"]
    assert ask(keyed, "submit", "GET", f"/api/scenes/{scene_id}").json()["name"] == "mine"
    assert ask(keyed, "read", "GET", "/api/scenes").json() == []
    assert ask(keyed, "read", "GET", f"/api/scenes/{scene_id}").status_code == 404
    # Who deletes an upload leaves the other's alone, and the last one takes the content along.
    address = f"/api/scenes/{scene_id}"
    assert [ask(keyed, "submit", "DELETE", address).status_code for _ in range(2)] == [204, 404]
    assert ask(keyed, "bob", "GET", address).json()["name"] == "also-mine"
    assert (keyed[0].data_dir / "scenes" / scene_id).is_dir()
    assert ask(keyed, "bob", "DELETE", address).status_code == 204
    assert ask(keyed, "admin", "GET", address).status_code == 404
    assert not (keyed[0].data_dir / "scenes" / scene_id).exists()


def test_a_browser_keeps_its_key_in_a_cookie_that_scripts_cannot_read(keyed: tuple[Server, dict[str, str]]) -> None:
    server, keys = keyed
    with httpx.Client(base_url=server.url, timeout=30) as browser:
        assert browser.get("/").headers["Location"] == "login"
        assert 'action="login"' in browser.get("/login").text
        assert browser.post("/login", data={"key": "wrong"}).status_code == 401
        entered = browser.post("/login", data={"key": keys["read"]})
        assert entered.status_code == 303
        cookie = entered.headers["Set-Cookie"]
        assert "HttpOnly" in cookie
        assert "SameSite=strict" in cookie
        assert browser.get("/").status_code == 200
        assert browser.get("/api/session").json() == {"client": "reader", "role": "read", "keys_required": True}
        assert browser.delete("/api/session").status_code == 204
        assert browser.get("/api/session").status_code == 401
    answer = ask(keyed, "nobody", "POST", "/api/session", json={"key": keys["admin"]})
    assert answer.json()["role"] == "admin"
    assert "fredholm_key" in answer.cookies


def test_who_asks_too_often_is_told_when_to_come_back(keyed: tuple[Server, dict[str, str]]) -> None:
    with httpx.Client(base_url=keyed[0].url, headers={"Authorization": f"Bearer {keyed[1]['read']}"}) as client:
        answers = [client.get("/api/session") for _ in range(400)]
    refused = [answer for answer in answers if answer.status_code == 429]
    assert refused
    assert int(refused[0].headers["Retry-After"]) >= 1
    assert refused[0].headers["Content-Type"] == "application/problem+json"


def test_guessing_keys_is_slow(keyed: tuple[Server, dict[str, str]]) -> None:
    with httpx.Client(base_url=keyed[0].url, headers={"Authorization": "Bearer frd_wrong"}) as client:
        statuses = [client.get("/api/session").status_code for _ in range(100)]
    assert set(statuses) == {401, 429}


def test_without_keys_a_service_listens_on_loopback_only(tmp_path: Path) -> None:
    code = (
        "import sys, pathlib; from service.serve import ServeError, run\n"
        "try: run('0.0.0.0', 0, pathlib.Path(sys.argv[1]), False)\n"
        "except ServeError as error: print(error)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "data")],
        capture_output=True,
        text=True,
        timeout=60,
        env={"PYTHONPATH": str(ROOT), "FREDHOLM_API_KEYS": "off", "HOME": str(tmp_path)},
    )
    assert "fredholm key create" in done.stdout
    assert not (tmp_path / "data").exists()


def test_without_keys_only_names_of_this_machine_are_answered(server: Server) -> None:
    answer = httpx.get(f"{server.url}/api/jobs", headers={"Host": "rebound.example"})
    assert answer.status_code == 421
    assert httpx.get(f"{server.url}/api/jobs", headers={"Host": "localhost:1"}).status_code == 200
