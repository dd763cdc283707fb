"""Facts about who may speak to a cluster: off this machine, holders of its certificates; and what a message may be."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("distributed", reason="the extra cluster is not installed")
pytest.importorskip("cryptography", reason="the extra cluster is not installed")

import psutil
from cluster_processes import Cluster
from service_process import ROOT, Server

from service.cluster.certificates import make_certificates
from service.cluster.scenes import SceneCache, SceneRefused, id_of, packed
from service.cluster.security import ClusterError, check_address, security_for
from service.cluster.wire import BadMessage, narrowed, pack, unpack


@pytest.fixture(scope="module")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("tls") / "certificates"
    make_certificates(folder, 2)
    return folder


@pytest.mark.parametrize(
    "arguments",
    [
        ("cluster", "scheduler", "--host", "0.0.0.0"),
        ("worker", "tcp://farm.example:8786"),
        ("worker", "tcp://127.0.0.1:8786", "--host", "0.0.0.0"),
        ("serve", "--no-open", "--port", "0", "--cluster", "tcp://10.0.0.7:8786"),
    ],
    ids=["scheduler", "worker", "worker listens", "service"],
)
def test_nothing_starts_off_this_machine_without_certificates(tmp_path: Path, arguments: tuple[str, ...]) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "service.command", *arguments],
        cwd=tmp_path,
        env={
            "PATH": "/usr/bin:/bin",
            "HOME": str(tmp_path),
            "PYTHONPATH": str(ROOT),
            "FREDHOLM_DATA_DIR": str(tmp_path),
        },
        capture_output=True,
        text=True,
        timeout=240,
    )
    said = " ".join(done.stderr.split())
    assert done.returncode == 2, said
    assert "could run programs on all machines of the cluster; make some with `fredholm cluster certificates" in said
    assert "Traceback" not in said


def test_addresses_are_checked(certificates: Path) -> None:
    assert check_address("tcp://127.0.0.1:8786", None) == ("127.0.0.1", 8786)
    assert check_address("tcp://[::1]:8786", None) == ("::1", 8786)
    assert check_address("tls://farm:8786", certificates) == ("farm", 8786)
    for address in ("farm:8786", "http://farm:8786", "tcp://127.0.0.1", "tcp://127.0.0.1:x", "tcp://127.0.0.1:1/a", ""):
        with pytest.raises(ClusterError, match="write it as tls://HOST:PORT"):
            check_address(address, certificates)
    with pytest.raises(ClusterError, match="with certificates it begins with tls://"):
        check_address("tcp://127.0.0.1:8786", certificates)
    with pytest.raises(ClusterError, match="without certificates it begins with tcp://"):
        check_address("tls://127.0.0.1:8786", None)


def test_certificates_are_private_renewed_and_missed_by_name(tmp_path: Path) -> None:
    first = {path.name: path.read_bytes() for path in make_certificates(tmp_path / "c", 30)}
    assert {"ca.pem", "ca.key", "scheduler.pem", "worker.key", "service.pem"} <= set(first)
    for name in first:
        mode = (tmp_path / "c" / name).stat().st_mode & 0o777
        assert mode == (0o600 if name.endswith(".key") else 0o644), name
    second = {path.name: path.read_bytes() for path in make_certificates(tmp_path / "c", 30)}
    assert "ca.pem" not in second
    assert all(second[name] != first[name] for name in second)
    for name in second:
        if name.endswith(".pem"):
            chain = ["openssl", "verify", "-CAfile", str(tmp_path / "c" / "ca.pem"), str(tmp_path / "c" / name)]
            assert subprocess.run(chain, capture_output=True).returncode == 0, name
    (tmp_path / "c" / "worker.key").unlink()
    with pytest.raises(ClusterError, match=r"worker\.key is missing; a worker needs ca\.pem, worker\.pem, worker\.key"):
        security_for("worker", tmp_path / "c")
    (tmp_path / "c" / "ca.key").unlink()
    with pytest.raises(ClusterError, match=r"ca\.key is missing beside its other half"):
        make_certificates(tmp_path / "c", 30)


def test_with_certificates_a_picture_is_rendered_and_strangers_are_not_heard(
    certificates: Path, tmp_path: Path
) -> None:
    cluster = Cluster(tmp_path / "cluster", certificates).start("one")
    environment = {
        "FREDHOLM_CLUSTER": cluster.address,
        "FREDHOLM_CLUSTER_CERTIFICATES": str(certificates),
        "FREDHOLM_WARM_UP": "0",
    }
    service = Server(tmp_path / "data", environment)
    try:
        service.start()
        ended = service.wait_ended(service.submit({"spp": 32})["id"], 240)
        assert ended["state"] == "succeeded", ended
        make_certificates(tmp_path / "others", 2)
        assert "no answer" in spoken(cluster.address, tmp_path / "others")
        assert "no answer" in spoken(cluster.address.replace("tls", "tcp"), None)
        assert "workers: 1" in spoken(cluster.address, certificates)
        # Dask's own web server asks nobody who they are: only this machine may reach it.
        for process in (cluster.scheduler, cluster.workers["one"]):
            heard = [one.laddr for one in psutil.Process(process.pid).net_connections() if one.status == "LISTEN"]
            assert heard
            assert {one.ip for one in heard} == {"127.0.0.1"}
    finally:
        service.stop()
        cluster.stop()


SPEAK = """
import asyncio, pathlib, sys
from distributed import Client
from service.cluster.security import security_for
async def speak():
    folder = pathlib.Path(sys.argv[2]) if sys.argv[2] else None
    try:
        security = security_for("service", folder)
        async with Client(sys.argv[1], security=security, asynchronous=True, timeout=4) as client:
            print("workers:", len((await client.scheduler.identity(n_workers=-1))["workers"]))
    except (OSError, TimeoutError) as error:
        print("no answer:", type(error).__name__)
