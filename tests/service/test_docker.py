"""docker/ says what settings.py, pyproject.toml and the command line say. No docker is needed for that."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
import tomllib
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

import pytest
import yaml
from service_process import ROOT, Server
from typer.testing import CliRunner

from service.cluster.security import check_address
from service.command.main import app
from service.settings import ServiceSettings

DOCKERFILE = (ROOT / "docker" / "Dockerfile").read_text()
INSTRUCTIONS = [
    (line.split(maxsplit=1)[0], line.split(maxsplit=1)[1])
    for line in re.sub(r"\\\n\s*", "", DOCKERFILE).splitlines()
    if line and line[0] not in "# "
]
TYPER = CliRunner(env={"COLUMNS": "200", "NO_COLOR": "1", "TERM": "dumb"})
PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text())
COMPOSE: dict[str, Any] = yaml.safe_load((ROOT / "docker" / "compose.yaml").read_text())


def said(instruction: str) -> list[str]:
    return [rest for name, rest in INSTRUCTIONS if name == instruction]


def environment() -> dict[str, str]:
    return dict(pair.split("=", 1) for rest in said("ENV") for pair in shlex.split(rest))


def test_the_environment_of_the_image_is_one_that_the_service_understands(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in os.environ if name.startswith("FREDHOLM_")]:
        monkeypatch.delenv(name)
    given = environment() | COMPOSE["services"]["fredholm"]["environment"]
    ours = {name: value for name, value in given.items() if name.startswith("FREDHOLM_")}
    assert {name.removeprefix("FREDHOLM_").lower() for name in ours} <= set(ServiceSettings.model_fields)
    for name, value in ours.items():
        monkeypatch.setenv(name, value)
    settings = ServiceSettings()
    assert settings.are_keys_required
    assert said("EXPOSE") == [str(settings.port)]
    assert said("VOLUME") == [str(settings.data_dir)] == [environment()["HOME"]]
    fredholm = COMPOSE["services"]["fredholm"]
    assert [mount.partition(":")[2] for mount in fredholm["volumes"]] == [str(settings.data_dir)]
    assert [port.rpartition(":")[2] for port in fredholm["ports"]] == [str(settings.port)]


def test_compose_names_only_what_it_has() -> None:
    volumes = {mount.partition(":")[0] for service in COMPOSE["services"].values() for mount in service["volumes"]}
    assert volumes == set(COMPOSE["volumes"])
    for service in COMPOSE["services"].values():
        assert set(service.get("depends_on", ())) <= set(COMPOSE["services"])
    build = COMPOSE["services"]["fredholm"]["build"]
    assert (ROOT / "docker" / build["context"]).resolve() == ROOT
    assert (ROOT / build["dockerfile"]).is_file()
    database = COMPOSE["services"]["database"]["environment"]
    url = f"postgresql://{database['POSTGRES_USER']}:{database['POSTGRES_PASSWORD']}@database/{database['POSTGRES_DB']}"
    assert COMPOSE["services"]["fredholm"]["environment"]["FREDHOLM_DATABASE_URL"] == url


def test_the_image_installs_what_the_package_needs_and_no_more() -> None:
    command = [sys.executable, "docker/dependencies.py"]
    told = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.splitlines()
    extras = PROJECT["project"]["optional-dependencies"]
    needed = PROJECT["project"]["dependencies"] + extras["service"] + extras["postgres"] + extras["cluster"]
    assert told == [line for line in needed if not line.startswith("fredholm[")]


def test_what_is_copied_and_built_is_let_through() -> None:
    ignored = True

    def is_let_through(path: str) -> bool:
        nonlocal ignored
        parents = [path, *map(str, Path(path).parents)]
        for line in (ROOT / ".dockerignore").read_text().splitlines():
            pattern = line.removeprefix("!")
            if line and line[0] != "#" and any(fnmatch(one, pattern.removeprefix("**/")) for one in parents):
                ignored = not line.startswith("!")
        return not ignored

    copied = [path for rest in said("COPY") if "--from" not in rest for path in rest.split()[:-1] if path != "."]
    built = PROJECT["tool"]["hatch"]["build"]
    needed = [*copied, *built["targets"]["wheel"]["only-include"], built["hooks"]["custom"]["path"], "web/package.json"]
    needed += ["pyproject.toml", PROJECT["project"]["readme"], *PROJECT["project"]["license-files"]]
    assert [path for path in needed if not (ROOT / path).exists() or not is_let_through(path)] == []
    assert not is_let_through("service/static/index.html"), "the page is built in the image"
    assert not is_let_through("tests/service/test_docker.py")
    assert not is_let_through(".git/config")


def test_the_image_starts_the_command_and_its_health_check_tells_health(server: Server) -> None:
    entry, command = (yaml.safe_load(said(name)[-1]) for name in ("ENTRYPOINT", "CMD"))
    assert set(entry) <= set(PROJECT["project"]["scripts"])
    shown = subprocess.run(
        [sys.executable, "-c", "from service.command.main import main; main()", *command, "--help"],
        capture_output=True,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )
    assert shown.returncode == 0, shown.stderr
    check = yaml.safe_load(re.split(r"\bCMD\b", said("HEALTHCHECK")[0])[1])
    assert check[0] == "python"

    def status(port: int) -> int:
        given = os.environ | {"FREDHOLM_PORT": str(port)}
        return subprocess.run([sys.executable, *check[1:]], env=given, capture_output=True).returncode

    assert status(server.port) == 0
    assert status(9) == 1, "nothing listens there"


def test_the_cluster_beside_it_names_commands_settings_and_files_that_there_are() -> None:
    added: dict[str, Any] = yaml.safe_load((ROOT / "docker" / "cluster.yaml").read_text())
    services = added["services"]
    known = COMPOSE["services"].keys() | services.keys()
    for name, service in services.items():
        assert set(service.get("depends_on", ())) <= known
        named = {mount.partition(":")[0] for mount in service["volumes"] if not mount.startswith("/")}
        assert named <= added["volumes"].keys() | COMPOSE["volumes"].keys()
        secured = [mount for mount in service["volumes"] if mount.endswith("/certificates:ro")]
        assert bool(secured) == (name != "certificates")
    given = services["fredholm"]["environment"]
    assert {one.removeprefix("FREDHOLM_").lower() for one in given} <= set(ServiceSettings.model_fields)
    address = given["FREDHOLM_CLUSTER"]
    host, port = check_address(address, Path(given["FREDHOLM_CLUSTER_CERTIFICATES"]))
    assert host in services
    assert str(port) in services[host]["healthcheck"]["test"][-1]
    assert address in services["worker"]["command"]
    for name in ("certificates", "scheduler", "worker"):
        assert services[name]["image"] == COMPOSE["services"]["fredholm"]["image"]
        command = services[name]["command"]
        told = TYPER.invoke(app, [*command[: 2 if command[0] == "cluster" else 1], "--help"])
        assert told.exit_code == 0, told.output
        for option in (part for part in command if part.startswith("--")):
            assert option in told.output
