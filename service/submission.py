"""From a request for a job to a job that can be queued: the scene found, sizes resolved, limits kept."""

from __future__ import annotations

import asyncio
import hashlib
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from renderer.errors import SceneError, SettingsError
from renderer.region import Region
from renderer.scene import gallery
from renderer.scene.parameters import SceneFile
from renderer.scene.rewrite import MOVABLE, SensorFacts, chosen_sensor, several_sensors
from renderer.settings import STOKES, image_size
from service.accountant import Accountant, Need
from service.clients import Caller
from service.errors import disk_full, refused
from service.messages import ContinueRequest, JobRequest, SeriesRequest, TargetRequest
from service.room import Disk, job_bytes
from service.settings import ServiceSettings
from service.shown import shown
from service.states import Step, after
from service.store import JobRecord, NewJob, QueueLimits, SceneRecord
from service.store.records import loaded_as
from service.uploads import Uploads
from service.webhooks import check_url, secret_bytes

if TYPE_CHECKING:
    from service.context import Service


def new_job(
    request: JobRequest,
    caller: Caller,
    uploaded: SceneRecord | None,
    settings: ServiceSettings,
    uploads: Uploads,
    disk: Disk,
    accountant: Accountant,
    told: Mapping[str, Any] | None = None,
) -> NewJob:
    """What to queue. uploaded: the scene, if it is an uploaded one that there is. told: what it requires with the
    parameters that are given. Raises ProblemError, SceneDamaged.
    """
    parameters = texts_of(request)
    if request.scene.gallery is not None:
        try:
            built_in = gallery.find(request.scene.gallery)
        except SceneError as error:
            raise refused("scene.gallery", str(error)) from None
        if parameters:
            given = shown(", ".join(map(repr, parameters)))
            raise refused("settings.parameters", f"{built_in.name} has no parameters, and {given} is given")
        kind, reference, name = "gallery", built_in.name, built_in.title
        sensors, warnings = (SensorFacts(0, "", "", built_in.width, built_in.height),), ()
    else:
        if uploaded is None:
            raise refused("scene.id", f"there is no uploaded scene {request.scene.id!r}; upload it first")
        uploads.check_whole(uploaded)
        kind, reference, name = "upload", uploaded.id, uploaded.name
        # None of scenes that older versions took in.
        choices = uploads.sensors(uploaded.id) if told is None else told["sensor_choices"]
        first = SensorFacts(0, "", "", uploaded.width, uploaded.height)
        sensors = tuple(SensorFacts(**one) for one in choices) if choices else (first,)
        warnings = uploaded.warnings if told is None else shown(tuple(told["warnings"]))
    asked = request.settings
    try:
        sensor = sensors[chosen_sensor(sensors, asked.sensor)]
    except SettingsError as error:
        raise refused("settings.sensor", str(error)) from None
    if asked.camera is not None and sensor.plugin and sensor.plugin not in MOVABLE:
        raise refused("settings.camera", f"sensor {sensor.label} is of the type {sensor.plugin}, which cannot be moved")
    if asked.sensor is not None:
        warnings = tuple(one for one in warnings if one != several_sensors(sensors))
    width, height = image_size((sensor.width, sensor.height), asked.width, asked.height)
    if width * height > settings.max_pixels:
        raise refused(
            "settings.width" if request.settings.width is not None else "settings",
            f"{width}×{height} are {width * height} pixels, and this service allows "
            f"{settings.max_pixels}; ask for a smaller picture",
        )
    _check_target(request.target, width, height, settings)
    index = None if asked.sensor is None else sensor.index
    resolved = asked.model_dump() | {"width": width, "height": height, "sensor": index}
    resolved["parameters"] = parameters
    if uploads.is_polarised(kind, reference, told):  # its Stokes vectors need room, too
        resolved["channels"] = list(dict.fromkeys((*resolved["channels"], STOKES)))
    check_disk(resolved, disk)
    scene_bytes = uploads.scene_bytes(kind, reference) if told is None else int(told["memory_bytes"])
    check_memory(Need.of(resolved, loaded_as(reference, parameters), scene_bytes), accountant)
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
        webhook=_webhook(request, settings),
    )


