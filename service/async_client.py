"""The client's twin for asyncio: the same methods, awaited.

    client = AsyncClient("http://127.0.0.1:8017")
    job = await client.submit("cornell-box", error=0.02)
    async for progress in client.watch(job.id):
        print(progress.error)

Each request is the client's own, in a thread: what is tried again, and how, stands once. A request that is cancelled is
no more waited for, and may still have been done. A watch that is left ends its connection.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
import threading
from collections.abc import AsyncGenerator
from http.client import HTTPResponse
from pathlib import Path
from typing import Any

from service.client import Client
from service.messages import Job, JobDetail, ProgressMessage, Scene
from service.states import State

News = Job | ProgressMessage


class AsyncClient:
    """One service; see Client for what each method takes, answers and raises."""

    def __init__(self, url: str = "http://127.0.0.1:8017", key: str | None = None, timeout: float = 30.0) -> None:
        self._client = Client(url, key, timeout)
        self._arguments = (url, key, timeout)

    async def submit(
        self,
        scene: str | Path,
        *,
        error: float | None = None,
        seconds: float | None = None,
        spp: int | None = None,
        priority: int = 0,
        **settings: Any,
    ) -> JobDetail:
        """Queue a picture."""
        return await asyncio.to_thread(
            self._client.submit, scene, error=error, seconds=seconds, spp=spp, priority=priority, **settings
        )

    async def upload(self, path: str | Path) -> Scene:
        """Upload a scene; the same content again is the same scene."""
        return await asyncio.to_thread(self._client.upload, path)

    async def job(self, job_id: str) -> JobDetail:
        """One job as it is now."""
        return await asyncio.to_thread(self._client.job, job_id)

    async def jobs(self, limit: int = 100, *states: State, before: str | None = None) -> list[Job]:
        """The newest jobs."""
        return await asyncio.to_thread(self._client.jobs, limit, *states, before=before)

    async def pause(self, job_id: str) -> JobDetail:
        """Take a job from the renderer until it is resumed."""
        return await asyncio.to_thread(self._client.pause, job_id)

    async def resume(self, job_id: str) -> JobDetail:
        """Let a paused job go on."""
        return await asyncio.to_thread(self._client.resume, job_id)

    async def cancel(self, job_id: str) -> JobDetail:
        """End a job and keep its picture."""
        return await asyncio.to_thread(self._client.cancel, job_id)

    async def go_on(self, job_id: str, **target: float) -> JobDetail:
        """Continue a job that has ended to a tighter target: error, seconds, spp."""
        return await asyncio.to_thread(self._client.go_on, job_id, **target)

    async def delete(self, job_id: str) -> None:
        """Forget a job with its pictures."""
        await asyncio.to_thread(self._client.delete, job_id)

    async def watch(self, job_id: str, patience_seconds: float = 600.0) -> AsyncGenerator[News, None]:
        """The job now, then its progress and changes of state, until it has ended.

        Leave it early within `contextlib.aclosing`, or by cancelling its task: both end the connection at once.
        """
        loop, told = asyncio.get_running_loop(), asyncio.Queue[News | BaseException | None]()
        client = _Stoppable(*self._arguments)

        def tell(what: News | BaseException | None) -> None:
            with contextlib.suppress(RuntimeError):  # the loop has closed: nobody listens any more
                loop.call_soon_threadsafe(told.put_nowait, what)

        def follow() -> None:
            try:
                for news in client.watch(job_id, patience_seconds):
                    tell(news)
                tell(None)
            except BaseException as error:
                tell(error)

        # A thread of its own, not one of the few that asyncio lends: a watch may last for days.
        threading.Thread(target=follow, name=f"watch {job_id}", daemon=True).start()
        try:
            while (news := await told.get()) is not None:
                if isinstance(news, BaseException):
                    raise news
                yield news
        finally:
            client.stop()

    async def wait(self, job_id: str) -> JobDetail:
        """The job once it has ended."""
        async for _ in self.watch(job_id):
            pass
        return await self.job(job_id)

    async def download(self, job_id: str, path: str | Path, *, with_moments: bool = True) -> Path:
        """Save the image: .exr with all that is known, .png to look at."""
        return await asyncio.to_thread(self._client.download, job_id, path, with_moments=with_moments)


class _Stopped(Exception):
    """Nobody listens any more."""


class _Stoppable(Client):
    """A client whose open answer another thread can end."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._lock, self._stopped, self._answer = threading.Lock(), False, None

    def stop(self) -> None:
        with self._lock:
            self._stopped = True
            if self._answer is None or self._answer.closed:
                return
            with contextlib.suppress(OSError, ValueError):  # it has just ended by itself
                with socket.fromfd(self._answer.fileno(), socket.AF_INET, socket.SOCK_STREAM) as connection:
                    connection.shutdown(socket.SHUT_RDWR)

    def _open(self, *arguments: Any, **options: Any) -> HTTPResponse:
        if self._stopped:
            raise _Stopped
        answer = super()._open(*arguments, **options)
        with self._lock:
            if self._stopped:
                answer.close()
                raise _Stopped
            # A question asked while the stream is open must not take its place.
            if self._answer is None or self._answer.closed:
                self._answer = answer
        return answer
