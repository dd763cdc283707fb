"""The client's asyncio twin against the real service."""

from __future__ import annotations

import asyncio
import inspect
import threading
import time
from contextlib import aclosing
from pathlib import Path

import pytest
from service_process import SMALL, Server

from service.async_client import AsyncClient
from service.client import Client, ServiceError, ServiceUnreachable


def public(kind: type) -> dict[str, list[inspect.Parameter]]:
    methods = inspect.getmembers(kind, inspect.isfunction)
    return {
        name: list(inspect.signature(method).parameters.values())
        for name, method in methods
        if name == "__init__" or not name.startswith("_")
    }


def test_the_twin_has_each_method_with_the_same_parameters() -> None:
    assert public(AsyncClient) == public(Client)


def test_two_jobs_side_by_side(server: Server, tmp_path: Path) -> None:
    async def one(client: AsyncClient, seed: int) -> None:
        job = await client.submit("cornell-box", spp=64, **{**SMALL, "seed": seed})
        told = [news async for news in client.watch(job.id)]
        assert told[-1].state == "succeeded"
        picture = await client.download(job.id, tmp_path / f"{seed}.png")
        assert picture.read_bytes().startswith(b"\x89PNG")
        assert (await client.wait(job.id)).stopped_by == "spp"
        assert job.id in [known.id for known in await client.jobs()]
        await client.delete(job.id)
        with pytest.raises(ServiceError, match="No such job"):
            await client.job(job.id)

    async def both() -> None:
        client = AsyncClient(server.url)
        await asyncio.gather(one(client, 1), one(client, 2))

    asyncio.run(both())


def watching(job_id: str) -> bool:
    return any(thread.name == f"watch {job_id}" for thread in threading.enumerate())


def gone(job_id: str) -> bool:
    until = time.monotonic() + 60
    while watching(job_id) and time.monotonic() < until:
        time.sleep(0.02)
    return not watching(job_id)


@pytest.mark.parametrize("cancelled", [False, True])
def test_a_watch_that_is_left_ends_its_connection(server: Server, cancelled: bool) -> None:
    async def leave() -> str:
        client = AsyncClient(server.url)
        job = await client.submit("cornell-box", seconds=600, **SMALL)

        # A paused job has no news: the thread can only end by the end of its connection.
        async def look() -> None:
            async with aclosing(client.watch(job.id)) as news:
                async for one in news:
                    if one.state == "paused":
                        if not cancelled:
                            return
                        quiet.set()

        quiet = asyncio.Event()
        await client.pause(job.id)
        task = asyncio.create_task(look())
        if cancelled:
            await quiet.wait()
            assert watching(job.id)
            task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await task
        else:
            await task
        assert await asyncio.to_thread(gone, job.id)
        return job.id

    Client(server.url).delete(asyncio.run(leave()))


def test_no_service_is_told() -> None:
    async def look() -> None:
        async for _ in AsyncClient("http://127.0.0.1:9").watch("job", patience_seconds=0):
            pass

    with pytest.raises((ServiceUnreachable, OSError), match="does not answer"):
        asyncio.run(look())
