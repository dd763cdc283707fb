"""A small client of the service, with nothing but the standard library underneath and the wire types on top.

    client = Client("http://127.0.0.1:8017")
    job = client.submit("cornell-box", error=0.02)
    for progress in client.watch(job.id):
        print(progress.error)
    client.download(job.id, "box.exr")

Requests that fail on the way are tried again; a submission carries an Idempotency-Key, so it never queues two jobs.
"""

from __future__ import annotations

import json
import os
import secrets
import time
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Iterator
from http.client import HTTPException, HTTPResponse
from pathlib import Path
from typing import Any

from service.messages import Deleted, Job, JobDetail, Problem, ProgressMessage, Scene
from service.states import ENDED, State

_TRIES = 6
_FIRST_PAUSE_SECONDS, _LONGEST_PAUSE_SECONDS = 0.2, 15.0
_SILENCE_SECONDS = 40.0  # the service says something every 15 s
_CHUNK = 1 << 20


class ServiceError(Exception):
    """The service refused; `problem` says what and why."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        super().__init__(f"{problem.title}: {problem.detail}")


class ServiceUnreachable(Exception):
    """The service did not answer, however often it was asked."""


class Client:
    """One service. key: an API key, where the service asks for one; FREDHOLM_KEY by default."""

    def __init__(self, url: str = "http://127.0.0.1:8017", key: str | None = None, timeout: float = 30.0) -> None:
        if not url.startswith(("http://", "https://")):
            raise ValueError(f"the address {url!r} is not one of a service; write http://HOST:PORT")
        self._url = url.rstrip("/")
        self._key = key or os.environ.get("FREDHOLM_KEY")
        self._timeout = timeout

    def submit(
        self,
        scene: str | Path,
        *,
        error: float | None = None,
        seconds: float | None = None,
        spp: int | None = None,
        priority: int = 0,
        **settings: Any,
    ) -> JobDetail:
        """Queue a picture.

        scene: name of the gallery, id of an uploaded scene, or a .xml or .zip file, which is uploaded.
        settings: width, height, seed, max_depth, technique, sensor, camera={"fov": 40}, parameters={"radius": 0.5}.
        Raises ServiceError, ServiceUnreachable.
        """
        given = {"error": error, "seconds": seconds, "spp": spp}
        body = {
            "scene": self._scene(scene),
            "target": {name: value for name, value in given.items() if value is not None},
            "settings": settings,
            "priority": priority,
        }
        headers = {"Idempotency-Key": secrets.token_hex(16)}
        return JobDetail.model_validate(self._json("POST", "/api/jobs", body, headers))

    def upload(self, path: str | Path) -> Scene:
        """Upload a scene; the same content again is the same scene."""
        path, boundary = Path(path), secrets.token_hex(16)
        name = urllib.parse.quote(path.name)
        head = f'--{boundary}\r\nContent-Disposition: form-data; name="file"; filename="{name}"\r\n\r\n'
        data = head.encode() + path.read_bytes() + f"\r\n--{boundary}--\r\n".encode()
        headers = {"Content-Type": f"multipart/form-data; boundary={boundary}"}
        with self._open("POST", "/api/scenes", data, headers) as answer:
            return Scene.model_validate_json(answer.read())

    def job(self, job_id: str) -> JobDetail:
        """One job as it is now."""
        return JobDetail.model_validate(self._json("GET", f"/api/jobs/{job_id}"))

    def jobs(self, limit: int = 100, *states: State, before: str | None = None) -> list[Job]:
        """The newest jobs: those in one of `states`, or all; older than the job `before`, or from now on."""
        query = [("limit", limit), *(("state", state) for state in states), *([("before", before)] if before else [])]
        path = f"/api/jobs?{urllib.parse.urlencode(query)}"
        return [Job.model_validate(one) for one in self._json("GET", path)["jobs"]]

    def pause(self, job_id: str) -> JobDetail:
        """Take a job from the renderer until it is resumed."""
        return self._step(job_id, "pause")

    def resume(self, job_id: str) -> JobDetail:
        """Let a paused job go on."""
        return self._step(job_id, "resume")

    def cancel(self, job_id: str) -> JobDetail:
        """End a job and keep its picture."""
        return self._step(job_id, "cancel")

    def go_on(self, job_id: str, **target: float) -> JobDetail:
        """Continue a job that has ended to a tighter target: error, seconds, spp."""
        return self._step(job_id, "continue", {"target": target})

    def delete(self, job_id: str) -> None:
        """Forget a job with its pictures."""
        self._open("DELETE", f"/api/jobs/{job_id}").close()

    def watch(self, job_id: str, patience_seconds: float = 600.0) -> Iterator[Job | ProgressMessage]:
        """The job now, then its progress and changes of state, until it has ended. Outlives restarts of the service.

        Raises ServiceError, and ServiceUnreachable after `patience_seconds` without an answer.
        """
        pause, heard = _FIRST_PAUSE_SECONDS, time.monotonic()
        while True:
            try:
                for news in self._events(job_id):
                    pause, heard = _FIRST_PAUSE_SECONDS, time.monotonic()
                    # What changed before the stream was open is not told by it.
                    news = self.job(job_id) if news is None else news
                    if news.id == job_id:
                        yield news
                        if news.state in ENDED:
                            return
            except (OSError, HTTPException, ServiceUnreachable):
                if time.monotonic() - heard > patience_seconds:
                    raise
                time.sleep(pause)
                pause = min(2 * pause, _LONGEST_PAUSE_SECONDS)

    def wait(self, job_id: str) -> JobDetail:
        """The job once it has ended."""
        for _ in self.watch(job_id):
            pass
        return self.job(job_id)

    def download(self, job_id: str, path: str | Path, *, with_moments: bool = True) -> Path:
        """Save the image: .exr with all that is known, .png to look at. with_moments False: an eighth of the size,
        to open and measure, not to go on from, merge or replay.
        """
        path = Path(path)
        if path.suffix.lower() not in (".exr", ".png"):
            raise ValueError(f"the file {path.name!r} must end in .exr or .png")
        temporary = path.with_name(f".{path.name}.part")
        try:
            for left in reversed(range(_TRIES)):
                suffix = path.suffix.lower()
                file = "checkpoint.exr" if suffix == ".exr" and with_moments else f"image{suffix}"
                if self._copy(f"/api/jobs/{job_id}/{file}", temporary):
                    os.replace(temporary, path)
                    return path
                time.sleep(_FIRST_PAUSE_SECONDS if left else 0)
            raise ServiceUnreachable(f"{self._url} ended the download of {path.name} early, {_TRIES} times")
        finally:
            temporary.unlink(missing_ok=True)

    def _copy(self, address: str, path: Path) -> bool:
        """Save an answer; False if the connection ended before it did: half a picture looks like a whole one."""
        with self._open("GET", address) as answer, path.open("wb") as file:
            length = answer.getheader("Content-Length")
            try:
                while chunk := answer.read(_CHUNK):
                    file.write(chunk)
            except (OSError, HTTPException):
                return False
            return length is None or file.tell() == int(length)

    def _scene(self, scene: str | Path) -> dict[str, str]:
        text = str(scene)
        if isinstance(scene, Path) or text.lower().endswith((".xml", ".zip")):
            return {"id": self.upload(scene).id}
        is_id = len(text) == 16 and all(c in "0123456789abcdef" for c in text)
        return {"id": text} if is_id else {"gallery": text}

    def _step(self, job_id: str, step: str, body: dict[str, Any] | None = None) -> JobDetail:
        return JobDetail.model_validate(self._json("POST", f"/api/jobs/{job_id}/{step}", body, tries=1))

    def _events(self, job_id: str) -> Iterator[Job | ProgressMessage | None]:
        """What the stream tells; None once it is open, and when the job was deleted: ask what is true of it."""
        with self._open("GET", "/api/events", timeout=_SILENCE_SECONDS, tries=1) as stream:
            fields: dict[str, str] = {}
            for line in stream:
                name, _, value = line.decode().rstrip("\r\n").partition(": ")
                if name:
                    fields[name] = value
                    continue
                kind = fields.get("event")
                if kind == "hello" or (kind == "deleted" and Deleted.model_validate_json(fields["data"]).id == job_id):
                    yield None
                elif kind in ("job", "progress"):
                    model = Job if kind == "job" else ProgressMessage
                    yield model.model_validate_json(fields["data"])
                fields = {}

    def _json(
        self,
        method: str,
        path: str,
        body: dict[str, Any] | None = None,
        headers: dict[str, str] | None = None,
        tries: int = _TRIES,
    ) -> Any:
        data = None if body is None else json.dumps(body).encode()
        kind = {} if body is None else {"Content-Type": "application/json"}
        with self._open(method, path, data, kind | (headers or {}), tries=tries) as answer:
            return json.load(answer)

    def _open(
        self,
        method: str,
        path: str,
        data: bytes | None = None,
        headers: dict[str, str] | None = None,
        *,
        timeout: float | None = None,
        tries: int = _TRIES,
    ) -> HTTPResponse:
        """An open answer. Only what may be repeated is asked more than once."""
        request = urllib.request.Request(self._url + path, data, headers or {}, method=method)
        if self._key is not None:
            request.add_header("Authorization", f"Bearer {self._key}")
        pause = _FIRST_PAUSE_SECONDS
        while True:
            tries -= 1
            try:
                return urllib.request.urlopen(request, timeout=timeout or self._timeout)
            except urllib.error.HTTPError as error:
                problem = _problem(error)
                if problem.status not in (429, 503) or tries <= 0:
                    raise ServiceError(problem) from None
                told = error.headers.get("Retry-After", "")
                pause = min(float(told), _LONGEST_PAUSE_SECONDS) if told.isdecimal() else pause
            except (OSError, HTTPException) as error:
                if tries <= 0:
                    raise ServiceUnreachable(f"{self._url} does not answer: {error}") from error
            time.sleep(pause)
            pause = min(2 * pause, _LONGEST_PAUSE_SECONDS)


def _problem(error: urllib.error.HTTPError) -> Problem:
    try:
        return Problem.model_validate_json(error.read())
    except ValueError:
        return Problem(type="about:blank", title=str(error.reason), status=error.code, detail=f"status {error.code}")
