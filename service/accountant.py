"""The one account of memory and disk: what each part of the service may take, what a job takes, what would be needed.

Limits follow from the machine unless they are set. Of its memory the renderer may have a half, the processes that check
uploads three eighths together, and the service with its pictures and the system share the rest. Bytes per pixel are
measured; each is a little more than what was seen, so that what is reckoned is not exceeded.
"""

from __future__ import annotations

import secrets
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import structlog

from service.machine import Machine
from service.room import Shortage, channels_in, say_bytes
from service.settings import MEBIBYTE, ServiceSettings

# Of the render process: its libraries, compiled kernels and the gallery's scenes; one launch, whatever the picture; per
# pixel of the picture whose turn it is; and per pixel of every job that runs, and of each of its channels.
_PROCESS_BYTES, _LAUNCH_BYTES, _TURN_BYTES, _HELD_BYTES, _CHANNEL_BYTES = 600 * MEBIBYTE, 80 * MEBIBYTE, 500, 170, 30
# Of a picture in shared memory while its job runs.
_DISPLAY_BYTES = 33
_RENDERER_SHARE, _INSPECTION_SHARE = 1 / 2, 3 / 8
# Of a process that checks uploads: its libraries, and how often a scene's own estimate it may take.
_INSPECTOR_BYTES, _COPIES = 250 * MEBIBYTE, 2
_SYSTEM_BYTES = 128 * MEBIBYTE  # that stay free when a job is started
_ESTIMATES_SHARE, _CLIENT_SHARE = 0.8, 0.5
_NO_LIMIT = 1 << 62


@dataclass(frozen=True, slots=True)
class Need:
    """What a job needs of the renderer. channels: beside radiance. scene: which, as jobs of one share it."""

    pixels: int
    channels: int = 0
    scene: str = ""
    scene_bytes: int = 0

    @classmethod
    def of(cls, settings: Mapping[str, Any], scene: str, scene_bytes: int) -> Need:
        """Of a job by its resolved settings."""
        return cls(settings["width"] * settings["height"], channels_in(settings), scene, scene_bytes)


def reckon(needs: Iterable[Need]) -> int:
    """What the render process takes with these jobs."""
    some = list(needs)
    held = sum(one.pixels * (_HELD_BYTES + one.channels * _CHANNEL_BYTES) for one in some)
    scenes = {one.scene: one.scene_bytes for one in some}
    return (
        _PROCESS_BYTES
        + _LAUNCH_BYTES
        + _TURN_BYTES * max((one.pixels for one in some), default=0)
        + held
        + sum(scenes.values())
    )


class Accountant:
    """The limits of one service, and whether a job fits into them."""

    def __init__(self, settings: ServiceSettings, machine: Machine | None = None) -> None:
        self._settings = settings
        self._machine = machine or Machine()
        self.memory_bytes = settings.memory_bytes or self._machine.memory()
        self.renderer_bytes = settings.renderer_memory_bytes or int(_RENDERER_SHARE * self.memory_bytes)

    def scene_bytes(self, inspectors: int) -> int:
        """What an uploaded scene may take, so that so many can be checked at a time."""
        each = _INSPECTION_SHARE * self.memory_bytes / inspectors - _INSPECTOR_BYTES
        return min(self._settings.max_scene_bytes, max(16 * MEBIBYTE, int(each / _COPIES)))

    def never_fits(self, need: Need) -> str | None:
        """Why a job can never be rendered here, with the figures and the ways out; None if it can."""
        needed = reckon([need])
        if needed <= self.renderer_bytes:
            return None
        least = reckon([Need(0, need.channels, need.scene, need.scene_bytes)])
        each = _TURN_BYTES + _HELD_BYTES + need.channels * _CHANNEL_BYTES
        most = max(0, self.renderer_bytes - least) // each
        way = f"ask for at most {most} pixels" if most else "upload a smaller scene"
        return (
            f"{need.pixels} pixels of this scene take {say_bytes(needed)} of memory, and the renderer may have "
            f"{say_bytes(self.renderer_bytes)}; {way}, or have FREDHOLM_RENDERER_MEMORY_BYTES raised"
        )

    def shortage(self, need: Need, running: Iterable[Need]) -> Shortage | None:
        """What is missing to start a job beside those that run; None if nothing is."""
        others = list(running)
        held = reckon(others)
        more = reckon([*others, need]) - (held if others else 0)
        # What others on this machine take counts too; of what the renderer is to have, it has some already.
        growth = more + _DISPLAY_BYTES * need.pixels - (0 if others else _PROCESS_BYTES)
        free = self.renderer_bytes - (held if others else 0)
        available = max(0, self._machine.available() - _SYSTEM_BYTES)
        if more > free:
            return Shortage(more, max(0, free), "memory")
        return Shortage(growth, available, "memory") if growth > available else None

    def say(self, inspectors: int) -> None:
        """Tell the log which limits follow from this machine, and what the largest job that is allowed would need."""
        log = structlog.get_logger("service.accountant")
        log.info(
            "memory is shared out",
            machine=say_bytes(self.memory_bytes),
            renderer=say_bytes(self.renderer_bytes),
            scene=say_bytes(self.scene_bytes(inspectors)),
        )
        if (why := self.never_fits(Need(self._settings.max_pixels))) is not None:
            log.warning("the largest pictures that FREDHOLM_MAX_PIXELS allows do not fit", why=why)


