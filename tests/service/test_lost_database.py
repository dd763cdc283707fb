"""A database that goes away for a while: the service says so, and no job is lost or changed."""

from __future__ import annotations

import contextlib
import time
from pathlib import Path

import httpx
import numpy as np
import pytest
from postgres import MISSING, Postgres, is_installed
from service_process import Server, wait_for

import renderer


@pytest.mark.skipif(not is_installed(), reason=MISSING)
def test_a_database_that_crashes_and_comes_back_costs_no_job(own_server: Server, tmp_path: Path) -> None:
    with contextlib.ExitStack() as ends:
        database = Postgres().start()
        ends.callback(database.stop)
        own_server.environment |= {
            "FREDHOLM_DATABASE_URL": database.new_database(),
            "FREDHOLM_HEARTBEAT_SECONDS": "0.5",
        }
        server = own_server.start()
        ends.callback(server.stop)
        job_id = server.submit({"spp": 512})["id"]
        server.wait(job_id, lambda job: job["frame_seq"] > 1)
        database.halt()
        answer = httpx.get(f"{server.url}/api/jobs", timeout=30)
        assert answer.status_code == 503
        assert answer.json()["title"] == "The database does not answer"
        assert answer.headers["Retry-After"]
        assert "the database does not answer" in httpx.get(f"{server.url}/readyz").json()["not_ready"]
        assert httpx.get(f"{server.url}/healthz").status_code == 200
        time.sleep(1.5)
        database.resume()
        wait_for(lambda: httpx.get(f"{server.url}/readyz").status_code == 200, 60, "readiness")
        ended = server.wait_ended(job_id)
        assert ended["state"] == "succeeded", ended
        mine = renderer.Estimate.read(next((server.data_dir / "estimates" / job_id).iterdir()))
    calm = renderer.render("cornell-box", renderer.Target(spp=512), renderer.Settings(64, 64, 1))
    assert np.array_equal(mine.moments.mean, calm.moments.mean)
