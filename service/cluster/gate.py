"""The server's side: takes passes from its render process to the cluster, and answers back.

It has a thread and an event loop of its own, so that no request waits for it. Whatever happens to the scheduler or to a
worker, a pass is asked for again until it has an answer; nothing is known here that would be missed.
"""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import os
import threading
import uuid
from collections import Counter
from collections.abc import Coroutine
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import structlog

from service.cluster.scenes import PART_BYTES, SceneRefused, id_of, packed
from service.cluster.security import ClusterError, security_for
from service.cluster.wire import FRAME, MOST_BYTES, BadMessage, pack, unpack
from service.engine.turn import Failure

if TYPE_CHECKING:
    from distributed import Client

_LOOK_SECONDS = 0.5  # between two looks at who works
_ANSWER_SECONDS = 10.0  # for the scheduler to answer
_PART_SECONDS = 300.0  # for a worker to take a part of a scene: it may be rendering
_PATIENCE_SECONDS = 3.0  # that a pass which nobody wants may go on
_LONGEST_SOCKET_PATH = 100
_MOST_TRIES = 100  # of one pass, of which each follows a loss


def tag_of(made_with: str) -> str:
    """The resource that workers of a kind have: equal tags render equal bits."""
    return f"fredholm-{hashlib.sha256(made_with.encode()).hexdigest()[:16]}"


@dataclass(frozen=True, slots=True)
class WorkerSeen:
    """A worker as the scheduler knows it. tags: of its kind. passes: that it renders or holds. rendered: so far."""

    name: str
    tags: frozenset[str]
    passes: int
    rendered: int


@dataclass(slots=True, eq=False)
class _Head:
    """A render process that asks. tag: of the workers that it may use. passes: on their way, by number."""

    writer: asyncio.StreamWriter
    tag: str = ""
    passes: dict[int, asyncio.Task[None]] = field(default_factory=dict)

    def send(self, message: bytes) -> None:
        """To the render process."""
        self.writer.write(FRAME.pack(len(message)) + message)


