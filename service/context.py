"""What a request can reach: the parts of one running service, put together in one place."""

from __future__ import annotations

import asyncio
import os
import secrets
import socket
from collections import Counter
from typing import TYPE_CHECKING, Annotated

import structlog
from fastapi import Depends, Request
from sqlalchemy.exc import SQLAlchemyError

from service.accountant import Accountant, Need, reckon
from service.admission import Admission
from service.clients import Keys, RateLimit
from service.data_folder import make_folder, open_database
from service.data_lock import DataLock
from service.engine.embedded import EmbeddedEngine
from service.engine.inspectors import AT_ONCE
from service.estimates import EstimateFiles
from service.frames import FrameCache
from service.housekeeping import Housekeeping
from service.hub import Hub
from service.job_texts import JobTexts
from service.lease import Lease
from service.metrics import Metrics
from service.picture_room import PictureRoom
from service.quarantine import Quarantine
from service.room import Disk
from service.runner import Runner
from service.settings import ServiceSettings
from service.states import ENDED, State
from service.store import Database, DatabaseReplaced, JobRecord, JobStore, SceneDamaged, SceneStore
from service.store.keys import KeyStore
from service.store.threads import reading
from service.store.webhooks import WebhookStore
from service.uploads import Uploads
from service.webhooks import Messenger

if TYPE_CHECKING:
    from service.cluster.gate import Gate

