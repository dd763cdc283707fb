"""Who has a process that checks scenes: each client one at a time, and nobody waits for another's second."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import pytest
from service_process import PLAIN_SCENE, Server

from service.clients import Keys
from service.engine.inspectors import Inspectors, TooManyWaiting
from service.store import Database
from service.store.keys import KeyStore


class Line:
    """Uploads that begin and end when they are told to."""

    def __init__(self, folder: Path, at_once: int) -> None:
        self.inspectors = Inspectors(folder, at_once)
        self.began: list[str] = []
        self._ends: dict[str, asyncio.Event] = {}

    async def upload(self, name: str) -> None:
        self._ends[name] = asyncio.Event()
        async with self.inspectors.turn(name[0]):
            self.began.append(name)
            await self._ends[name].wait()

    async def begin(self, *names: str) -> list[asyncio.Task[None]]:
        tasks = []
        for name in names:
            tasks.append(asyncio.create_task(self.upload(name)))
            await asyncio.sleep(0)
        await self.settle()
        return tasks

    async def end(self, name: str) -> None:
        self._ends[name].set()
        await self.settle()

    async def settle(self) -> None:
        for _ in range(10):
            await asyncio.sleep(0)


def test_a_client_waits_for_itself_alone(tmp_path: Path) -> None:
    async def tried() -> list[str]:
        line = Line(tmp_path, 3)
        await line.begin("a1", "a2", "a3", "b1")
        assert line.began == ["a1", "b1"]
        await line.end("b1")
        assert line.began == ["a1", "b1"], "a free process is not for a client that has one"
        await line.end("a1")
        return line.began

    assert asyncio.run(tried()) == ["a1", "b1", "a2"]


def test_clients_take_turns_where_there_are_more_than_processes(tmp_path: Path) -> None:
    async def tried() -> list[str]:
        line = Line(tmp_path, 1)
        await line.begin("a1", "a2", "a3", "b1", "b2", "c1")
        for name in ("a1", "b1", "c1", "a2", "b2", "a3"):
            assert line.began[-1] == name
            await line.end(name)
        return line.began

    assert asyncio.run(tried()) == ["a1", "b1", "c1", "a2", "b2", "a3"]


def test_who_gives_up_leaves_nothing_taken(tmp_path: Path) -> None:
    async def tried() -> list[str]:
        line = Line(tmp_path, 1)
        first, second, third = await line.begin("a1", "b1", "c1")
        second.cancel()
        await line.settle()
        first.cancel()  # while it runs
        await line.settle()
        await line.end("c1")
        await third
        await line.begin("b2")
        return line.began

    assert asyncio.run(tried()) == ["a1", "c1", "b2"]


def test_a_process_given_at_the_moment_of_giving_up_is_given_on(tmp_path: Path) -> None:
    async def tried() -> list[str]:
        line = Line(tmp_path, 1)
        _, second, _ = await line.begin("a1", "b1", "c1")
        line._ends["a1"].set()
        while not line.inspectors._served & {"b"}:
            await asyncio.sleep(0)
        second.cancel()
        await line.settle()
        return line.began

    assert asyncio.run(tried()) == ["a1", "c1"]


def test_one_clients_line_has_an_end(tmp_path: Path) -> None:
    async def tried() -> None:
        line = Line(tmp_path, 1)
        tasks = await line.begin(*(f"a{i}" for i in range(22)))
        with pytest.raises(TooManyWaiting):
            await asyncio.wait_for(tasks[-1], 20)
        await line.begin("b1")
        for task in tasks:
            task.cancel()
        await line.settle()
        assert line.began[-1] == "b1"

    asyncio.run(tried())


@pytest.fixture(scope="module")
def keyed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Server, dict[str, dict[str, str]]]]:
    environment = {"FREDHOLM_API_KEYS": "on", "FREDHOLM_WARM_UP": "0"}
    server = Server(tmp_path_factory.mktemp("inspectors") / "data", environment).start(wait_until="/healthz")
    database = Database(f"sqlite:///{server.data_dir / 'fredholm.sqlite'}")
    keys = Keys(KeyStore(database), server.data_dir / "secret")
    heads = {name: {"Authorization": f"Bearer {keys.create(name, 'submit')[1]}"} for name in ("alice", "bob")}
    database.close()
    yield server, heads
    server.stop()


def upload(server: Server, headers: dict[str, str], content: str) -> httpx.Response:
    return httpx.post(f"{server.url}/api/scenes", files={"file": ("a.xml", content)}, headers=headers, timeout=300)


def test_an_upload_does_not_wait_for_another_clients(keyed: tuple[Server, dict[str, dict[str, str]]]) -> None:
    server, heads = keyed
    ball = '<shape type="sphere"><float name="radius" value="0.0{:04}"/></shape>'
    slow = PLAIN_SCENE.replace("</scene>", "".join(map(ball.format, range(1, 800))) + "</scene>")
    with ThreadPoolExecutor(4) as pool:
        alices = [pool.submit(upload, server, heads["alice"], slow + " " * i) for i in range(3)]
        bobs = upload(server, heads["bob"], PLAIN_SCENE)
        assert bobs.status_code == 201, bobs.text
        assert not all(answer.done() for answer in alices)
        assert {answer.result().status_code for answer in alices} == {201}
    assert len(set(server.render_pids(engine="inspect"))) == 2, "one for each client"


def test_no_answer_tells_that_someone_else_has_the_scene(keyed: tuple[Server, dict[str, dict[str, str]]]) -> None:
    server, heads = keyed
    content = PLAIN_SCENE.replace("0.4", "0.41")
    statuses = [upload(server, heads[who], content).status_code for who in ("alice", "bob", "alice", "bob")]
    assert statuses == [201, 201, 200, 200]
