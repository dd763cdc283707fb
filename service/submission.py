"""From a request for a job to a job that can be queued: the scene found, sizes resolved, limits kept."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

from renderer.errors import SceneError, SettingsError
from renderer.region import Region
from renderer.scene import gallery
from service.clients import Caller
from service.errors import ProblemError, refused
from service.messages import ContinueRequest, JobRequest, TargetRequest
from service.settings import ServiceSettings
from service.states import Step, after
from service.store import JobRecord, JobStore, NewJob, SceneStore


def new_job(
    request: JobRequest, caller: Caller, settings: ServiceSettings, scenes: SceneStore, jobs: JobStore
) -> NewJob:
    """What to queue. Raises ProblemError."""
    check_queue(jobs.waiting(), caller.client_id, settings)
    if request.scene.gallery is not None:
        try:
            built_in = gallery.find(request.scene.gallery)
        except SceneError as error:
            raise refused("scene.gallery", str(error)) from None
        kind, reference, name = "gallery", built_in.name, built_in.title
        film, warnings = (built_in.width, built_in.height), ()
    else:
        uploaded = scenes.get(request.scene.id or "", caller.scope)
        if uploaded is None:
            raise refused("scene.id", f"there is no uploaded scene {request.scene.id!r}; upload it first")
        kind, reference, name = "upload", uploaded.id, uploaded.name
        film, warnings = (uploaded.width, uploaded.height), uploaded.warnings
    width, height = size_of(film, request.settings.width, request.settings.height)
    if width * height > settings.max_pixels:
        raise refused(
            "settings.width" if request.settings.width is not None else "settings",
            f"{width}×{height} are {width * height} pixels, and this service allows "
            f"{settings.max_pixels}; ask for a smaller picture",
        )
    _check_target(request.target, width, height, settings)
    resolved = request.settings.model_dump() | {"width": width, "height": height}
    return NewJob(
        name,
        kind,
        reference,
        name,
        request.target.model_dump(),
        resolved,
        warnings,
        client_id=caller.client_id,
        priority=request.priority,
    )


def _check_target(target: TargetRequest, width: int, height: int, settings: ServiceSettings) -> None:
    if target.region is not None:
        try:
            Region.of(target.region).scope(width, height)
        except SettingsError as error:
            raise refused("target.region", str(error)) from None
    if target.spp is not None and target.spp * width * height > settings.max_samples:
        most = settings.max_samples // (width * height)
        raise refused("target.spp", f"{target.spp} of {width}×{height} pixels are too many; this service allows {most}")


def check_queue(waiting: Mapping[str, int], client_id: str, settings: ServiceSettings) -> None:
    """Whether one more job of a client may wait. waiting: queued jobs by client. Raises ProblemError."""
    limits = [(sum(waiting.values()), settings.max_waiting_jobs, "the limit of this service")]
    if client_id:
        limits.append((waiting.get(client_id, 0), settings.max_waiting_per_client, "the limit of one client"))
    for count, most, whose in limits:
        if count >= most:
            detail = f"{count} jobs wait already, {whose}; try again later or cancel some."
            raise ProblemError(429, "queue-full", "The queue is full", detail, headers={"Retry-After": "30"})


def request_digest(request: JobRequest) -> str:
    """Tells a repeated request from another one."""
    return hashlib.sha256(request.model_dump_json().encode()).hexdigest()


def check_continuation(job: JobRecord, request: ContinueRequest, settings: ServiceSettings) -> dict[str, Any]:
    """The target with which a job that has ended goes on. Raises IllegalStep, ProblemError."""
    after(job.state, Step.CONTINUE)
    target, reached = request.target, job.progress
    _check_target(target, job.settings["width"], job.settings["height"], settings)
    if target.spp is not None and reached.spp >= target.spp:
        raise refused("target.spp", f"{target.spp} are there already ({reached.spp:g}); ask for more")
    if target.seconds is not None and reached.seconds >= target.seconds:
        used = f"{reached.seconds:.1f} s of rendering are used already"
        raise refused("target.seconds", f"{used}, and they count from the beginning; ask for more than that")
    bound = reached.error if reached.error_upper is None else reached.error_upper
    is_same_scope = target.share is None and target.region == job.target.get("region")
    if target.error is not None and bound is not None and is_same_scope and bound <= target.error:
        raise refused("target.error", f"{bound:.4g} is reached already; ask for less than that")
    return target.model_dump()


def size_of(film: tuple[int, int], width: int | None, height: int | None) -> tuple[int, int]:
    """Pixels of the image: as asked; one side given scales the other; neither: the scene's film."""
    if width is None and height is None:
        return film
    if width is None:
        assert height is not None
        return max(1, round(film[0] * height / film[1])), height
    return width, max(1, round(film[1] * width / film[0])) if height is None else height
