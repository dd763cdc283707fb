"""Folder and database belong together: what does not is refused, and nothing that was acknowledged is thrown away."""

from __future__ import annotations

import os
import shutil
import sqlite3
import stat
import subprocess
import sys
import time
from pathlib import Path

import httpx
import pytest
from postgres import Postgres
from service_process import LONG, PLAIN_SCENE, ROOT, Server, wait_for

BODY = {"scene": {"gallery": "cornell-box"}, "target": {"spp": 4}, "settings": {"width": 8, "height": 8}}


def refusal(server: Server, url: str | None = None) -> str:
    """What `fredholm serve` says instead of serving; it must be one sentence, and exit code 2."""
    environment = os.environ | {"PYTHONPATH": str(ROOT)} | ({"FREDHOLM_DATABASE_URL": url} if url else {})
    command = [sys.executable, "-m", "service.command", "serve", "--port", "0", "--data", str(server.data_dir)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=120, cwd=ROOT)
    except subprocess.TimeoutExpired:
        pytest.fail("it serves")
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1, done.stderr
    return done.stderr


def listing(folder: Path) -> list[str]:
    return sorted(
        str(path.relative_to(folder)) for kind in ("estimates", "scenes") for path in folder.glob(f"{kind}/**/*")
    )


@pytest.fixture
def used(own_server: Server) -> Server:
    """A service that has stopped, with an upload and a finished job of it."""
    own_server.start()
    scene = httpx.post(f"{own_server.url}/api/scenes", files={"file": ("a.xml", PLAIN_SCENE)}, timeout=60).json()["id"]
    own_server.wait_ended(own_server.submit({"spp": 16}, {"width": 16, "height": 16}, id=scene)["id"])
    own_server.stop()
    return own_server


def test_a_used_folder_with_another_database_is_refused_and_keeps_its_files(used: Server, database_url: str) -> None:
    before = listing(used.data_dir)
    assert len(before) > 4
    told = refusal(used, database_url)
    assert "belongs to another database" in told
    assert "FREDHOLM_DATABASE_URL" in told
    assert "--data" in told
    assert listing(used.data_dir) == before
    used.start()
    assert httpx.get(f"{used.url}/api/jobs").json()["jobs"][0]["state"] == "succeeded"


def test_a_folder_whose_database_is_gone_is_refused_and_keeps_its_files(used: Server) -> None:
    before = listing(used.data_dir)
    (used.data_dir / "fredholm.sqlite").unlink()
    told = refusal(used)
    assert "fredholm.sqlite" in told
    assert "put it back" in told
    assert not (used.data_dir / "fredholm.sqlite").exists()
    assert listing(used.data_dir) == before


def test_a_used_folder_of_an_older_version_is_not_given_to_an_empty_database(used: Server, tmp_path: Path) -> None:
    (used.data_dir / "database").unlink(missing_ok=True)  # older versions did not note it
    before = listing(used.data_dir)
    refusal(used, f"sqlite:///{tmp_path}/empty.sqlite")
    assert listing(used.data_dir) == before
    used.start()  # its own is taken up
    assert len(httpx.get(f"{used.url}/api/jobs").json()["jobs"]) == 1


def test_tables_of_a_newer_version_are_one_sentence(used: Server) -> None:
    with sqlite3.connect(used.data_dir / "fredholm.sqlite") as database:
        database.execute("UPDATE alembic_version SET version_num = '9999'")
    told = refusal(used)
    assert "newer" in told
    assert "9999" in told


def test_what_no_job_names_goes_to_quarantine_and_is_logged(used: Server) -> None:
    job_id = next((used.data_dir / "estimates").iterdir()).name
    strays = {
        "estimates/0123456789ab/00000001.exr": "an estimate of no job",
        f"estimates/{job_id}/99999999.exr": "newer than the recorded one",
        "scenes/0123456789abcdef/a/scene.xml": "a scene of no row",
    }
    for name, text in strays.items():
        (used.data_dir / name).parent.mkdir(parents=True, exist_ok=True)
        (used.data_dir / name).write_text(text)
    used.start()
    kept = {path.read_text(): path for path in (used.data_dir / "quarantine").rglob("*") if path.is_file()}
    assert set(strays.values()) <= set(kept)
    assert not any((used.data_dir / name).exists() for name in strays)
    logged = [line for line in used.log() if "quarantine" in line["event"]]
    assert {Path(name).parts[1] for name in strays} <= {Path(line["what"]).parts[1] for line in logged}
    used.stop()
    # It is kept for days, not for ever.
    for folder in (used.data_dir / "quarantine").iterdir():
        os.utime(folder, (0, time.time() - 15 * 86400))
    used.start()
    wait_for(lambda: not list((used.data_dir / "quarantine").iterdir()), 60, "the end of the quarantine")


