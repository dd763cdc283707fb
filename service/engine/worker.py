"""Runs inside a render process: the only place where scenes are loaded and rendered.

Between calls it keeps compiled scenes and the suspended runs of live jobs. All of it may be lost at any
moment: every call carries what is needed to begin again from the last saved estimate.
"""

from __future__ import annotations

import contextlib
import ctypes
import faulthandler
import logging
import math
import multiprocessing
import os
import shutil
import signal
import threading
import time
import traceback
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from service.display import display_of, write_display
from service.durable_files import digest_of, sync_path
from service.engine import sandbox
from service.engine.turn import Failure, Start, Turn, TurnResult, Unsaved
from service.room import STOKES_CHANNELS, estimate_bytes
from service.store.records import NO_PARAMETERS, Kept, Progress, loaded_as
from service.without_paths import without_paths

if TYPE_CHECKING:
    from renderer import Estimate, Scene, Settings, Snapshot
    from renderer.launcher import Launcher

WARM_UP_SCENE = "cornell-box"
_KEPT_SCENES = 4
_log = logging.getLogger("service.worker")


@dataclass(slots=True)
class _Run:
    """A job's suspended rendering. steps: see `renderer.progress.steps`."""

    steps: Iterator[Snapshot | None]
    scene: Scene
    saved_seconds: float
    last: Snapshot | None = None
    last_seq: int = 0
    saving: Future[Kept] | None = None
    saved: Kept | None = None  # the newest
    start: Start | None = None  # until it is told


_scenes: OrderedDict[tuple[str, str], Scene] = OrderedDict()  # by source and colour
_own_colours: dict[str, str] = {}  # of sources, where none is asked for
_runs: dict[tuple[str, int], _Run] = {}
_NICENESS = 10
_TRIM_SECONDS = 30.0
_trimmed = 0.0  # when the heap was trimmed, on the monotonic clock
# Large estimates take a good part of a second to write: rendering and frames go on meanwhile.
_writer = ThreadPoolExecutor(1, thread_name_prefix="save")