class Gate:
    """Between the render process and the cluster. socket: path on which it listens."""

    def __init__(
        self, address: str, certificates: Path | None, socket: Path, scenes_dir: Path, crash_limit: int
    ) -> None:
        if len(os.fsencode(socket)) > _LONGEST_SOCKET_PATH:
            raise ClusterError(f"{socket} is too long for a socket; choose a data folder with a shorter path")
        self.socket, self.scenes_dir = socket, scenes_dir
        self._address, self._crash_limit = address, crash_limit
        self._security = security_for("service", certificates)
        self._client: Client | None = None
        self._is_connected = asyncio.Event()
        self._heads: set[_Head] = set()
        self._workers: tuple[WorkerSeen, ...] = ()
        self._is_reached = False
        self._rendered_by: Counter[str] = Counter()
        self.sent_bytes = self.received_bytes = 0  # of messages about passes
        self._sending: dict[tuple[str, str], asyncio.Task[None]] = {}
        self._unwanted: set[str] = set()
        self._background: set[asyncio.Task[None]] = set()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread: threading.Thread | None = None
        self._end = asyncio.Event()
        self._log = structlog.get_logger("service.cluster")

    # ------------------------------ what the server asks ------------------------------

    def start(self) -> None:
        """Listen, and look for the scheduler. Synchronous."""
        is_listening = threading.Event()
        self._thread = threading.Thread(
            target=lambda: asyncio.run(self._run(is_listening)), name="cluster", daemon=True
        )
        self._thread.start()
        is_listening.wait()

    def stop(self) -> None:
        """Leave the cluster. Synchronous."""
        if self._loop is not None and self._thread is not None:
            with contextlib.suppress(RuntimeError):  # it has ended
                self._loop.call_soon_threadsafe(self._end.set)
            self._thread.join(10.0)

    def workers(self) -> tuple[WorkerSeen, ...]:
        """Those that the scheduler knew when last looked."""
        return self._workers

    def is_usable(self, worker: WorkerSeen) -> bool:
        """Whether it is of the kind that this service's pictures need, as far as that is known yet."""
        tags = {head.tag for head in list(self._heads)}
        return not tags or bool(worker.tags & tags)

    def missing(self) -> str | None:
        """What keeps passes from being rendered, in words; None if nothing does."""
        if not self._is_reached:
            return f"the cluster's scheduler at {self._address} does not answer"
        if not self._workers:
            return "no worker has joined the cluster"
        if not any(map(self.is_usable, self._workers)):
            return "the cluster's workers have other versions or another kind of device than this machine"
        return None

    # ------------------------------ the scheduler ------------------------------

    async def _run(self, is_listening: threading.Event) -> None:
        self._loop = asyncio.get_running_loop()
        server = await asyncio.start_unix_server(self._serve, self.socket)
        is_listening.set()
        watch = asyncio.create_task(self._watch())
        await self._end.wait()
        watch.cancel()
        await asyncio.wait([watch], timeout=4)
        server.close()
        for head in self._heads:
            head.writer.close()
        await self._disconnect()

    async def _watch(self) -> None:
        """Keep a client connected, and know the workers."""
        while True:
            try:
                scheduler: Any = (self._client or await self._connect()).scheduler
                told = await asyncio.wait_for(scheduler.identity(n_workers=-1), _ANSWER_SECONDS)
                self._see(told["workers"])
            except Exception as error:
                if self._is_reached:
                    self._log.warning("the scheduler is lost; looking for it", cause=f"{type(error).__name__}: {error}")
                await self._disconnect()
            await asyncio.sleep(_LOOK_SECONDS)

    async def _connect(self) -> Client:
        from distributed import Client

        how = {"asynchronous": True, "set_as_default": False, "timeout": _ANSWER_SECONDS, "name": "fredholm"}
        client: Any = Client(self._address, security=self._security, **how)
        try:
            await client
        except BaseException:
            with contextlib.suppress(Exception):
                await asyncio.wait_for(client.close(timeout=1), 3)
            raise
        self._client = client
        self._is_reached = True
        self._is_connected.set()
        self._log.info("cluster reached", scheduler=self._address)
        return client

    async def _disconnect(self) -> None:
        self._is_reached = False
        self._is_connected.clear()
        self._see({})
        client: Any = self._client
        self._client = None
        if client is not None:
            with contextlib.suppress(Exception):
                await asyncio.wait_for(client.close(timeout=1), 3)

    def _see(self, workers: dict[str, Any]) -> None:
        before = {worker.name for worker in self._workers}
        self._workers = tuple(
            WorkerSeen(
                str(worker["name"]),
                frozenset(worker.get("resources", ())),
                _passes(worker.get("metrics", {})),
                self._rendered_by[str(worker["name"])],
            )
            for worker in workers.values()
        )
        for name in set(self._rendered_by) - {worker.name for worker in self._workers}:
            del self._rendered_by[name]
        if (now := {worker.name for worker in self._workers}) != before:
            self._log.info("workers of the cluster", joined=sorted(now - before), left=sorted(before - now))
            for head in self._heads:
                self._tell_places(head)

    def _tell_places(self, head: _Head) -> None:
        head.send(pack({"places": sum(head.tag in worker.tags for worker in self._workers)}))

    # ------------------------------ render processes ------------------------------

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        head = _Head(writer)
        self._heads.add(head)
        try:
            while True:
                (size,) = FRAME.unpack(await reader.readexactly(FRAME.size))
                if size > MOST_BYTES:
                    raise BadMessage(f"{size} bytes are no message")
                message = await reader.readexactly(size)
                self._heed(head, unpack(message)[0], message)
                await writer.drain()
        except (asyncio.IncompleteReadError, OSError):
            pass  # the process has ended
        except (ValueError, KeyError, TypeError) as error:
            self._log.error("the render process said what is no message", cause=str(error))
        finally:
            self._heads.discard(head)
            for task in head.passes.values():
                task.cancel()
            writer.close()

    def _heed(self, head: _Head, told: dict[str, Any], message: bytes) -> None:
        match told["do"]:
            case "hello":
                head.tag = tag_of(told["made_with"])
                self._tell_places(head)
            case "render":
                number = int(told["number"])
                head.passes[number] = asyncio.create_task(self._answer(head, number, told, message))
            case "drop":
                if (task := head.passes.get(int(told["number"]))) is not None:
                    task.cancel()
            case other:
                raise BadMessage(f"nobody does {other!r}")

    async def _answer(self, head: _Head, number: int, told: dict[str, Any], message: bytes) -> None:
        """See a pass through, whatever gets lost."""
        name = f"pass-{uuid.uuid4().hex}"
        try:
            answer = await self._rendered(head, name, told, message)
            self.sent_bytes, self.received_bytes = self.sent_bytes + len(message), self.received_bytes + len(answer)
            said, arrays = unpack(answer)
            self._rendered_by[said.pop("worker", "")] += said["state"] == "done"
            head.send(pack(said | {"number": number}, **arrays))
        except SceneRefused as error:
            head.send(
                _failed(number, Failure("The scene could not be read", f"{error}.".capitalize(), "Upload it again."))
            )
        except asyncio.CancelledError:
            self._give_up(name)
            raise
        except Exception as error:
            self._log.exception("a pass could not be asked for")
            detail = f"The cluster could not be asked: {type(error).__name__}."
            head.send(_failed(number, Failure("Rendering failed", detail, "The log of the service has the details.")))
        finally:
            head.passes.pop(number, None)

    async def _rendered(self, head: _Head, name: str, told: dict[str, Any], message: bytes) -> bytes:
        losses, tries = 0, 0
        while True:
            tries += 1
            if tries > _MOST_TRIES:
                raise ClusterError(f"a pass was asked for {_MOST_TRIES} times, and no answer came")
            answer = await self._asked(head.tag, name, f"{name}-{tries}", told["priority"], message)
            if answer is None:
                continue
            found = unpack(answer)[0]
            if found["state"] == "missing":
                await self._provide(found["worker"], told["job"]["scene"])
            elif found["state"] == "lost":
                losses += 1
                self._log.warning(
                    "a worker lost its render process", why=found["why"], words=found["words"], times=losses
                )
                if losses >= self._crash_limit:
                    return _lost(losses, found["why"], found["words"])
            else:
                return answer

    async def _asked(self, tag: str, name: str, key: str, priority: int, message: bytes) -> bytes | None:
        """What the cluster answers; None where it must be asked again."""
        from distributed import KilledWorker

        from service.cluster import task

        await self._is_connected.wait()
        if (client := self._client) is None:
            return None
        how: dict[str, Any] = {"key": key, "pure": False, "resources": {tag: 1}, "priority": priority}
        future: Any = None
        try:
            future = client.submit(task.render, name, message, **how)
            return await future
        except asyncio.CancelledError:
            current = asyncio.current_task()
            if current is not None and current.cancelling():
                self._spawn(_cancelled(future))
                raise
            self._log.info("a pass is asked for again: the scheduler went, with all that it knew")
            await asyncio.sleep(_LOOK_SECONDS)
        except KilledWorker:
            return pack({"state": "lost", "why": "each time the worker that rendered it died", "words": ""})
        except Exception as error:  # of the way there and back: what befalls a pass is an answer
            self._log.warning("a pass is asked for again", cause=f"{type(error).__name__}: {error}")
            await asyncio.sleep(_LOOK_SECONDS)
        finally:
            if future is not None:
                future.release()
        return None

    def _give_up(self, name: str) -> None:
        """End a pass that nobody wants and that goes on all the same."""
        if not self._unwanted:
            self._spawn(self._end_unwanted())
        self._unwanted.add(name)

    async def _end_unwanted(self) -> None:
        from service.cluster import task

        await asyncio.sleep(_PATIENCE_SECONDS)
        names, self._unwanted = self._unwanted, set()
        if self._client is not None:
            with contextlib.suppress(Exception):
                await self._client.run(task.give_up, names, on_error="ignore")

    # ------------------------------ scenes ------------------------------

    async def _provide(self, worker: str, scene: str) -> None:
        """Send a worker the files of a scene, once."""
        key = worker, id_of(scene)
        if key not in self._sending:
            self._sending[key] = asyncio.create_task(self._send_scene(worker, scene))
            self._sending[key].add_done_callback(lambda _: self._sending.pop(key, None))
        # Shielded: others may wait for it too.
        await asyncio.shield(self._sending[key])

    async def _send_scene(self, worker: str, scene: str) -> None:
        from service.cluster import task

        file = await asyncio.to_thread(packed, self.scenes_dir, scene)
        try:
            part, at = await asyncio.to_thread(file.read, PART_BYTES), 0
            while part and (client := self._client) is not None:
                following = await asyncio.to_thread(file.read, PART_BYTES)
                how: dict[str, Any] = {"workers": [worker], "pure": False, "priority": 2}
                taken = client.submit(task.take_scene, scene, at, part, not following, **how)
                await asyncio.wait_for(taken, _PART_SECONDS)
                at, part = at + len(part), following
        except SceneRefused:
            raise
        except Exception as error:  # whoever needs it asks again
            self._log.warning("a scene did not reach a worker", worker=worker, cause=f"{type(error).__name__}: {error}")
            await asyncio.sleep(_LOOK_SECONDS)
        else:
            self._log.info("scene sent", scene=id_of(scene), worker=worker, bytes=at)
        finally:
            file.close()

    def _spawn(self, what: Coroutine[Any, Any, None]) -> None:
        running = asyncio.get_running_loop().create_task(what)
        self._background.add(running)
        running.add_done_callback(self._background.discard)


async def _cancelled(future: Any) -> None:
    if future is not None:
        with contextlib.suppress(Exception):
            await future.cancel()


def _passes(metrics: dict[str, Any]) -> int:
    counts = metrics.get("task_counts", {})
    return sum(int(counts.get(state, 0)) for state in ("executing", "ready", "constrained"))


def _failed(number: int, failure: Failure) -> bytes:
    from service.cluster.render_pass import failed

    told, _ = unpack(failed(failure))
    return pack(told | {"number": number})


def _lost(losses: int, why: str, words: str) -> bytes:
    from service.cluster.render_pass import failed
    from service.crashes import failure_of_losses
    from service.engine.interface import Lost

    failure = failure_of_losses(losses, losses, Lost(why, words))
    assert failure is not None
    return failed(failure)
