"""`make package-check`: the wheel and the sdist as a stranger gets them, each in an empty virtual environment.

    python -m tests.empty_environment dist/fredholm-0.1.0-py3-none-any.whl dist/fredholm-0.1.0.tar.gz

The renderer alone: it imports under both names, renders, and has no web server, which `fredholm serve` says. With the
extra `service`, the same environment serves the page and renders a job. The sdist, without Node, makes the same wheel.
"""

from __future__ import annotations

import argparse
import os
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request
import venv
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LOCK = ROOT / "docker" / "requirements.lock"

RENDER = """
import importlib.util
import fredholm, renderer
assert fredholm.render is renderer.render and fredholm.Estimate is renderer.Estimate
assert "site-packages" in fredholm.__file__, fredholm.__file__
for name in ("fastapi", "uvicorn", "sqlalchemy"):
    assert importlib.util.find_spec(name) is None, name
estimate = fredholm.render("furnace", fredholm.Target(spp=64), fredholm.Settings(width=32, height=32))
assert abs(estimate.mean.mean() - 0.5) < 0.2, estimate.mean.mean()
print(fredholm.__version__)
"""
JOB = """
import sys
from fredholm.client import Client
client = Client(sys.argv[1])
job = client.submit("furnace", spp=16, width=32, height=32)
*_, last = client.watch(job.id)
assert client.job(job.id).state == "succeeded", client.job(job.id)
"""


class Environment:
    """An empty virtual environment, used from a folder where nothing of ours lies."""

    def __init__(self, folder: Path) -> None:
        venv.create(folder / "venv", with_pip=True)
        self.folder = folder
        self.bin = folder / "venv" / ("Scripts" if sys.platform == "win32" else "bin")
        hidden = ("PYTHONPATH", "VIRTUAL_ENV", "FREDHOLM_SKIP_PAGE")
        self.variables = {k: v for k, v in os.environ.items() if k not in hidden}

    def install(self, what: str) -> None:
        """Install with the versions that were tested."""
        print(f"  pip install {what.replace(str(ROOT), '')}", flush=True)
        self.must(self.python("-m", "pip", "install", "--quiet", "-c", str(LOCK), what))

    def python(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        return self.run(str(self.bin / "python"), *arguments)

    def fredholm(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        return self.run(str(self.bin / "fredholm"), *arguments)

    def run(self, *command: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(command, cwd=self.folder, env=self.variables, capture_output=True, text=True)

    def must(self, done: subprocess.CompletedProcess[str], code: int = 0, says: str = "") -> str:
        """What a command said; ends the check where it ended or spoke otherwise."""
        text = done.stdout + done.stderr
        if done.returncode != code or says not in " ".join(text.split()):
            sys.exit(f"{done.args} ended with {done.returncode} (wanted {code}, and {says!r}):\n{text}")
        return done.stdout.strip()


def check_renderer(here: Environment, wheel: Path) -> None:
    """The renderer alone."""
    here.install(str(wheel))
    version = here.must(here.python("-c", RENDER))
    assert f"-{version}-" in wheel.name, (version, wheel.name)
    here.must(here.fredholm("--version"), says=f"fredholm {version}")
    here.must(here.fredholm("render", "furnace", "--spp", "16", "--width", "32", "-o", "out.exr"))
    assert (here.folder / "out.exr").stat().st_size > 1000
    for command in (("serve", "--no-open"), ("key", "list")):
        here.must(here.fredholm(*command), code=2, says="pip install 'fredholm[service]'")
    here.must(here.python("-c", "import fredholm.client"), code=1, says="pip install 'fredholm[service]'")
    print("  renders alone, and says how to get the service")


def check_service(here: Environment, wheel: Path) -> None:
    """The same environment, with the extra."""
    here.install(f"{wheel}[service]")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    url = f"http://127.0.0.1:{port}"
    command = [str(here.bin / "fredholm"), "serve", "--no-open", "--port", str(port), "--data", "data"]
    with (here.folder / "log").open("wb") as log:
        server = subprocess.Popen(command, cwd=here.folder, env=here.variables, stdout=log, stderr=log)
    try:
        wait_for(f"{url}/readyz", server, here.folder / "log")
        with urllib.request.urlopen(url) as page:
            assert b"<script" in page.read(), "the page is not in the wheel"
        here.must(here.python("-c", JOB, url))
    finally:
        server.terminate()
        server.wait()
    print("  serves the page and renders a job")


def wait_for(url: str, server: subprocess.Popen[bytes], log: Path) -> None:
    """Until the service answers."""
    for _ in range(600):
        if server.poll() is not None:
            break
        try:
            urllib.request.urlopen(url).close()
            return
        except OSError:
            time.sleep(0.2)
    sys.exit(f"fredholm serve did not answer at {url}:\n{log.read_text()}")


def check_sdist(here: Environment, sdist: Path, wheel: Path) -> None:
    """The sdist makes the wheel's files. Its page is built already: Node is not asked for."""
    here.must(here.python("-m", "pip", "wheel", "--quiet", "--no-deps", "-w", "made", str(sdist)))
    (made,) = (here.folder / "made").glob("*.whl")
    ours, theirs = (contents(file) for file in (wheel, made))
    assert ours == theirs, {name for name in ours.keys() | theirs.keys() if ours.get(name) != theirs.get(name)}
    print(f"  the sdist makes the same wheel: {len(ours)} files")


def contents(wheel: Path) -> dict[str, int]:
    """Name → checksum of every file in a wheel."""
    with zipfile.ZipFile(wheel) as archive:
        return {file.filename: file.CRC for file in archive.infolist()}


def main() -> None:
    """Check what `make wheel sdist` made."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("wheel", type=Path)
    parser.add_argument("sdist", type=Path)
    given = parser.parse_args()
    wheel, sdist = given.wheel.resolve(), given.sdist.resolve()
    with tempfile.TemporaryDirectory() as folder:
        here = Environment(Path(folder))
        print(f"{wheel.name}, {sdist.name} with Python {sys.version.split()[0]} on {sys.platform}", flush=True)
        check_sdist(here, sdist, wheel)
        check_renderer(here, wheel)
        check_service(here, wheel)


if __name__ == "__main__":
    main()