def begin(displays: Path | None, words: Path | None = None) -> None:
    """Set up a fresh process: it must not outlive its server, nor die of Ctrl-C before it.

    words: file that takes its error stream, so that the server can say with which words it died.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _give_way()
    if words is not None:
        with contextlib.suppress(OSError):
            descriptor = os.open(words, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
            os.dup2(descriptor, 2)
            os.close(descriptor)
    faulthandler.enable()
    if not sandbox.has_graphics_driver():
        sandbox.confine_calls(may_start_programs=True)
    if displays is not None:
        # Mitsuba looks for files where the process runs, too: there shall be none.
        empty = displays / "empty"
        empty.mkdir(mode=0o700, parents=True, exist_ok=True)
        os.chdir(empty)
    threading.Thread(target=_exit_with_parent, args=(displays,), name="parent-watch", daemon=True).start()


def _give_way() -> None:
    """Whoever looks at pictures, and the server that sends them, go before whoever makes them.

    Where Linux groups processes by session (sched_autogroup), niceness counts within a session alone: the renderer gets
    one of its own, and that one the niceness.
    """
    if not hasattr(os, "nice"):
        return
    os.nice(_NICENESS)
    with contextlib.suppress(OSError):
        os.setsid()
        Path("/proc/self/autogroup").write_text(str(_NICENESS))


def _exit_with_parent(displays: Path | None) -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        if displays is not None:
            shutil.rmtree(displays, ignore_errors=True)
        os._exit(1)


def warm_up() -> None:
    """Import the renderer, compile and run a small picture, so that the first job need not wait for that."""
    import renderer

    scene = kept_scene(WARM_UP_SCENE, renderer.Settings())
    for _ in renderer.progressive(scene, renderer.Target(error=0.05)):
        break


def end() -> None:
    """End this process; the next call is made in a fresh one."""
    os._exit(0)


def advance(turn: Turn) -> TurnResult:
    """Render one job for about `turn.seconds`, show the newest snapshot, save the estimate if due.

    Where paths are so long that nothing new can be shown yet, the result has no progress.
    """
    key = (turn.job_id, turn.attempt)
    try:
        run, is_new, curve = _render_turn(turn)
        if run.last is None or not is_new:
            saved = None
            with contextlib.suppress(OSError):  # the next snapshot says that there is no room
                saved = _save(run, turn) if turn.save and run.last is not None else None
            return TurnResult(saved=saved)
        run.last_seq = turn.next_seq
        _show(run, Path(turn.display_path))
        start, run.start = run.start, None
        told = TurnResult(progress=_progress(run), curve=curve, warnings=tuple(run.scene.warnings), start=start)
        is_over = run.last.stopped_by is not None
        try:
            saved = _save(run, turn) if is_over or turn.save else _save_beside(run, turn)
        except OSError as error:
            # The run stays: once there is room, what it has is saved, and nothing is rendered twice.
            return replace(told, unsaved=_unsaved(run, error))
    except Exception as error:
        failed = _runs.pop(key, None)
        if failed is not None and failed.saving is not None:
            with contextlib.suppress(Exception):
                failed.saving.result()  # later nobody would look for its file
        return TurnResult(failure=failure_of(error, *_folders_of(turn)))
    if is_over:
        del _runs[key]
    trim_heap()
    return replace(told, saved=saved, stopped_by=run.last.stopped_by)


def _show(run: _Run, path: Path) -> None:
    """Write what the job shows. Without room for it the job goes on unseen."""
    assert run.last is not None
    try:
        write_display(display_of(run.last.estimate, seq=run.last_seq, seconds=run.last.seconds), path)
    except OSError as error:
        _log.warning("a picture cannot be shown: %s", error.strerror or error)


def trim_heap() -> None:
    """Now and then give the system back what freed arrays have left in the heap: glibc keeps it, and over hours the
    process would look as if it leaked.
    """
    global _trimmed
    if time.monotonic() - _trimmed < _TRIM_SECONDS:
        return
    _trimmed = time.monotonic()
    with contextlib.suppress(AttributeError, OSError):  # another C library
        ctypes.CDLL(None).malloc_trim(0)


def retire(turn: Turn) -> TurnResult:
    """Save what a live run has and forget the run. Says nothing if there is no such run."""
    run = _runs.pop((turn.job_id, turn.attempt), None)
    if run is None or run.last is None:
        return TurnResult()
    try:
        return TurnResult(progress=_progress(run), saved=_save(run, turn), warnings=tuple(run.scene.warnings))
    except Exception as error:
        return TurnResult(failure=failure_of(error, *_folders_of(turn)))


def _render_turn(turn: Turn) -> tuple[_Run, bool, tuple[dict[str, float], ...]]:
    """The run, whether there is a new snapshot, and the points of its curve."""
    run = _runs.get((turn.job_id, turn.attempt))
    if run is None:
        return _begin(turn)
    if run.last is not None and run.last.stopped_by is not None:
        return run, True, ()  # it is over, and waits to be saved only
    return run, *_render(run, turn)


def _begin(turn: Turn) -> tuple[_Run, bool, tuple[dict[str, float], ...]]:
    """The first turn of a run: from the newest saved estimate that is sound, or from nothing."""
    import renderer

    damaged: list[tuple[Kept, str]] = []
    for kept in turn.kept:
        try:
            begun = _read(kept, Path(turn.estimates_dir) / kept.name)
            run = _start(turn, begun, Start(kept, tuple(damaged)))
            return run, *_render(run, turn)
        except renderer.errors.CheckpointError as error:
            # Losing samples is better than losing the job; whoever asked for it is told.
            damaged.append((kept, without_paths(str(error), [turn.estimates_dir])))
    run = _start(turn, None, Start(None, tuple(damaged)))
    return run, *_render(run, turn)


def _folders_of(turn: Turn) -> list[str]:
    """Where the files of a job lie."""
    return [turn.estimates_dir, *([] if turn.is_gallery else [str(Path(turn.scene).parent)])]


def _read(kept: Kept, path: Path) -> Estimate:
    """A saved estimate. Raises CheckpointError with the reason why it is not what was saved."""
    import renderer

    try:
        if kept.digest is not None and digest_of(path) != kept.digest:
            raise renderer.errors.CheckpointError("its checksum differs")
        return renderer.Estimate.read(path)
    except FileNotFoundError:
        raise renderer.errors.CheckpointError("its file is missing") from None
    except (renderer.errors.CheckpointError, MemoryError):
        raise
    except Exception as error:
        raise renderer.errors.CheckpointError(f"it cannot be read ({type(error).__name__})") from error


def _start(turn: Turn, begun: Estimate | None, start: Start) -> _Run:
    import renderer

    for key in [key for key in _runs if key[0] == turn.job_id]:
        del _runs[key]
    asked = dict(turn.settings)
    parameters = asked.pop("parameters", {})
    settings = renderer.Settings(**asked)
    scene = kept_scene(turn.scene, settings, parameters)
    from renderer.progress import steps

    launcher = _launcher(turn, parameters) if turn.cluster is not None else None
    snapshots = steps(scene, renderer.Target(**turn.target), settings, start=begun, launcher=launcher)
    run = _runs[turn.job_id, turn.attempt] = _Run(snapshots, scene, 0.0, start=start)
    return run


def _launcher(turn: Turn, parameters: Mapping[str, str]) -> Callable[[Scene, Settings], Launcher]:
    """What has a run's passes rendered on the cluster."""
    from service.cluster.remote import RemoteLauncher, Source, connection

    assert turn.cluster is not None
    cluster = turn.cluster
    name = turn.scene if turn.is_gallery else str(Path(turn.scene).relative_to(cluster.scenes_dir))
    source = Source(name, turn.is_gallery, dict(parameters))
    return lambda scene, settings: RemoteLauncher(connection(cluster.gate, scene), source, scene, settings)


