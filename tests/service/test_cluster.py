"""Facts about one picture on many workers: real processes, killed in the middle, and the bits of one machine."""

from __future__ import annotations

import io
import os
import re
import zipfile
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import httpx
import pytest
from service_process import PLAIN_SCENE, Server, is_alive, wait_for

pytest.importorskip("distributed", reason="the extra cluster is not installed")

from cluster_processes import Cluster

from renderer import Settings, Target, render
from renderer.estimate.estimate import Estimate
from renderer.estimate.moments import Moments

SIZE: dict[str, Any] = {"width": 96, "height": 64, "seed": 5}


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    running = Cluster(tmp_path_factory.mktemp("cluster")).start("one", "two")
    yield running
    running.stop()


@pytest.fixture(scope="module")
def service(cluster: Cluster, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    environment = {"FREDHOLM_CLUSTER": cluster.address, "FREDHOLM_CHECKPOINT_SECONDS": "0.5", "FREDHOLM_WARM_UP": "0"}
    running = Server(tmp_path_factory.mktemp("on-cluster") / "data", environment).start()
    yield running
    running.stop()


def exr(service: Server, job_id: str, folder: Path) -> Estimate:
    answer = httpx.get(f"{service.url}/api/jobs/{job_id}/checkpoint.exr", timeout=60)
    assert answer.status_code == 200, answer.text
    (folder / f"{job_id}.exr").write_bytes(answer.content)
    return Estimate.read(folder / f"{job_id}.exr")


def assert_same_bits(a: Estimate, b: Estimate) -> None:
    assert_same_moments(a, b)
    assert (a.identity, a.ranges) == (b.identity, b.ranges)


def succeeded(service: Server, job: dict[str, Any], seconds: float = 240) -> dict[str, Any]:
    ended = service.wait_ended(job["id"], seconds)
    assert ended["state"] == "succeeded", ended
    return ended


def test_a_picture_of_two_workers_has_the_bits_of_one_machine(
    cluster: Cluster, service: Server, tmp_path: Path
) -> None:
    job = succeeded(service, service.submit({"spp": 1024}, SIZE))
    alone = render("cornell-box", Target(spp=1024), Settings(**SIZE))
    assert_same_bits(exr(service, job["id"], tmp_path), alone)
    # How much each renders is up to the machine: one may still compile while the other is nearly done.
    rendered = figures(service)
    assert set(rendered) == {"one", "two"}
    assert min(rendered.values()) > 0


def figures(service: Server) -> dict[str, float]:
    """Passes that each worker has rendered."""
    told = httpx.get(f"{service.url}/metrics", timeout=30).text
    found = re.findall(r'^fredholm_cluster_worker_rendered\{worker="(.+?)"\} ([\d.e+]+)$', told, re.MULTILINE)
    return {name: float(n) for name, n in found}


def test_a_killed_worker_loses_its_passes_alone(cluster: Cluster, service: Server, tmp_path: Path) -> None:
    settings: dict[str, Any] = SIZE | {"seed": 6, "technique": "bsdf"}
    before = figures(service)
    job = service.submit({"spp": 8192}, settings)
    # In the middle of its work: it has rendered some, and holds some.
    wait_for(lambda: figures(service)["two"] > before["two"], 120, "worker two renders", cluster.workers["two"].said)
    assert service.job(job["id"])["state"] == "running"
    of_two = cluster.render_pids("two")[-1]
    cluster.workers["two"].kill()
    wait_for(lambda: not is_alive(of_two), 60, "its render process goes with it")
    ended = succeeded(service, job)
    assert ended["warnings"] == []
    assert not [line for line in service.log() if line.get("event") == "job lost its render process"]
    alone = render("cornell-box", Target(spp=8192), Settings(**settings))
    assert_same_bits(exr(service, job["id"], tmp_path), alone)
    wait_for(lambda: "two" not in figures(service), 60, "it is not counted any more")


def test_a_worker_that_joins_in_the_middle_is_used(cluster: Cluster, service: Server) -> None:
    job = service.submit({"spp": 10_000_000}, SIZE)
    service.wait(job["id"], lambda job: job["spp"] > 0, 120)
    cluster.add("three")
    wait_for(lambda: figures(service).get("three", 0) > 0, 240, "worker three renders", cluster.workers["three"].said)
    assert service.job(job["id"])["state"] == "running"
    assert service.cancel(job["id"]).status_code == 200


def test_an_uploaded_scene_goes_to_the_workers_once(cluster: Cluster, service: Server, tmp_path: Path) -> None:
    bundle = io.BytesIO()
    with zipfile.ZipFile(bundle, "w") as packed:
        packed.writestr("scene.xml", PLAIN_SCENE)
        packed.writestr("notes/read me.txt", "x" * 1000)
    answer = httpx.post(f"{service.url}/api/scenes", files={"file": ("ball.zip", bundle.getvalue())}, timeout=120)
    assert answer.status_code == 201, answer.text
    scene_id = answer.json()["id"]
    for seed in (1, 2):
        job = succeeded(service, service.submit({"spp": 512}, {"seed": seed}, id=scene_id))
    kept = [path for path in cluster.folder.glob(f"*/scenes/{scene_id}/*/scene.xml")]
    assert kept
    sent = [line for line in service.log() if line.get("event") == "scene sent" and line["scene"] == scene_id]
    assert len(sent) == len(kept)
    (tmp_path / "scene.xml").write_text(PLAIN_SCENE)
    alone = render(tmp_path / "scene.xml", Target(spp=512), Settings(seed=2))
    assert_same_moments(exr(service, job["id"], tmp_path), alone)


def test_a_scheduler_that_is_killed_is_found_again_and_nothing_is_lost(
    cluster: Cluster, service: Server, tmp_path: Path
) -> None:
    settings: dict[str, Any] = SIZE | {"seed": 7}
    job = service.submit({"spp": 4096}, settings)
    service.wait(job["id"], lambda job: job["spp"] > 0, 120)
    cluster.scheduler.kill()
    wait_for(lambda: "does not answer" in httpx.get(f"{service.url}/readyz").text, 60, "the loss is said")
    assert httpx.get(f"{service.url}/readyz").status_code == 503
    cluster.scheduler.start()
    ended = succeeded(service, job)
    assert ended["warnings"] == []
    assert not [line for line in service.log() if line.get("event") == "job lost its render process"]
    alone = render("cornell-box", Target(spp=4096), Settings(**settings))
    assert_same_bits(exr(service, job["id"], tmp_path), alone)


def test_a_pass_that_nobody_wants_any_more_is_ended(cluster: Cluster, service: Server) -> None:
    job = service.submit({"spp": 100_000}, SIZE | {"width": 256, "height": 256})
    service.wait(job["id"], lambda job: job["spp"] > 0, 120)
    assert service.cancel(job["id"]).status_code == 200
    assert service.job(job["id"])["state"] == "cancelled"
    told = lambda: httpx.get(f"{service.url}/metrics", timeout=30).text  # noqa: E731
    idle = r'fredholm_cluster_worker_passes\{worker="(.+?)"\} 0\.0'
    wait_for(lambda: len(re.findall(idle, told())) == len(figures(service)), 60, "the workers are idle", told)


def test_a_render_process_that_dies_each_time_fails_its_job_and_no_other(cluster: Cluster, service: Server) -> None:
    job = service.submit({"spp": 1_000_000}, SIZE | {"seed": 8})
    service.wait(job["id"], lambda job: job["spp"] > 0, 120)
    killed: set[int] = set()

    def is_over() -> bool:
        for name in cluster.workers:
            for pid in set(cluster.render_pids(name)) - killed:
                if is_alive(pid):
                    os.kill(pid, 9)
                    killed.add(pid)
        return service.job(job["id"])["state"] == "failed"

    wait_for(is_over, 240, "the job fails", lambda: str(service.job(job["id"])))
    cause = service.job(job["id"])["cause"]
    assert cause["title"] == "The render process died"
    assert "tried 3 times" in cause["detail"]
    succeeded(service, service.submit({"spp": 64}, SIZE))


def assert_same_moments(a: Estimate, b: Estimate) -> None:
    for field in fields(Moments):
        assert getattr(a.moments, field.name).tobytes() == getattr(b.moments, field.name).tobytes(), field.name
