"""What a request can reach: the parts of one running service, put together in one place."""

from __future__ import annotations

import asyncio
import os
import secrets
import shutil
import socket
from typing import Annotated

import structlog
from fastapi import Depends, Request
from sqlalchemy.exc import SQLAlchemyError

from service.clients import Keys, RateLimit
from service.data_lock import DataLock
from service.engine.embedded import EmbeddedEngine
from service.estimates import EstimateFiles
from service.frames import FrameCache
from service.housekeeping import Housekeeping
from service.hub import Hub
from service.job_texts import JobTexts
from service.lease import Lease
from service.metrics import Metrics
from service.runner import Runner
from service.settings import ServiceSettings
from service.store import Database, JobRecord, JobStore, SceneStore
from service.store.keys import KeyStore
from service.uploads import Uploads

_ATTEMPTS_PER_SECOND, _ATTEMPTS_AT_ONCE = 1.0, 50
_LITTLE_SPACE_BYTES = 256 << 20


class Service:
    """The parts.

    `start` before the first request, `close_streams` when the server is to stop, `stop` at the end.
    """

    def __init__(self, settings: ServiceSettings) -> None:
        self.settings = settings
        self.id = secrets.token_hex(8)
        self.metrics = Metrics()
        self.database = Database(settings.resolved_database_url)
        self.jobs = JobStore(self.database)
        self.scenes = SceneStore(self.database)
        self.keys = Keys(KeyStore(self.database), settings.secret_file)
        self.requests = RateLimit(settings.requests_per_second, settings.requests_burst)
        self.failed_attempts = RateLimit(_ATTEMPTS_PER_SECOND, _ATTEMPTS_AT_ONCE)
        self.files = EstimateFiles(settings.estimates_dir)
        self.hub = Hub(self.jobs)
        self.frames = FrameCache()
        self.job_texts = JobTexts()
        self.uploads = Uploads(settings, self.scenes)
        self.engine = EmbeddedEngine(displays=self.files.displays)
        place = f"{socket.gethostname()}:{settings.data_dir.resolve()}"
        lease = Lease(self.jobs, place, self.id, settings.lease_seconds)
        self.runner = Runner(
            settings, self.jobs, self.engine, self.hub, self.files, lease, self.metrics, self._scene_path
        )
        self.hub.expected_start = self.runner.expected_start
        self._housekeeping = Housekeeping(settings, self.jobs, self.uploads, self.runner, self.metrics)
        self._lock = DataLock(settings.data_dir)
        self._log = structlog.get_logger("service")

    async def start(self) -> None:
        """Take the data folder, bring the tables up and go on with what was running."""
        self.settings.data_dir.mkdir(parents=True, exist_ok=True)
        self._lock.take()
        await asyncio.to_thread(self.database.create_tables)
        await asyncio.to_thread(self.database.belong_to, self.settings.data_identity())
        self.files.prepare()
        await asyncio.to_thread(self.uploads.prepare)
        await self.hub.start()
        await self.runner.start()
        self._housekeeping.start()
        if self.settings.are_keys_required and not await asyncio.to_thread(self.keys.any_in_use):
            self._log.warning("no API key exists yet, so nobody can ask anything: fredholm key create NAME")

    def not_ready(self) -> list[str]:
        """What keeps jobs from starting at once; empty if nothing does. Synchronous: call it from a thread."""
        missing: list[str] = []
        try:
            self.jobs.last_event_id()
        except SQLAlchemyError:
            missing.append("the database does not answer")
        folder = self.settings.estimates_dir
        if not os.access(folder, os.W_OK):
            missing.append("the folder of estimates cannot be written")
        elif shutil.disk_usage(folder).free < _LITTLE_SPACE_BYTES:
            missing.append(f"less than {_LITTLE_SPACE_BYTES >> 20} MiB of disk space are left")
        if self.runner.renderer_state != "warm":
            missing.append(f"the renderer is {self.runner.renderer_state}")
        return missing

    def close_streams(self) -> None:
        """End all event streams."""
        self.hub.close()

    async def stop(self) -> None:
        """Save what runs, end the processes, close the database."""
        self.close_streams()
        await self._housekeeping.stop()
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


async def _service(request: Request) -> Service:
    # Not a plain function: FastAPI would have every request wait for a thread to call it.
    return request.app.state.service


ServiceContext = Annotated[Service, Depends(_service)]
