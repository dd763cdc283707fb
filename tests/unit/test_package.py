"""Facts about the package: its second name, its extras, and that its version is said in one way."""

from __future__ import annotations

import importlib
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import fredholm
import fredholm.client
import pytest
import yaml

import renderer
import service.client
from service.extras import MODULES, MissingExtra, explained

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def test_fredholm_offers_what_renderer_does() -> None:
    assert fredholm.__all__ == renderer.__all__
    assert all(getattr(fredholm, name) is getattr(renderer, name) for name in renderer.__all__)
    assert importlib.import_module("fredholm.errors") is renderer.errors
    assert fredholm.client.Client is service.client.Client


def test_the_version_is_said_in_one_way() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert fredholm.__version__ == renderer.backend.versions()["fredholm"] == citation["version"] == PROJECT["version"]
    assert citation["license"] == PROJECT["license"]


def module_of(requirement: str) -> str:
    """`pydantic-settings>=2` → pydantic_settings."""
    return re.split(r"[^\w-]", requirement, maxsplit=1)[0].replace("-", "_")


def test_the_extra_service_is_known_module_by_module() -> None:
    modules = {module_of(line) for line in PROJECT["optional-dependencies"]["service"]}
    assert modules | {"starlette"} == MODULES["service"]  # which comes with FastAPI
    assert not modules & {module_of(line) for line in PROJECT["dependencies"]}


RENDERS_WITHOUT = """
import sys
for name in {names!r}:
    sys.modules[name] = None  # an import of it now fails as that of a package that is not there
import fredholm, service.command.main
estimate = fredholm.render("furnace", fredholm.Target(spp=4), fredholm.Settings(width=4, height=4))
assert "uvicorn" not in [n for n, m in sys.modules.items() if m is not None]
sys.argv = ["fredholm", "serve", "--no-open"]
service.command.main.main()
"""


def test_the_renderer_and_its_commands_need_no_web_server() -> None:
    # Typer brings pydantic by itself.
    names = sorted(MODULES["service"] - {"pydantic"})
    done = subprocess.run(
        [sys.executable, "-c", RENDERS_WITHOUT.format(names=names)],
        cwd=ROOT / "service" / "alias",
        env={"PYTHONPATH": str(ROOT), "PATH": ""},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 2, done.stderr
    assert "pip install 'fredholm[service]'" in " ".join(done.stderr.split())


def test_a_module_that_no_extra_brings_stays_a_plain_import_error() -> None:
    with pytest.raises(ModuleNotFoundError, match="nonesuch"), explained("this"):
        importlib.import_module("nonesuch")


def test_the_lack_of_a_driver_names_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "psycopg", None)
    with pytest.raises(MissingExtra, match=r"pip install 'fredholm\[postgres\]'"), explained("this database"):
        importlib.import_module("psycopg")


def test_workflows_run_what_the_repository_has() -> None:
    folder = ROOT / ".github" / "workflows"
    runs = [
        step["run"]
        for file in folder.glob("*.yml")
        for job in yaml.safe_load(file.read_text(encoding="utf-8"))["jobs"].values()
        for step in job["steps"]
        if "run" in step
    ]
    assert ".ci/run" in runs
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    wanted = {target for run in runs for target in re.findall(r"^make ([a-z-]+)", run)}
    assert wanted <= targets, wanted - targets
    assert wanted
