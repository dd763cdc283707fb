"""Hostile clients, one of each kind that was seen to stand in the way of others, until they are ended.

    python -m tests.crowd.hostile PORT KEY JOB,JOB… [KIND…]

A process of their own: they must not take the time of whoever measures. What they got is printed in the end, as JSON.
"""

from __future__ import annotations

import asyncio
import contextlib
import io
import itertools
import json
import signal
import sys
import zipfile
from collections.abc import Awaitable, Callable, Coroutine
from typing import Any

import httpx

_SCENE = """<scene version="3.0.0">{defaults}
<integrator type="path"><integer name="max_depth" value="{depth}"/></integrator>
<sensor type="perspective"><transform name="to_world"><lookat origin="0,0,0.5" target="0,0,0" up="0,1,0"/></transform>
<film type="hdrfilm"><integer name="width" value="128"/><integer name="height" value="128"/></film></sensor>
<emitter type="point"><point name="position" value="0,0.5,0"/></emitter>{shapes}</scene>"""
_ROOM = '<shape type="cube"><bsdf type="diffuse"><rgb name="reflectance" value="1"/></bsdf></shape>'
_UPLOAD = b"Content-Length: 50000000\r\nContent-Type: multipart/form-data; boundary=b\r\n\r\n"
_UPLOAD += b'--b\r\nContent-Disposition: form-data; name="file"; filename="a.xml"\r\n\r\n'


def scene(*, depth: int = 8, doublings: int = 0, spheres: int = 0) -> bytes:
    """A scene: a closed white room, a parameter that is doubled again and again, or very many shapes."""
    names = [f'<default name="a{i + 1}" value="$a{i}$a{i}"/>' for i in range(doublings)]
    defaults = '<default name="a0" value="xxxxxxxx"/>' + "".join(names) if doublings else ""
    return _SCENE.format(defaults=defaults, depth=depth, shapes=_ROOM + '<shape type="sphere"/>' * spheres).encode()


