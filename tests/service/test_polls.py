"""The poll for a newer frame that is not there, answered before any routing."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import Any

import httpx
import pytest
from fastapi import FastAPI, Response
from service_process import LONG, Server

from service.access import caller_of
from service.clients import ANYONE, Caller, Role
from service.errors import ProblemError
from service.polls import NothingNewer


def asked(
    query: str, monkeypatch: pytest.MonkeyPatch, caller: Caller | None = ANYONE, job: str = "a"
) -> Response | str:
    """What is answered for the running job "a" of alice at frame 7; "routed" where the routes are to answer."""
    live = SimpleNamespace(progress=SimpleNamespace(frame_seq=7), record=SimpleNamespace(client_id="alice"))
    app = FastAPI()
    app.state.service = SimpleNamespace(runner=SimpleNamespace(live={"a": live}.get))

    async def who(*_: Any) -> Caller:
        if caller is None:
            raise ProblemError(401, "key-needed", "Who are you?", "A key is needed.")
        return caller

    monkeypatch.setattr(f"service.polls.{caller_of.__name__}", who)
    messages: list[Any] = ["routed"]

    async def route(*_: Any) -> Any:
        pass

    async def send(message: Any) -> None:
        messages.append(message)

    path = f"/api/jobs/{job}/frames/latest"
    scope = {"type": "http", "method": "GET", "path": path, "query_string": query.encode(), "headers": [], "app": app}
    asyncio.run(NothingNewer(route)(scope, route, send))
    if len(messages) == 1:
        return "routed"
    return Response(
        status_code=messages[1]["status"], headers={n.decode(): v.decode() for n, v in messages[1]["headers"]}
    )


@pytest.mark.parametrize("query", ["after=7", "after=9&scale=1", "after=7&scale=2&maps=1", "scale=1&after=7"])
def test_a_poll_that_finds_nothing_newer_reaches_no_route(query: str, monkeypatch: pytest.MonkeyPatch) -> None:
    found = asked(query, monkeypatch)
    assert isinstance(found, Response)
    assert (found.status_code, found.headers["x-frame-seq"]) == (204, "7")


@pytest.mark.parametrize("query", ["", "after=6", "after=-1", "after=7x", "after=7&scale=3", "after=7&after=8", "a=7"])
def test_all_else_is_left_to_the_routes(query: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert asked(query, monkeypatch) == "routed"
    assert asked("after=7", monkeypatch, job="b") == "routed"


def test_who_asks_is_looked_at_as_everywhere(monkeypatch: pytest.MonkeyPatch) -> None:
    refused = asked("after=7", monkeypatch, None)
    assert isinstance(refused, Response)
    assert refused.status_code == 401
    assert asked("after=7", monkeypatch, Caller("bob", Role.READ)) == "routed", "where it is unknown"
    assert asked("after=7", monkeypatch, Caller("alice", Role.READ)) != "routed"


def test_a_poll_over_http_says_the_same_as_its_route(server: Server, client: httpx.Client) -> None:
    job_id = server.submit(LONG)["id"]
    server.wait(job_id, lambda job: job["frame_seq"] > 0)
    path = f"/api/jobs/{job_id}/frames/latest"
    quick, routed = client.get(path, params={"after": 10**6}), client.get(path, params={"after": 10**16})
    server.cancel(job_id)
    assert quick.status_code == routed.status_code == 204
    assert int(quick.headers["x-frame-seq"]) >= 1
    assert {*quick.headers} == {*routed.headers}
