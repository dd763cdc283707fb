"""Runs the service: `fredholm serve`."""

from __future__ import annotations

import contextlib
import errno
import os
import socket
import sys
import threading
import webbrowser
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from types import MappingProxyType

import structlog
import uvicorn
from fastapi import FastAPI
from pydantic import ValidationError
from sqlalchemy.exc import SQLAlchemyError

from renderer.errors import FredholmError
from service.app import create_app
from service.cluster.security import check_address, check_installed, security_for
from service.connections import most_connections
from service.data_folder import make_folder, open_database
from service.data_lock import DataFolderInUse, DataLock
from service.heap import give_back_large_blocks
from service.logs import configure
from service.protocol import protocol_for
from service.settings import ServiceSettings
from service.store import Database, DatabaseError

NO_MORE: Mapping[str, object] = MappingProxyType({})
_GRACE_SECONDS = 2
_DESCRIPTORS = 65536
# Threads that read JSON from the database hold the interpreter for this long before the event loop may answer others.
_THREAD_SECONDS = 0.001


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
    host: str | None = None,
    port: int | None = None,
    data_dir: Path | None = None,
    open_browser: bool = False,
    more: Mapping[str, object] = NO_MORE,
) -> None:
    """Serve until interrupted. more: other settings, by name. What is None comes from the environment or its default.

    Raises ServeError.
    """
    given = {"host": host, "port": port, "data_dir": data_dir, **more}
    give_back_large_blocks()
    settings = settings_from({name: value for name, value in given.items() if value is not None})
    configure(settings)
    _check_reach(settings)
    _check_cluster(settings)
    listening = _listen(settings.host, settings.port)
    _allow_descriptors()
    _check_data(settings)
    app = create_app(settings)
    config = uvicorn.Config(
        app,
        http=protocol_for(settings, most_connections(settings.max_connections)),
        log_config=None,
        access_log=False,
        timeout_graceful_shutdown=_GRACE_SECONDS,
        server_header=False,
        # Whoever is not named could otherwise call itself by any address, and a new one for every guess at a key.
        proxy_headers=bool(settings.trusted_proxies),
        forwarded_allow_ips=settings.trusted_proxies,
    )
    address = _address(settings.host, listening.getsockname()[1])
    structlog.get_logger("service").info("serving", address=address, data=str(settings.data_dir))
    print(f"Fredholm is at {address} (Ctrl-C ends it)", flush=True)
    if open_browser and _has_display():
        threading.Timer(0.8, webbrowser.open, [address]).start()
    sys.setswitchinterval(_THREAD_SECONDS)
    with contextlib.suppress(KeyboardInterrupt):
        _Server(config, app).run(sockets=[listening])


def _allow_descriptors() -> None:
    """As many open connections and files as this user may have: the usual 256 or 1024 are soon taken."""
    try:
        import resource
    except ImportError:  # Windows has no such limit
        return
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = _DESCRIPTORS if most == resource.RLIM_INFINITY else min(most, _DESCRIPTORS)
    with contextlib.suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, most))


def _check_reach(settings: ServiceSettings) -> None:
    if not settings.are_keys_required and not settings.is_loopback:
        raise ServeError(
            f"without API keys anyone who reaches {settings.host} could use this machine; "
            "listen on 127.0.0.1, or leave FREDHOLM_API_KEYS on and create a key with `fredholm key create`"
        )


def _check_cluster(settings: ServiceSettings) -> None:
    if settings.cluster is None:
        return
    check_installed()
    check_address(settings.cluster, settings.cluster_certificates)
    security_for("service", settings.cluster_certificates)


def settings_from(given: dict[str, object]) -> ServiceSettings:
    """Settings from the environment and what is given. Raises ServeError."""
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


def _check_data(settings: ServiceSettings) -> None:
    """Whether folder and database can be used, as one sentence instead of a trace out of the running server."""
    folder = settings.data_dir
    try:
        make_folder(folder)
        lock = DataLock(folder)
        lock.take()
        try:
            with closing(Database(settings.resolved_database_url)) as database:
                open_database(settings, database)
        finally:
            lock.release()
    except (DataFolderInUse, DatabaseError) as error:
        raise ServeError(str(error)) from None
    except OSError as error:
        raise ServeError(f"cannot write to {folder}: {error.strerror}; choose another folder with --data") from None
    except SQLAlchemyError as error:
        cause = str(getattr(error, "orig", None) or error).strip().splitlines()[0]
        raise ServeError(f"the database cannot be used ({cause}); check FREDHOLM_DATABASE_URL") from None


def _address(host: str, port: int) -> str:
    shown = {"0.0.0.0": "127.0.0.1", "::": "[::1]"}.get(host, f"[{host}]" if ":" in host else host)
    return f"http://{shown}:{port}"


def _has_display() -> bool:
    if sys.platform in ("darwin", "win32"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