@dataclass(frozen=True, slots=True)
class Quota:
    """What saved estimates may take on disk: all of them, and those of one client."""

    of_all: int
    of_one: int

    @classmethod
    def of(cls, settings: ServiceSettings, free: int, taken: int) -> Quota:
        """free: bytes of the disk. taken: by estimates already."""
        of_all = settings.max_estimates_bytes or int(_ESTIMATES_SHARE * (free + taken))
        return cls(of_all, settings.max_estimates_bytes_per_client or int(_CLIENT_SHARE * of_all))


class QuotaReached(Exception):
    """Saved estimates take what they may."""

    def __init__(self, needed: int, taken: int, most: int, whose: str) -> None:
        super().__init__(
            f"This picture takes up to {say_bytes(needed)} of disk, and pictures {whose} take {say_bytes(taken)} of "
            f"{say_bytes(most)}; delete jobs that are not needed any more"
        )


class Ledger:
    """What the estimates of each job take on disk, or will once it has run. For use from several threads."""

    def __init__(self) -> None:
        self.quota = Quota(_NO_LIMIT, _NO_LIMIT)  # until it is known what the disk has
        self._jobs: dict[str, tuple[str, int]] = {}
        self._clients: dict[str, int] = {}
        self._total = 0
        self._lock = threading.Lock()

    def taken(self) -> int:
        """By all jobs."""
        return self._total

    def note(self, job_id: str, client_id: str, size: int) -> None:
        """A job takes so much now."""
        with self._lock:
            self._put(job_id, client_id, size)

    def forget(self, job_id: str) -> None:
        """A job is gone."""
        with self._lock:
            self._drop(job_id)

    def _put(self, job_id: str, client_id: str, size: int) -> None:
        self._drop(job_id)
        self._jobs[job_id] = client_id, size
        self._clients[client_id] = self._clients.get(client_id, 0) + size
        self._total += size

    def _drop(self, job_id: str) -> None:
        client_id, size = self._jobs.pop(job_id, ("", 0))
        self._total -= size
        if left := self._clients.get(client_id, 0) - size:
            self._clients[client_id] = left
        else:
            self._clients.pop(client_id, None)

    @contextmanager
    def reserved(self, client_id: str, size: int, job_id: str | None = None) -> Iterator[Callable[[str], None]]:
        """Room for an estimate, while its job is queued: nobody else can be promised the same.

        Gives what to call with the id of the job once it is queued. job_id: of a job that goes on from an estimate, in
        whose place the new one comes. Raises QuotaReached.
        """
        place = f"reserved {secrets.token_hex(8)}"
        with self._lock:
            own = self._jobs.get(job_id or "", ("", 0))[1]
            limits = [(self._total - own, self.quota.of_all, "of this service")]
            if client_id:
                limits.append((self._clients.get(client_id, 0) - own, self.quota.of_one, "of one client"))
            for taken, most, whose in limits:
                if taken + size > most:
                    raise QuotaReached(size, taken, most, whose)
            self._put(place, client_id, size - own)

        def keep(queued: str) -> None:
            with self._lock:
                self._drop(place)
                self._put(queued, client_id, size)

        try:
            yield keep
        finally:
            self.forget(place)

    def resize(self, job_id: str, size: int) -> None:
        """A job has left the renderer, and its files take so much."""
        with self._lock:
            self._put(job_id, self._jobs.get(job_id, ("", 0))[0], size)
