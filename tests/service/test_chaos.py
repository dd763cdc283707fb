"""kill -9 at any moment of the service, of its render process, or of both: no acknowledged job is lost, and every image
equals that of an undisturbed run, bit for bit.

The long form, `make chaos`, does faults of all kinds, 100 on each database, with a fresh seed (FREDHOLM_CHAOS_SEED,
FREDHOLM_CHAOS_COUNT; FREDHOLM_CHAOS_KIND: a part of the kinds' names); `make test-long` does 10.
"""

from __future__ import annotations

import contextlib
import os
import random
import signal
import sys
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
from chaos_faults import FAULTS, Chaos, Wanted, place
from postgres import MISSING, Postgres, is_installed
from service_process import ENDED, PLAIN_SCENE, Server, is_alive, wait_for

import renderer

ROUGH = {
    "FREDHOLM_CRASH_LIMIT": "1000",
    "FREDHOLM_CHECKPOINT_SECONDS": "0.2",
    "FREDHOLM_WARM_UP": "0",
}


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
    wait_for(lambda: not any(is_alive(pid) for pid in pids), 60, "the end of all render processes")
    assert not server.displays()
    estimates = server.data_dir / "estimates"
    assert sorted(folder.name for folder in estimates.iterdir()) == sorted(ids)
    assert not list(server.data_dir.glob("scenes/.upload-*"))


def test_a_few_jobs_survive_a_few_kills(tmp_path: Path, database_url: str) -> None:
    rng = random.Random(7)
    chaos(tmp_path, database_url, jobs_of(3, 96, rng, ("cornell-box",), 16), ("both", "render"), rng, pause=0.3)


def campaign(at: Chaos, count: int) -> list[tuple[str, float]]:
    """Faults of all kinds that can happen here, each as often as any other. Returns kinds and the seconds they took."""
    only = os.environ.get("FREDHOLM_CHAOS_KIND", "")
    possible = [kind for kind, (_, needs) in FAULTS.items() if (needs is None or needs in at.can) and only in kind]
    done: list[tuple[str, float]] = []
    while len(done) < count:
        for kind in at.rng.sample(possible, len(possible))[: count - len(done)]:
            at.keep_busy()
            time.sleep(at.rng.uniform(0, 0.5))
            print(f"{len(done) + 1:4d}  {kind}", flush=True)
            began = time.monotonic()
            FAULTS[kind][0](at)
            at.wait_ready()
            done.append((kind, time.monotonic() - began))
    return done


def lost(at: Chaos, calm: dict[Wanted, renderer.Estimate]) -> list[str]:
    """What was acknowledged and is not there, or not as it is without faults."""
    found: list[str] = []
    for job_id, wanted in at.jobs.items():
        job = at.server.job(job_id)
        if job.get("state") != "succeeded":
            found.append(f"job {job_id}: {job}")
            continue
        saved = [path for path in (at.server.data_dir / "estimates" / job_id).iterdir()]
        mine = renderer.Estimate.read(max(saved))
        for name in calm[wanted].moments.__dataclass_fields__:
            one, other = getattr(calm[wanted].moments, name), getattr(mine.moments, name)
            if not np.array_equal(one, other, equal_nan=True):
                found.append(f"{name} of job {job_id}: {wanted}")
    for scene_id, content in at.scenes.items():
        paths = list((at.server.data_dir / "scenes" / scene_id).glob("*/scene.xml"))
        status = insist(at.server, "GET", f"/api/scenes/{scene_id}").status_code
        if status != 200 or len(paths) != 1 or paths[0].read_text() != content:
            found.append(f"scene {scene_id}: {status}, {paths}")
    return found


def report(at: Chaos, done: list[tuple[str, float]]) -> None:
    """A table by kind."""
    print(f"\n{'fault':42s} {'times':>5s} {'seconds until ready, middle and worst':>40s}")
    for kind, (_, needs) in FAULTS.items():
        took = sorted(seconds for one, seconds in done if one == kind)
        if took:
            print(f"{kind:42s} {len(took):5d} {took[len(took) // 2]:33.1f} {took[-1]:6.1f}")
        elif needs is not None and needs not in at.can:
            print(f"{kind:42s}     -   needs {needs}")
    print(f"{'all':42s} {len(done):5d}")
    print(
        f"acknowledged: {len(at.jobs)} jobs, {len(at.scenes)} uploads; told to come again: {at.refused}; "
        f"without answer: {at.unanswered}"
    )


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="faults are made with what Linux offers")
@pytest.mark.parametrize("database", ["sqlite", "postgresql"])
def test_nothing_acknowledged_is_lost_whatever_happens(tmp_path: Path, database: str) -> None:
    seed = int(os.environ.get("FREDHOLM_CHAOS_SEED") or random.SystemRandom().randrange(10**6))
    count = int(os.environ.get("FREDHOLM_CHAOS_COUNT", "10"))
    print(f"\n{count} faults with seed {seed} on {database}")
    with contextlib.ExitStack() as ends:
        postgres = None
        if database == "postgresql":
            if not is_installed():
                pytest.skip(MISSING)
            postgres = Postgres().start()
            ends.callback(postgres.stop)
        url = postgres.new_database() if postgres else None
        at = ends.enter_context(place(tmp_path, random.Random(seed), url, postgres))
        done = campaign(at, count)
        wait_for(lambda: not at.unended(), 900, "the end of all jobs", lambda: str(at.unended()))
        report(at, done)
        calm = {wanted: calm_run(wanted, tmp_path) for wanted in set(at.jobs.values())}
        missing = lost(at, calm)
        print(f"lost or changed: {len(missing)}; wrongly answered: {len(at.wrong)}")
        assert not missing, "\n".join(missing[:20])
        assert not at.wrong, "\n".join(at.wrong[:20])
        at.server.stop()


def calm_run(wanted: Wanted, folder: Path) -> renderer.Estimate:
    """The picture of a job that nothing happened to."""
    plain = folder / "plain.xml"
    plain.write_text(PLAIN_SCENE)
    settings = renderer.Settings(**wanted.settings)
    return renderer.render(wanted.scene or str(plain), renderer.Target(**wanted.target), settings)
