"""The Python client against the real service."""

from __future__ import annotations

import socket
import threading
import time
from pathlib import Path

import pytest
from service_process import PLAIN_SCENE, SMALL, Server

import renderer
from service.client import Client, ServiceError, ServiceUnreachable
from service.messages import ProgressMessage
from service.states import State


def test_submit_watch_download(server: Server, tmp_path: Path) -> None:
    client = Client(server.url)
    job = client.submit("cornell-box", seconds=1.5, **SMALL)
    told = list(client.watch(job.id))
    assert any(isinstance(one, ProgressMessage) for one in told)
    assert told[-1].state == "succeeded"
    estimate = renderer.Estimate.read(client.download(job.id, tmp_path / "box.exr"))
    assert (estimate.width, estimate.height) == (64, 64)
    assert client.download(job.id, tmp_path / "box.png").read_bytes().startswith(b"\x89PNG")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["box.exr", "box.png"]
    assert job.id in [one.id for one in client.jobs()]
    assert job.id not in [one.id for one in client.jobs(10, State.PAUSED, State.FAILED)]
    assert job.id not in [one.id for one in client.jobs(before=job.id)]
    more = client.go_on(job.id, spp=int(estimate.spp) + 64)
    assert client.wait(more.id).stopped_by == "spp"
    client.delete(job.id)
    with pytest.raises(ServiceError, match="No such job"):
        client.job(job.id)


def test_a_file_is_uploaded_and_rendered(server: Server, tmp_path: Path) -> None:
    path = tmp_path / "ball.xml"
    path.write_text(PLAIN_SCENE.replace("0.4", "0.45"))
    client = Client(server.url)
    job = client.submit(path, spp=4)
    assert job.scene.id is not None
    assert client.wait(job.id).state == "succeeded"
    assert client.submit(job.scene.id, spp=4, seed=2).scene.id == job.scene.id


def test_refusals_are_told_as_they_are(server: Server) -> None:
    with pytest.raises(ServiceError) as caught:
        Client(server.url).submit("no-such-scene", spp=4)
    assert caught.value.problem.status == 422
    assert caught.value.problem.errors


def test_a_watch_outlives_a_restart_of_the_service(own_server: Server) -> None:
    port = own_server.start().port
    client = Client(own_server.url)
    job = client.submit("cornell-box", spp=1024, **SMALL)
    states: list[str] = []
    watcher = threading.Thread(target=lambda: states.extend(one.state for one in client.watch(job.id)), daemon=True)
    watcher.start()
    own_server.wait(job.id, lambda now: now["frame_seq"] > 0)
    own_server.kill()
    time.sleep(0.5)
    own_server.start(port=port)
    watcher.join(60)
    assert not watcher.is_alive()
    assert states[-1] == "succeeded"


def test_a_service_that_is_away_is_told() -> None:
    with pytest.raises(ServiceUnreachable, match="does not answer"):
        Client("http://127.0.0.1:9", timeout=0.2)._json("GET", "/healthz", tries=2)
    with pytest.raises(ValueError, match="http://HOST:PORT"):
        Client("localhost")


def test_a_watch_of_a_job_that_is_deleted_ends(server: Server) -> None:
    client = Client(server.url)
    job = client.submit("cornell-box", seconds=600, **SMALL)
    client.pause(job.id)
    watch = client.watch(job.id)
    assert next(watch).state == "paused"
    threading.Timer(0.3, client.delete, [job.id]).start()
    with pytest.raises(ServiceError, match="No such job"):
        list(watch)


def test_half_a_download_is_no_picture(tmp_path: Path) -> None:
    """A server that is killed while it sends: the first answers end early, the last one is whole."""
    picture, lengths = b"0123456789" * 100, iter((3, 500, 1000))
    with socket.create_server(("127.0.0.1", 0)) as listening:

        def serve() -> None:
            for length in lengths:
                connection, _ = listening.accept()
                with connection:
                    connection.recv(1 << 16)
                    connection.sendall(b"HTTP/1.1 200 OK\r\nContent-Length: 1000\r\n\r\n" + picture[:length])

        threading.Thread(target=serve, daemon=True).start()
        client = Client(f"http://127.0.0.1:{listening.getsockname()[1]}")
        assert client.download("id", tmp_path / "box.exr").read_bytes() == picture
    assert [path.name for path in tmp_path.iterdir()] == ["box.exr"]