def kept_scene(path: str, settings: Settings, parameters: Mapping[str, str] = NO_PARAMETERS) -> Scene:
    """The compiled scene with values for its parameters, from the most recently used ones if it is among them."""
    import renderer
    from renderer.settings import STOKES

    # A scene that is to be polarised is another one, in another variant.
    source = loaded_as(path, parameters)
    kind = source + STOKES if STOKES in settings.channels else source
    colour = _own_colours.get(kind, "auto") if settings.colour == "auto" else settings.colour
    if (kind, colour) not in _scenes:
        # With its first sensor at its own size: whoever asks for it later may want that one.
        plain = replace(settings, width=None, height=None, sensor=None, camera=None)
        loaded = renderer.load_scene(renderer.SceneFile(path, parameters) if parameters else path, settings=plain)
        colour = loaded.colour
        if settings.colour == "auto":
            _own_colours[kind] = colour
        _scenes[kind, colour] = loaded
        while len(_scenes) > _KEPT_SCENES:
            _scenes.popitem(last=False)
    _scenes.move_to_end((kind, colour))
    return _scenes[kind, colour].sized(settings)


def _render(run: _Run, turn: Turn) -> tuple[bool, tuple[dict[str, float], ...]]:
    """Advance a run to the snapshot nearest the end of its turn; a run without any picture shows its first at once.

    Whether there is a new snapshot, and the points of its curve.
    """
    curve: list[dict[str, float]] = []
    is_first, is_new = run.last is None, False
    latest = time.perf_counter()
    ends = latest + turn.seconds
    for snapshot in run.steps:
        before, latest = latest, time.perf_counter()
        is_over = latest + 0.5 * (latest - before) >= ends
        if snapshot is None:
            if is_over:
                return is_new, tuple(curve)
            continue
        is_new = True
        if is_first:
            run.saved_seconds = snapshot.seconds
        run.last = snapshot
        if snapshot.error is not None and math.isfinite(snapshot.error):
            known = {"seconds": snapshot.seconds, "spp": snapshot.spp, "error": snapshot.error}
            upper = _finite(snapshot.upper)
            curve.append(known if upper is None else known | {"upper": upper})
        if snapshot.stopped_by is not None or is_first or is_over:
            return True, tuple(curve)
    raise RuntimeError("the renderer ended without saying why")


def _save(run: _Run, turn: Turn) -> Kept:
    """Save the newest estimate and wait until it is on disk."""
    if run.saving is not None:
        saving, run.saving = run.saving, None
        run.saved = saving.result()
    # A name stands for one content: others may be reading it, and its checksum is recorded.
    if run.saved is None or run.saved.progress.frame_seq != run.last_seq:
        run.saved = _start_saving(run, turn).result()
    return run.saved


