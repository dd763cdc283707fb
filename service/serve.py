"""Runs the service: `fredholm serve`."""

from __future__ import annotations

import contextlib
import errno
import os
import socket
import sys
import threading
import webbrowser
from pathlib import Path

import structlog
import uvicorn
from fastapi import FastAPI
from pydantic import ValidationError

from renderer.errors import FredholmError
from service.app import create_app
from service.data_lock import DataFolderInUse, DataLock
from service.logs import configure
from service.settings import ServiceSettings

_GRACE_SECONDS = 2


class ServeError(FredholmError):
    """The service cannot start."""


class _Server(uvicorn.Server):
    """A server that ends its event streams before it waits for connections to close."""

    def __init__(self, config: uvicorn.Config, app: FastAPI) -> None:
        super().__init__(config)
        self._application = app

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        self._application.state.service.close_streams()
        await super().shutdown(sockets=sockets)


def run(
    host: str | None = None, port: int | None = None, data_dir: Path | None = None, open_browser: bool = False
) -> None:
    """Serve until interrupted. What is None comes from the environment or its default. Raises ServeError."""
    given = {"host": host, "port": port, "data_dir": data_dir}
    settings = _settings({name: value for name, value in given.items() if value is not None})
    configure(settings)
    listening = _listen(settings.host, settings.port)
    _check_data_dir(settings.data_dir)
    app = create_app(settings)
    config = uvicorn.Config(
        app, log_config=None, access_log=False, timeout_graceful_shutdown=_GRACE_SECONDS, server_header=False
    )
    address = _address(settings.host, listening.getsockname()[1])
    structlog.get_logger("service").info("serving", address=address, data=str(settings.data_dir))
    print(f"Fredholm is at {address} (Ctrl-C ends it)", flush=True)
    if open_browser and _has_display():
        threading.Timer(0.8, webbrowser.open, [address]).start()
    with contextlib.suppress(KeyboardInterrupt):
        _Server(config, app).run(sockets=[listening])


def _settings(given: dict[str, object]) -> ServiceSettings:
    try:
        return ServiceSettings(**given)  # type: ignore[arg-type]
    except ValidationError as error:
        first = error.errors()[0]
        name = "_".join(str(part) for part in first["loc"]).upper()
        raise ServeError(f"FREDHOLM_{name} is {first['input']!r}: {first['msg']}") from None


def _listen(host: str, port: int) -> socket.socket:
    """Bind before anything else starts, so that a port in use is one clear sentence and not a trace."""
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        listening = socket.socket(family, kind, protocol)
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind(address)
        listening.listen(128)
    except socket.gaierror:
        raise ServeError(f"the host name {host} is not known; use an address of this machine or 127.0.0.1") from None
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            message = f"port {port} on {host} is in use, perhaps by another Fredholm; choose another with --port"
        elif error.errno == errno.EACCES:
            message = f"port {port} needs more rights than this user has; choose one from 1024 on with --port"
        else:
            message = f"cannot listen on {host} port {port}: {error.strerror}"
        raise ServeError(message) from None
    return listening


def _check_data_dir(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = DataLock(folder)
        lock.take()
        lock.release()
    except DataFolderInUse as error:
        raise ServeError(str(error)) from None
    except OSError as error:
        raise ServeError(f"cannot write to {folder}: {error.strerror}; choose another folder with --data") from None


def _address(host: str, port: int) -> str:
    shown = {"0.0.0.0": "127.0.0.1", "::": "[::1]"}.get(host, f"[{host}]" if ":" in host else host)
    return f"http://{shown}:{port}"


def _has_display() -> bool:
    if sys.platform in ("darwin", "win32"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