def zip_of(files: int = 0, inflated: int = 0) -> bytes:
    """A zip with a scene and very many folders, or a file that inflates."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as bundle:
        bundle.writestr("scene.xml", scene())
        for i in range(files):
            bundle.writestr(f"d{i}/e/f/g.txt", b"")
        if inflated:
            bundle.writestr("big.bin", bytes(inflated))
    return packed.getvalue()


class Hostile:
    """All kinds. done: how often each has got an answer."""

    def __init__(self, port: int, client: httpx.AsyncClient, key: str, finished: list[str]) -> None:
        self._port = port
        self._key = f"Host: 127.0.0.1\r\nAuthorization: Bearer {key}\r\n".encode()
        self._client = client
        self._finished = finished
        self.done: dict[str, int] = {}

    def kinds(self) -> dict[str, Callable[[], Coroutine[Any, Any, None]]]:
        """What there is, by name."""
        return {
            "deep room": self.deep_room,
            "Learn in a loop": self.learn,
            "frames of finished jobs": self.frames,
            "uploads that inflate or expand": self.uploads,
            "uploads that trickle": self.trickle,
            "readers who do not read": self.readers,
            "silent connections": self.silent,
            "many jobs": self.many_jobs,
        }

    def _count(self, kind: str) -> None:
        self.done[kind] = self.done.get(kind, 0) + 1

    async def _again(self, kind: str, call: Callable[[], Awaitable[Any]], pause: float = 0.0) -> None:
        while True:
            with contextlib.suppress(httpx.TransportError, OSError):
                await call()
                self._count(kind)
            await asyncio.sleep(pause)

    async def upload(self, content: bytes, name: str) -> httpx.Response:
        return await self._client.post("/api/scenes", files={"file": (name, content)}, timeout=120)

    async def deep_room(self) -> None:
        while not (taken := await self.upload(scene(depth=1_000_000), "room.xml")).is_success:
            await asyncio.sleep(1.0)  # its own other uploads are in its way
        body = {"scene": {"id": taken.json()["id"]}, "target": {"seconds": 3600}}
        await self._again("deep room", lambda: self._client.post("/api/jobs", json=body, timeout=30), 5.0)

    async def many_jobs(self) -> None:
        size = {"width": 1024, "height": 1024}
        body = {"scene": {"gallery": "cornell-box"}, "target": {"seconds": 3600}, "settings": size}
        await self._again("many jobs", lambda: self._client.post("/api/jobs", json=body, timeout=30), 1.0)

    async def learn(self) -> None:
        places = itertools.count()

        async def ask() -> None:
            x = next(places) % 200
            await self._client.get("/api/learn/cornell-box", params={"x": x, "y": 7, "n": 4096}, timeout=120)

        await asyncio.gather(*(self._again("Learn in a loop", ask) for _ in range(4)))

    async def frames(self) -> None:
        async def ask(job_id: str) -> None:
            for path in ("frames/latest", "frames/latest?scale=2&maps=1", "image.png?exposure=1", "image.exr"):
                await self._client.get(f"/api/jobs/{job_id}/{path}", timeout=120)

        await asyncio.gather(*(self._again("frames of finished jobs", lambda j=j: ask(j)) for j in self._finished))

    async def uploads(self) -> None:
        files = [
            (scene(doublings=40), "doubled.xml"),
            (scene(spheres=60_000), "spheres.xml"),
            (zip_of(files=20_000), "folders.zip"),
            (zip_of(inflated=200 << 20), "inflates.zip"),
        ]
        turns = itertools.cycle(files)
        ask = self._again("uploads that inflate or expand", lambda: self.upload(*next(turns)))
        await asyncio.gather(ask, self._again("uploads that inflate or expand", lambda: self.upload(*next(turns))))

    async def _line(self) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        return await asyncio.open_connection("127.0.0.1", self._port, limit=1 << 12)

    async def trickle(self) -> None:
        async def one() -> None:
            _, writer = await self._line()
            with contextlib.closing(writer):
                writer.write(b"POST /api/scenes HTTP/1.1\r\n" + self._key + _UPLOAD)
                for _ in range(600):
                    writer.write(b"x" * 100)
                    await writer.drain()
                    await asyncio.sleep(0.5)

        await asyncio.gather(*(self._again("uploads that trickle", one, 1.0) for _ in range(260)))

    async def readers(self) -> None:
        async def one(job_id: str) -> None:
            _, writer = await self._line()
            with contextlib.closing(writer):
                writer.transport.pause_reading()  # type: ignore[attr-defined]
                head = f"GET /api/jobs/{job_id}/frames/latest HTTP/1.1\r\n".encode()
                writer.write(head + self._key + b"\r\n")
                await asyncio.sleep(120)

        jobs = itertools.cycle(self._finished)
        await asyncio.gather(*(self._again("readers", lambda: one(next(jobs)), 1.0) for _ in range(60)))

    async def silent(self) -> None:
        async def one() -> None:
            reader, writer = await self._line()
            with contextlib.closing(writer):
                await reader.read()

        await asyncio.gather(*(self._again("silent connections", one, 0.5) for _ in range(500)))


async def _all(port: int, key: str, finished: list[str], only: list[str]) -> None:
    ended = asyncio.Event()
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, ended.set)
    headers = {"Authorization": f"Bearer {key}"}
    limits = httpx.Limits(max_connections=100)
    async with httpx.AsyncClient(base_url=f"http://127.0.0.1:{port}", headers=headers, limits=limits) as client:
        crowd = Hostile(port, client, key, finished)
        kinds = {name: kind for name, kind in crowd.kinds().items() if not only or name in only}
        tasks = [asyncio.create_task(kind(), name=name) for name, kind in kinds.items()]
        await ended.wait()
        for task in tasks:
            task.cancel()
        found = await asyncio.gather(*tasks, return_exceptions=True)
        failures = [f"{task.get_name()}: {one!r}" for task, one in zip(tasks, found, strict=True)]
        failures = [told for told, one in zip(failures, found, strict=True) if isinstance(one, Exception)]
    print(json.dumps({"done": crowd.done, "failures": failures}))


if __name__ == "__main__":
    asyncio.run(_all(int(sys.argv[1]), sys.argv[2], sys.argv[3].split(","), sys.argv[4:]))