asyncio.run(speak())
"""


def spoken(address: str, certificates: Path | None) -> str:
    done = subprocess.run(
        [sys.executable, "-c", SPEAK, address, str(certificates or "")],
        env={"PATH": "/usr/bin:/bin", "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=120,
    )
    return done.stdout + done.stderr


def test_a_message_is_what_was_packed_and_nothing_else_is_one() -> None:
    arrays = {"a": np.arange(6, dtype=np.float32).reshape(2, 3), "b": narrowed(np.array([3, 255], np.uint32))}
    message = pack({"do": "render", "number": 3}, **arrays)
    told, found = unpack(message)
    assert told == {"do": "render", "number": 3}
    assert found["b"].dtype == np.uint8
    for name, array in arrays.items():
        assert found[name].tobytes() == array.tobytes()
        assert found[name].shape == array.shape
    assert [narrowed(np.array([n])).dtype.itemsize for n in (255, 256, 65535, 65536)] == [1, 2, 2, 4]
    for bad in (b"", message[:-1], message + b"x", message[:9], b"\xff\xff\xff\x7f{}", pack({})[:-1] + b"]"):
        with pytest.raises(BadMessage):
            unpack(bad)
    with pytest.raises(BadMessage, match="type"):
        unpack(message.replace(b"<f4", b"|O8"))


def test_scenes_are_kept_by_their_content_and_the_oldest_go_first(tmp_path: Path) -> None:
    from renderer.scene.bundle import digest_of

    scenes, ids = tmp_path / "scenes", []
    for letter in "abc":
        folder = tmp_path / letter
        folder.mkdir()
        (folder / "scene.xml").write_bytes(letter.encode() * 1000)
        ids.append(digest_of(folder)[:16])
        (scenes / ids[-1]).mkdir(parents=True)
        folder.rename(scenes / ids[-1] / "in")
    cache = SceneCache(tmp_path / "worker", 2500)

    def send(scene: str, part_bytes: int = 700) -> None:
        with packed(scenes, scene) as file:
            content = file.read()
        for at in range(0, len(content), part_bytes):
            part = content[at : at + part_bytes]
            cache.take(scene, at, part, at + len(part) == len(content))

    names = [f"{one}/in/scene.xml" for one in ids]
    for n, name in enumerate(names):
        assert cache.path(name) is None
        send(name)
        found = cache.path(name)
        assert found is not None
        assert found.read_bytes() == b"abc"[n : n + 1] * 1000
    assert cache.path(names[0]) is None, "it made room"
    assert cache.path(names[1]) is not None
    (scenes / ids[0] / "in" / "scene.xml").write_text("changed")
    with pytest.raises(SceneRefused, match="something else"):
        send(names[0])
    assert cache.path(names[0]) is None
    for odd in ("../x/y", f"{ids[0]}/../../y", "cornell-box", f"{ids[0]}/in", "/etc/a/b"):
        with pytest.raises(SceneRefused):
            id_of(odd)