def _webhook(request: JobRequest, settings: ServiceSettings) -> dict[str, str] | None:
    """Who is to be told. Raises ProblemError."""
    if request.webhook is None:
        return None
    url, secret = request.webhook.url, request.webhook.secret.get_secret_value()
    try:
        check_url(url, is_private_allowed=settings.webhook_private_addresses)
    except ValueError as error:
        raise refused("webhook.url", shown(str(error))) from None
    try:
        secret_bytes(secret)
    except ValueError as error:
        raise refused("webhook.secret", str(error)) from None
    return {"url": url, "secret": secret}


async def members_of(
    service: Service, request: SeriesRequest, caller: Caller, uploaded: SceneRecord | None
) -> list[NewJob]:
    """The jobs of a series, each with what it differs by in its name. Raises ProblemError, SceneDamaged."""
    rules = (service.settings, service.uploads, service.disk, service.accountant)
    most = min(service.settings.max_waiting_jobs, service.settings.max_waiting_per_client)
    if len(request.sweep) > most:
        raise refused("sweep", f"{len(request.sweep)} sets of values are more jobs than may wait, {most}")
    made: list[NewJob] = []
    for values in request.sweep or [{}]:
        settings = request.settings.model_copy(update={"parameters": {**request.settings.parameters, **values}})
        single = JobRequest(
            scene=request.scene,
            target=request.target,
            settings=settings,
            priority=request.priority,
            webhook=request.webhook,
        )
        told, parameters = None, texts_of(single)
        if uploaded is not None and parameters:
            told = await service.uploads.with_parameters(uploaded, parameters, caller.client_id)
        choices = _choices(service, uploaded, told)
        which = [settings.sensor] if request.sensors is None else request.sensors
        for sensor in range(len(choices)) if which == "all" else which:
            if len(made) >= most:
                raise refused("sensors", f"the series has more jobs than may wait, {most}; ask for fewer at a time")
            own = single.model_copy(update={"settings": settings.model_copy(update={"sensor": sensor})})
            new = await asyncio.to_thread(new_job, own, caller, uploaded, *rules, told)
            index = new.settings["sensor"]
            parts = [] if request.sensors is None else [choices[index] or f"sensor {index}"]
            parts += [f"{name} = {parameters[name]}" for name in values]
            made.append(replace(new, name=shown(" · ".join([*parts, new.name]))))
    if not made:
        raise refused("sensors", "the list is empty; name at least one, or write all")
    return made


def _choices(service: Service, uploaded: SceneRecord | None, told: Mapping[str, Any] | None) -> list[str]:
    """Names of a scene's sensors, which may be empty."""
    if uploaded is None:
        return [""]
    found = service.uploads.sensors(uploaded.id) if told is None else told["sensor_choices"]
    return [one["name"] for one in found] or [""]


def texts_of(request: JobRequest) -> dict[str, str]:
    """The parameters of a request as XML has them. Raises ProblemError."""
    try:
        return dict(SceneFile("", request.settings.parameters).parameters)
    except SceneError as error:
        raise refused("settings.parameters", str(error)) from None


def _check_target(target: TargetRequest, width: int, height: int, settings: ServiceSettings) -> None:
    if target.region is not None:
        try:
            Region.of(target.region).scope(width, height)
        except SettingsError as error:
            raise refused("target.region", str(error)) from None
    if target.spp is not None and target.spp * width * height > settings.max_samples:
        most = settings.max_samples // (width * height)
        raise refused("target.spp", f"{target.spp} of {width}×{height} pixels are too many; this service allows {most}")


def queue_limits(settings: ServiceSettings) -> QueueLimits:
    """How many jobs may wait."""
    return QueueLimits(settings.max_waiting_jobs, settings.max_waiting_per_client)


def check_disk(settings: Mapping[str, Any], disk: Disk) -> None:
    """Whether the estimate of a job can be saved. settings: resolved ones. Raises ProblemError."""
    if shortage := disk.shortage(job_bytes(settings)):
        raise disk_full(shortage, "render and keep this picture")


def check_memory(need: Need, accountant: Accountant) -> None:
    """Whether the renderer can ever hold a job. Raises ProblemError."""
    if (why := accountant.never_fits(need)) is not None:
        raise refused("settings.width", why)


def request_digest(request: JobRequest) -> str:
    """Tells a repeated request from another one. What came later and is not used leaves the digests of old alone."""
    told = request.model_dump_json(exclude={"webhook"})
    if request.webhook is not None:
        told += request.webhook.url + request.webhook.secret.get_secret_value()
    return hashlib.sha256(told.encode()).hexdigest()


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