_ATTEMPTS_PER_SECOND, _ATTEMPTS_AT_ONCE = 1.0, 50
_LITTLE_SPACE_BYTES = 256 << 20
UNFINISHED = frozenset(State) - ENDED
_MOST_UNFINISHED = 100_000
_LESSON_BYTES = 16 << 20  # of answers of the Learn view, kept


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
        self.bodies: Counter[str] = Counter()  # large ones that are on their way, by client
        self.failed_attempts = RateLimit(_ATTEMPTS_PER_SECOND, _ATTEMPTS_AT_ONCE)  # by address
        self.failed_keys = RateLimit(_ATTEMPTS_PER_SECOND, _ATTEMPTS_AT_ONCE)  # by the key's id, wherever it comes from
        self.disk = Disk(settings.data_dir, settings.disk_reserve_bytes)
        quarantine = Quarantine(settings.quarantine_dir)
        self.files = EstimateFiles(settings.estimates_dir, quarantine)
        self.hub = Hub(self.jobs)
        self.frames = FrameCache()
        self.picture_room = PictureRoom()
        self.lessons = FrameCache(_LESSON_BYTES)
        self.lesson_losses: Counter[str] = Counter()  # render processes that lessons have ended, by uploaded scene
        self.job_texts = JobTexts()
        self.accountant = Accountant(settings)
        self.uploads = Uploads(settings, self.scenes, quarantine, self.disk, self.accountant.scene_bytes(AT_ONCE))
        self.engine = EmbeddedEngine(displays=self.files.displays)
        place = f"{socket.gethostname()}:{settings.data_dir.resolve()}"
        self.gate = self._gate()
        lease = Lease(self.jobs, place, self.id, settings.lease_seconds)
        slots = settings.max_running_jobs
        self.admission = Admission(self.jobs, self.disk, self.accountant, slots, self.need_of)
        parts = (settings, self.jobs, self.engine, self.hub, self.files, lease, self.metrics)
        self.runner = Runner(*parts, self._scene_path, self.disk, self.admission)
        self.hub.expected_starts = self.runner.expected_starts
        self._housekeeping = Housekeeping(settings, self.jobs, self.uploads, self.runner, self.metrics, quarantine)
        allowed = settings.webhook_private_addresses
        self._messenger = Messenger(WebhookStore(self.database), is_private_allowed=allowed)
        self._lock = DataLock(settings.data_dir)
        self._log = structlog.get_logger("service")

    async def start(self) -> None:
        """Take the data folder, bring the tables up and go on with what was running."""
        make_folder(self.settings.data_dir)
        self._lock.take()
        await asyncio.to_thread(open_database, self.settings, self.database)
        self.files.prepare()
        if self.gate is not None:
            await asyncio.to_thread(self.gate.start)
        await asyncio.to_thread(self.uploads.prepare)
        await asyncio.to_thread(self._take_stock)
        await self.hub.start()
        await self.runner.start()
        self._housekeeping.start()
        self._messenger.start()
        if self.settings.are_keys_required and not await asyncio.to_thread(self.keys.any_in_use):
            self._log.warning("no API key exists yet, so nobody can ask anything: fredholm key create NAME")

    async def not_ready(self) -> list[str]:
        """What keeps jobs from starting at once; empty if nothing does."""
        missing: list[str] = []
        try:
            await reading(self.database.verify)
        except DatabaseReplaced as gone:
            missing.append(f"{gone}: stop the service and put the database back")
        except SQLAlchemyError:
            missing.append("the database does not answer")
        folder = self.settings.estimates_dir
        if not os.access(folder, os.W_OK):
            missing.append("the folder of estimates cannot be written")
        elif shortage := self.disk.shortage(_LITTLE_SPACE_BYTES):
            missing.append(str(shortage))
        if (held := self.admission.first_shortage) is not None and held.what == "memory":
            missing.append(f"a job waits: {held}")
        if self.runner.renderer_state != "warm":
            missing.append(f"the renderer is {self.runner.renderer_state}")
        if self.gate is not None and (lack := self.gate.missing()) is not None:
            missing.append(lack)
        return missing

    def close_streams(self) -> None:
        """End all event streams."""
        self.hub.close()

    async def stop(self) -> None:
        """Save what runs, end the processes, close the database."""
        self.close_streams()
        await self._housekeeping.stop()
        await self._messenger.stop()
        await self.runner.stop()
        if self.gate is not None:
            await asyncio.to_thread(self.gate.stop)
        self.uploads.close()
        self.database.close()
        self._lock.release()

    def _gate(self) -> Gate | None:
        """To the cluster, if there is one."""
        asked = self.settings
        if asked.cluster is None:
            return None
        from service.cluster.gate import Gate

        where = self.files.displays / "gate", asked.scenes_dir
        return Gate(asked.cluster, asked.cluster_certificates, *where, asked.crash_limit)

    def _take_stock(self) -> None:
        """Know from the beginning what is taken, and say what there is."""
        self.files.reckon(self.jobs.clients(), self.jobs.newest(_MOST_UNFINISHED, states=UNFINISHED), self.settings)
        self.accountant.say(AT_ONCE)

    def account(self) -> dict[str, tuple[int, int]]:
        """By what is limited: bytes that are reckoned with, and bytes that there may be."""
        ledger, running = self.files.ledger, self.runner.clients()
        return {
            "renderer": (reckon(self.admission.held(running)) if running else 0, self.accountant.renderer_bytes),
            "estimates": (ledger.taken(), ledger.quota.of_all),
        }

    def need_of(self, job: JobRecord) -> Need:
        """What a job needs of the renderer. Synchronous: it may look into a file."""
        return Need.of(job.settings, job.loaded_scene, self.uploads.scene_bytes(job.scene_kind, job.scene_ref))

    async def _scene_path(self, job: JobRecord) -> str:
        """What the renderer is to load: a gallery name or a file. Raises SceneDamaged."""
        if job.scene_kind == "gallery":
            return job.scene_ref
        scene = await reading(self.scenes.get, job.scene_ref)
        if scene is None:
            raise SceneDamaged(job.scene_ref)
        await asyncio.to_thread(self.uploads.check_whole, scene)
        return str(self.settings.scenes_dir / scene.path)


async def _service(request: Request) -> Service:
    # Not a plain function: FastAPI would have every request wait for a thread to call it.
    return request.app.state.service


ServiceContext = Annotated[Service, Depends(_service)]