def _save_beside(run: _Run, turn: Turn) -> Kept | None:
    """Begin to save if it is due; say what was saved since the last turn."""
    done = None
    if run.saving is not None and run.saving.done():
        saving, run.saving = run.saving, None
        done = run.saved = saving.result()
    assert run.last is not None
    if run.saving is None and run.last.seconds - run.saved_seconds >= turn.checkpoint_seconds:
        run.saving = _start_saving(run, turn)
    return done


def _start_saving(run: _Run, turn: Turn) -> Future[Kept]:
    assert run.last is not None
    estimate, name, progress = run.last.estimate, f"{turn.job_id}/{run.last_seq:08d}.exr", _progress(run)
    run.saved_seconds = run.last.seconds

    def write() -> Kept:
        path = Path(turn.estimates_dir) / name
        is_new = not path.parent.exists()
        estimate.write(path, {"job": turn.job_id})
        digest = digest_of(path)
        sync_path(path.parent)
        if is_new:
            sync_path(path.parent.parent)
        return Kept(name, digest, progress)

    return _writer.submit(write)


def _unsaved(run: _Run, error: OSError) -> Unsaved:
    """What the newest estimate takes on disk, at most."""
    assert run.last is not None
    estimate = run.last.estimate
    channels = len(estimate.channels) + STOKES_CHANNELS * estimate.moments.has_stokes
    return Unsaved(estimate_bytes(estimate.width, estimate.height, channels), error.strerror or "no room")


def _progress(run: _Run) -> Progress:
    snapshot = run.last
    assert snapshot is not None
    forecast = asdict(snapshot.forecast) if snapshot.forecast is not None else None
    return Progress(
        error=_finite(snapshot.error),
        spp=float(snapshot.spp),
        samples=int(snapshot.samples),
        seconds=float(snapshot.seconds),
        frame_seq=run.last_seq,
        forecast={name: _finite(value) for name, value in forecast.items()} if forecast else None,
        share_within=_finite(snapshot.share_within),
        share_trusted=_finite(snapshot.share_trusted),
        invalid=int(snapshot.invalid),
        error_upper=_finite(snapshot.upper),
        error_unknown=snapshot.unknown,
        replicate_size=snapshot.estimate.replicate_size,
        health=snapshot.health.as_dict(),
    )


def _finite(value: float | None) -> float | None:
    return float(value) if value is not None and math.isfinite(value) else None


def failure_of(error: Exception, *roots: str | Path) -> Failure:
    """What to tell a user. Only the renderer's own errors are written for users. roots: folders that none is told."""
    failure = _failure_of(error)
    return replace(failure, detail=without_paths(failure.detail, roots))


def _failure_of(error: Exception) -> Failure:
    import renderer
    from service.cluster.remote import PassFailed

    if isinstance(error, PassFailed):
        return error.failure
    if isinstance(error, renderer.errors.UnsupportedScene):
        return Failure("The scene needs something that is not supported", str(error), "Change the scene.")
    if isinstance(error, renderer.errors.SceneError):
        return Failure("The scene could not be read", str(error), "Mend the scene and upload it again.")
    if isinstance(error, renderer.errors.SettingsError):
        return Failure("The settings do not fit", str(error), "Choose other settings and submit again.")
    if isinstance(error, renderer.errors.FredholmError):
        return Failure("Rendering failed", str(error), "Read the message; the log of the service may say more.")
    trace = "".join(traceback.format_exception(error))
    if isinstance(error, MemoryError):
        return Failure("Out of memory", "The picture does not fit into memory.", "Ask for fewer pixels.", trace)
    if isinstance(error, OSError) and error.strerror:
        detail = f"The estimate could not be saved: {error.strerror}."
        return Failure("A file could not be written", detail, "Free some disk space and submit again.", trace)
    detail = f"The renderer stopped with an unexpected {type(error).__name__}."
    hint = "Try other settings; the log of the service has the details."
    return Failure("Rendering failed", detail, hint, trace, is_unexpected=True)
