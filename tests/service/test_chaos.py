"""kill -9 at any moment of the service, of its render process, or of both: no acknowledged job is lost, and every image
equals that of an undisturbed run, bit for bit.

The long form, with fresh moments every time: `make test-long`, or pytest -m slow tests/service/test_chaos.py.
"""

from __future__ import annotations

import contextlib
import os
import random
import signal
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from uuid import uuid4

import httpx
import numpy as np
import pytest
from service_process import ENDED, PLAIN_SCENE, Server, is_alive, wait_for

import renderer
from renderer.scene import gallery

ROUGH = {
    "FREDHOLM_CRASH_LIMIT": "1000",
    "FREDHOLM_CHECKPOINT_SECONDS": "0.2",
    "FREDHOLM_WARM_UP": "0",
}
KINDS = ("service", "render", "both")


@dataclass(frozen=True)
class Asked:
    """A job to be submitted, and what it answers to."""

    scene: str | None  # None: the uploaded one
    target: dict[str, Any]
    settings: dict[str, Any]
    key: str


def jobs_of(n: int, side: int, rng: random.Random, scenes: Sequence[str], longer: int = 1) -> list[Asked]:
    """longer: times as many samples, so that a job is still there when it is to be disturbed."""
    asked: list[Asked] = []
    for i in range(n):
        settings = {"width": rng.choice((side // 2, side)), "height": side, "seed": i}
        # Which of the two limits ends the second kind depends on the samples alone.
        target: dict[str, Any] = {"spp": longer * rng.choice((160, 288))} if i % 4 != 1 else {"error": 0.04, "spp": 288}
        asked.append(Asked(scenes[i % len(scenes)] if i % 4 != 2 else None, target, settings, uuid4().hex))
    return asked


def insist(server: Server, method: str, path: str, **more: Any) -> httpx.Response:
    """Ask until there is an answer, as a client would that meets a service being restarted."""
    ends = time.monotonic() + 60
    while True:
        with contextlib.suppress(httpx.TransportError):
            return httpx.request(method, server.url + path, timeout=10, **more)
        assert time.monotonic() < ends
        time.sleep(0.05)


def disturb(server: Server, what: str) -> str:
    """Kill something, and say what."""
    renders = [pid for pid in server.render_pids() if is_alive(pid)]
    what = what if renders else "service"
    if what != "service":
        with contextlib.suppress(ProcessLookupError):
            os.kill(renders[-1], signal.SIGKILL)
    if what != "render":
        server.kill()
        server.start(wait_until="/healthz")
    return what


def wait_for_rendering(server: Server) -> None:
    """Until there is something to lose: a running job with a picture, or nothing left to run."""

    def holds() -> bool:
        jobs = insist(server, "GET", "/api/jobs").json()["jobs"]
        is_rendering = any(job["state"] == "running" and job["frame_seq"] > 0 for job in jobs)
        is_there = any(is_alive(pid) for pid in server.render_pids()[-1:])
        return (is_rendering and is_there) or all(job["state"] in ENDED for job in jobs)

    wait_for(holds, 120, "a running job")


def chaos(
    folder: Path, database_url: str, asked: list[Asked], kills: Sequence[str], rng: random.Random, pause: float
) -> None:
    """kills: what to kill, one after the other; pause: seconds between two, at most."""
    began, n_jobs = time.monotonic(), len(asked)
    server = Server(folder / "data", ROUGH | {"FREDHOLM_DATABASE_URL": database_url}).start(wait_until="/healthz")
    try:
        uploaded = insist(server, "POST", "/api/scenes", files={"file": ("a.xml", PLAIN_SCENE)}).json()["id"]
        ids: list[str] = []

        def submit(job: Asked) -> None:
            scene = {"id": uploaded} if job.scene is None else {"gallery": job.scene}
            body = {"scene": scene, "target": job.target, "settings": job.settings}
            answer = insist(server, "POST", "/api/jobs", json=body, headers={"Idempotency-Key": job.key})
            assert answer.status_code == 201, answer.text
            ids.append(answer.json()["id"])

        late = list(asked)
        for _ in range(max(1, n_jobs // 2)):
            submit(late.pop(0))
        killed: Counter[str] = Counter()
        for what in kills:
            wait_for_rendering(server)
            time.sleep(rng.uniform(0, pause))
            killed[disturb(server, what)] += 1
            if late:
                submit(late.pop(0))
        while late:
            submit(late.pop(0))
        ended = [server.wait_ended(job_id, 400) for job_id in ids]
        pids = server.render_pids() + server.render_pids("inspect")
        took = time.monotonic() - began
        check_images(server, asked, ended)
        server.stop()
        check_nothing_is_left(server, ids, pids)
        told = ", ".join(f"{what} {n}" for what, n in sorted(killed.items()))
        torn = ("job continues after a restart", "job lost its render process")
        interrupted = [line["job"] for line in server.log() if line.get("event") in torn]
        assert len(interrupted) >= len(kills) // 2, "hardly anything was disturbed"
        print(
            f"all ended after {took:.0f} s; killed: {told}; {len(interrupted)} interruptions of {len(set(interrupted))}"
        )
        print("jobs; every image equals that of a calm run; nothing is left")
    finally:
        if server.process is not None and server.process.poll() is None:
            server.kill()


def check_images(server: Server, asked: list[Asked], ended: list[dict[str, Any]]) -> None:
    """Every job has succeeded, with the bits of a calm run in this process."""
    plain = server.data_dir.parent / "plain.xml"
    plain.write_text(PLAIN_SCENE)
    for job, was in zip(asked, ended, strict=True):
        assert was["state"] == "succeeded", was
        saved = list((server.data_dir / "estimates" / was["id"]).iterdir())
        assert len(saved) == 1, saved
        mine = renderer.Estimate.read(saved[0])
        calm = renderer.render(
            job.scene or str(plain), renderer.Target(**job.target), renderer.Settings(**job.settings)
        )
        for name in calm.moments.__dataclass_fields__:
            one, other = getattr(calm.moments, name), getattr(mine.moments, name)
            assert np.array_equal(one, other, equal_nan=True), f"{name} of {job}"


def check_nothing_is_left(server: Server, ids: list[str], pids: list[int]) -> None:
    wait_for(lambda: not any(is_alive(pid) for pid in pids), 10, "the end of all render processes")
    assert not server.displays()
    estimates = server.data_dir / "estimates"
    assert sorted(folder.name for folder in estimates.iterdir()) == sorted(ids)
    assert not list(server.data_dir.glob("scenes/.upload-*"))


def test_a_few_jobs_survive_a_few_kills(tmp_path: Path, database_url: str) -> None:
    rng = random.Random(7)
    chaos(tmp_path, database_url, jobs_of(3, 96, rng, ("cornell-box",), 16), ("both", "render"), rng, pause=0.3)


@pytest.mark.slow
def test_twenty_jobs_survive_a_dozen_kills(tmp_path: Path, database_url: str) -> None:
    seed = random.SystemRandom().randrange(10**6)
    print(f"chaos with seed {seed}")
    rng = random.Random(seed)
    asked = jobs_of(20, 96, rng, [scene.name for scene in gallery.list_scenes()], 4)
    chaos(tmp_path, database_url, asked, [rng.choice(KINDS) for _ in range(12)], rng, pause=5.0)
