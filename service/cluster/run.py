"""Runs a scheduler or a worker until it is told to stop: `fredholm cluster scheduler`, `fredholm worker`."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import shutil
import signal
import socket
import tempfile
from collections.abc import Coroutine
from pathlib import Path
from typing import Any

import structlog

from service.cluster.gate import tag_of
from service.cluster.scenes import DEFAULT_CACHE_BYTES
from service.cluster.security import check_address, check_installed, check_reach, is_loopback, security_for

_WORKER_SILENCE_SECONDS = 30.0  # after which a worker is taken for lost
_AGAIN_SECONDS = 1.0
_START_SECONDS = 300.0  # to import the renderer and compile a small kernel, on a busy machine
_LOOPBACK = "127.0.0.1"
# Dask opens a web server in any case, which asks nobody who they are: here without pages, for this machine alone.
_NO_PAGES = {"dashboard": False, "dashboard_address": f"{_LOOPBACK}:0"}
_NO_ROUTES = {f"distributed.{part}.http.routes": [] for part in ("scheduler", "worker")}


def run_scheduler(host: str, port: int, certificates: Path | None) -> None:
    """Until interrupted. Raises ClusterError."""
    check_installed()
    check_reach(host, certificates)
    security = security_for("scheduler", certificates)

    async def serve(stop: asyncio.Event) -> None:
        from distributed import Scheduler

        how: dict[str, Any] = {"protocol": "tls" if certificates else "tcp"} | _NO_PAGES
        async with Scheduler(
            host=host, port=port, security=security, worker_ttl=_WORKER_SILENCE_SECONDS, **how
        ) as scheduler:
            print(f"The scheduler is at {scheduler.address} (Ctrl-C ends it)", flush=True)
            await stop.wait()

    _run(serve)


def run_worker(
    address: str,
    name: str | None = None,
    folder: Path | None = None,
    host: str | None = None,
    certificates: Path | None = None,
    cache_bytes: int = DEFAULT_CACHE_BYTES,
) -> None:
    """Until interrupted; a scheduler that goes is waited for. folder: for scenes; one that ends with it by default.

    Raises ClusterError.
    """
    check_installed()
    scheduler_host, _ = check_address(address, certificates)
    host = host or (_LOOPBACK if is_loopback(scheduler_host) else None)
    if host is not None:
        check_reach(host, certificates)
    security = security_for("worker", certificates)
    # Read when a process starts: freed memory goes back to the system.
    os.environ.setdefault("MALLOC_TRIM_THRESHOLD_", "65536")
    own = Path(tempfile.mkdtemp(prefix="fredholm-worker-")) if folder is None else folder / (name or "worker")
    told: dict[str, Any] = {"name": name or f"{socket.gethostname()}-{os.getpid()}", "host": host}
    told |= {"security": security, "protocol": "tls" if certificates else "tcp"}
    try:
        _run(lambda stop: _work(stop, address, own, cache_bytes, told))
    finally:
        if folder is None:
            shutil.rmtree(own, ignore_errors=True)


async def _work(stop: asyncio.Event, address: str, folder: Path, cache_bytes: int, told: dict[str, Any]) -> None:
    from service.cluster import task
    from service.cluster.render_pass import kind_of_worker
    from service.engine import worker as renderer

    log = structlog.get_logger("service.cluster").bind(worker=told["name"])
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    place = task.Place(told["name"], folder, cache_bytes)
    task.settle(place)
    try:
        kind = await place.engine.submit(kind_of_worker, deadline=_START_SECONDS)
        await place.engine.submit(renderer.warm_up, deadline=_START_SECONDS)
        log.info("ready to render", made_with=kind)
        while not stop.is_set():
            await _serve(stop, address, folder, told | {"resources": {tag_of(kind): 1}}, log)
    finally:
        place.engine.close()


async def _serve(stop: asyncio.Event, address: str, folder: Path, told: dict[str, Any], log: Any) -> None:
    """One membership of the cluster: it ends with the scheduler, or when this is told to stop."""
    from distributed import Worker

    how: dict[str, Any] = {"nthreads": 1, "memory_limit": 0, "local_directory": str(folder)} | _NO_PAGES
    worker = Worker(address, **how, **told)
    stopped = asyncio.ensure_future(stop.wait())
    try:
        joined = asyncio.ensure_future(_joined(worker))
        await asyncio.wait({joined, stopped}, return_when=asyncio.FIRST_COMPLETED)
        if not joined.done():
            joined.cancel()
        elif (error := joined.exception()) is not None:
            log.warning("the cluster is not reached", scheduler=address, cause=f"{type(error).__name__}: {error}")
        elif not stop.is_set():
            log.warning("the scheduler is gone; waiting for it", scheduler=address)
    finally:
        stopped.cancel()
        with contextlib.suppress(Exception):
            await asyncio.wait_for(worker.close(timeout=2, nanny=False), 5)
    if not stop.is_set():
        await asyncio.sleep(_AGAIN_SECONDS)


async def _joined(worker: Any) -> None:
    await worker
    print(f"The worker {worker.name} is at {worker.address} (Ctrl-C ends it)", flush=True)
    await worker.finished()


def _run(serve: Any) -> None:
    from dask import config

    logging.getLogger("distributed").setLevel(logging.WARNING)
    config.set({"distributed.comm.timeouts.connect": "10s", **_NO_ROUTES})

    async def until_stopped() -> None:
        stop = asyncio.Event()
        for number in (signal.SIGINT, signal.SIGTERM):
            asyncio.get_running_loop().add_signal_handler(number, stop.set)
        serving: Coroutine[Any, Any, None] = serve(stop)
        await serving

    asyncio.run(until_stopped())
