"""What a request can reach: the parts of one running service, put together in one place."""

from __future__ import annotations

import asyncio
import secrets
from typing import Annotated

from fastapi import Depends, Request

from service.data_lock import DataLock
from service.engine.local import LocalEngine
from service.estimates import EstimateFiles
from service.frames import FrameCache
from service.hub import Hub
from service.runner import Runner
from service.settings import ServiceSettings
from service.store import Database, JobRecord, JobStore, SceneStore
from service.uploads import Uploads


class Service:
    """The parts.

    `start` before the first request, `close_streams` when the server is to stop, `stop` at the end.
    """

    def __init__(self, settings: ServiceSettings) -> None:
        self.settings = settings
        self.id = secrets.token_hex(8)
        self.database = Database(settings.resolved_database_url)
        self.jobs = JobStore(self.database)
        self.scenes = SceneStore(self.database)
        self.files = EstimateFiles(settings.estimates_dir)
        self.hub = Hub(self.jobs)
        self.frames = FrameCache()
        self.uploads = Uploads(settings, self.scenes)
        self.engine = LocalEngine("render", self.files.displays)
        self.runner = Runner(settings, self.jobs, self.engine, self.hub, self.files, self._scene_path)
        self._lock = DataLock(settings.data_dir)

    async def start(self) -> None:
        """Take the data folder, bring the tables up and go on with what was running."""
        self.settings.data_dir.mkdir(parents=True, exist_ok=True)
        self._lock.take()
        await asyncio.to_thread(self.database.create_tables)
        self.files.prepare()
        self.uploads.prepare()
        await self.hub.start()
        await self.runner.start()

    def close_streams(self) -> None:
        """End all event streams."""
        self.hub.close()

    async def stop(self) -> None:
        """Save what runs, end the processes, close the database."""
        self.close_streams()
        await self.runner.stop()
        self.uploads.close()
        self.database.close()
        self._lock.release()

    def _scene_path(self, job: JobRecord) -> str:
        """What the renderer is to load: a gallery name or a file."""
        if job.scene_kind == "gallery":
            return job.scene_ref
        scene = self.scenes.get(job.scene_ref)
        return str(self.settings.scenes_dir / (scene.path if scene else job.scene_ref))


def _service(request: Request) -> Service:
    return request.app.state.service


ServiceContext = Annotated[Service, Depends(_service)]
