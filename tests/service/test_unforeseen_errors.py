"""A mistake of the service itself: one problem body with all headers, counted, and nothing of its insides."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace

import httpx
import pytest
from fastapi import FastAPI
from sqlalchemy.exc import OperationalError

from service.app import protect
from service.errors import shown_path
from service.metrics import Metrics
from service.settings import ServiceSettings


@pytest.fixture
def metrics() -> Metrics:
    return Metrics()


def asked(path: str, metrics: Metrics) -> httpx.Response:
    app = FastAPI()
    app.state.service = SimpleNamespace(metrics=metrics)
    protect(app, ServiceSettings(api_keys="on"))

    @app.get("/api/bug")
    def bug() -> None:
        raise KeyError("/secret/path")

    @app.get("/api/database")
    def database() -> None:
        raise OperationalError("SELECT secret", {}, Exception("/secret/path"))

    async def ask() -> httpx.Response:
        async with httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://localhost") as client:
            return await client.get(path)

    return asyncio.run(ask())


@pytest.mark.parametrize(("path", "status"), [("/api/bug", 500), ("/api/database", 503)])
def test_a_mistake_is_answered_like_anything_else(path: str, status: int, metrics: Metrics) -> None:
    answer = asked(path, metrics)
    assert answer.status_code == status == answer.json()["status"]
    assert answer.headers["Content-Type"] == "application/problem+json"
    assert "secret" not in answer.text
    assert answer.headers["X-Request-ID"]
    assert answer.headers["X-Frame-Options"] == "DENY"
    assert metrics.registry.get_sample_value("fredholm_answer_seconds_count", {"method": "GET", "status": str(status)})
    assert ("Retry-After" in answer.headers) == (status == 503)


def test_what_the_end_of_the_service_cuts_is_told_to_come_again(metrics: Metrics) -> None:
    app = FastAPI()
    app.state.service = SimpleNamespace(metrics=metrics)
    protect(app, ServiceSettings(api_keys="on"))
    begun = asyncio.Event()

    @app.get("/api/long")
    async def long() -> None:
        begun.set()
        await asyncio.Event().wait()

    async def ask() -> httpx.Response:
        async with httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://localhost") as client:
            asking = asyncio.create_task(client.get("/api/long"))
            await begun.wait()
            asking.cancel()  # as uvicorn does when its patience ends
            return await asking

    answer = asyncio.run(ask())
    assert (answer.status_code, answer.json()["title"]) == (503, "The service is stopping")
    assert answer.headers["Retry-After"] == "5"
    assert answer.headers["X-Request-ID"]


def test_an_address_cannot_write_lines_into_the_log() -> None:
    scope = {"path": "/a\n\x1b[2Jall is well", "raw_path": b"/a%0a%1b[2Jall\x9b"}
    assert shown_path(scope) == "/a%0a%1b[2Jall\\x9b"