def test_a_database_deleted_while_the_service_runs_is_noticed_and_rescued(own_server: Server) -> None:
    own_server.environment["FREDHOLM_HEARTBEAT_SECONDS"] = "0.3"
    own_server.start()
    done = own_server.wait_ended(own_server.submit({"spp": 4}, {"width": 8, "height": 8})["id"])
    running = own_server.submit(LONG)["id"]
    own_server.wait(running, lambda job: job["frame_seq"] > 1)
    path = own_server.data_dir / "fredholm.sqlite"
    for one in own_server.data_dir.glob("fredholm.sqlite*"):
        one.unlink()
    answers = [httpx.post(f"{own_server.url}/api/jobs", json=BODY, timeout=30) for _ in range(5)]
    assert {answer.status_code for answer in answers} == {503}
    assert "deleted" in answers[0].json()["detail"]
    upload = httpx.post(f"{own_server.url}/api/scenes", files={"file": ("a.xml", PLAIN_SCENE)}, timeout=60)
    assert upload.status_code == 503
    ready = httpx.get(f"{own_server.url}/readyz")
    assert ready.status_code == 503
    assert "deleted" in " ".join(ready.json()["not_ready"])
    assert not path.exists(), "no empty database takes its place"
    rescued = path.with_name("fredholm.sqlite.rescued")
    wait_for(rescued.exists, 60, "a copy of what the deleted file held")
    own_server.stop()
    assert "Application shutdown failed" not in own_server.log_path.read_text()
    assert "fredholm.sqlite.rescued" in refusal(own_server)
    rescued.rename(path)
    own_server.start()
    assert own_server.job(done["id"])["state"] == "succeeded"
    assert httpx.get(f"{own_server.url}/api/jobs/{done['id']}/image.png").status_code == 200
    own_server.wait(running, lambda job: job["state"] == "running" and job["frame_seq"] > 1)
    own_server.cancel(running)


def test_another_file_in_the_place_of_the_database_is_noticed(own_server: Server, tmp_path: Path) -> None:
    own_server.start()
    own_server.wait_ended(own_server.submit({"spp": 4}, {"width": 8, "height": 8})["id"])
    path = own_server.data_dir / "fredholm.sqlite"
    shutil.copy(path, tmp_path / "other.sqlite")
    os.replace(tmp_path / "other.sqlite", path)
    answer = httpx.post(f"{own_server.url}/api/jobs", json=BODY, timeout=30)
    assert answer.status_code == 503
    assert httpx.get(f"{own_server.url}/readyz").status_code == 503


def test_a_postgresql_database_dropped_and_made_anew_is_noticed(own_server: Server, postgres: Postgres) -> None:
    url = own_server.environment["FREDHOLM_DATABASE_URL"] = postgres.new_database()
    own_server.start()
    own_server.wait_ended(own_server.submit({"spp": 4}, {"width": 8, "height": 8})["id"])
    address, _, name = url.rpartition("/")
    for statement in (f"DROP DATABASE {name} WITH (FORCE)", f"CREATE DATABASE {name}"):
        postgres._run("psql", "-q", "-c", statement, f"{address}/postgres")
    # The first may meet connections that are closed; none may be acknowledged.
    answers = [httpx.post(f"{own_server.url}/api/jobs", json=BODY, timeout=30) for _ in range(4)]
    assert {answer.status_code for answer in answers} == {503}
    ready = httpx.get(f"{own_server.url}/readyz").json()["not_ready"]
    assert any("another" in what or "replaced" in what for what in ready), ready


def test_only_its_user_can_look_into_the_data_folder(own_server: Server) -> None:
    own_server.data_dir.mkdir(mode=0o755)
    own_server.data_dir.chmod(0o755)
    own_server.start()
    assert stat.S_IMODE(own_server.data_dir.stat().st_mode) == 0o700


def test_a_deleted_lock_file_lets_no_second_service_start(own_server: Server) -> None:
    own_server.start()
    (own_server.data_dir / "lock").unlink()
    assert "another Fredholm service uses" in refusal(own_server)
