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
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from service.display import display_of, write_display
from service.engine.turn import Failure, Saved, Turn, TurnResult
from service.store.records import Progress

if TYPE_CHECKING:
    from renderer import Scene, Settings, Snapshot, Target

WARM_UP_SCENE = "cornell-box"
_KEPT_SCENES = 4
_log = logging.getLogger("service.worker")


@dataclass(slots=True)
class _Run:
    """A job's suspended rendering."""

    snapshots: Iterator[Snapshot]
    scene: Scene
    saved_seconds: float
    last: Snapshot | None = None
    last_seq: int = 0
    saving: Future[Saved] | None = None


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
    """Render one job for about `turn.seconds`, show the newest snapshot, save the estimate if due."""
    key = (turn.job_id, turn.attempt)
    try:
        run, curve = _render_turn(turn)
        assert run.last is not None
        run.last_seq = turn.next_seq
        display = display_of(run.last.estimate, seq=run.last_seq, seconds=run.last.seconds)
        write_display(display, Path(turn.display_path))
        is_over = run.last.stopped_by is not None
        result = TurnResult(
            progress=_progress(run),
            curve=curve,
            saved=_save(run, turn) if is_over or turn.save else _save_beside(run, turn),
            stopped_by=run.last.stopped_by,
            warnings=tuple(run.scene.warnings),
        )
    except Exception as error:
        failed = _runs.pop(key, None)
        if failed is not None and failed.saving is not None:
            with contextlib.suppress(Exception):
                failed.saving.result()  # later nobody would look for its file
        return TurnResult(failure=failure_of(error))
    if is_over:
        del _runs[key]
    _trim_heap()
    return result


def _trim_heap() -> None:
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
        return TurnResult(failure=failure_of(error))


def _render_turn(turn: Turn) -> tuple[_Run, tuple[dict[str, float], ...]]:
    import renderer

    run = _runs.get((turn.job_id, turn.attempt)) or _start(turn)
    try:
        return run, _render(run, turn)
    except renderer.errors.CheckpointError as error:
        if turn.checkpoint is None:
            raise
        # An estimate of another version or scene: losing the samples so far is better than losing the job.
        _log.warning("saved estimate cannot be continued, starting again: %s", error)
        run = _start(replace(turn, checkpoint=None))
        return run, _render(run, turn)


def _start(turn: Turn) -> _Run:
    import renderer

    for key in [key for key in _runs if key[0] == turn.job_id]:
        del _runs[key]
    settings = renderer.Settings(**turn.settings)
    scene = kept_scene(turn.scene, settings)
    snapshots = _snapshots(scene, renderer.Target(**turn.target), settings, turn.checkpoint)
    run = _runs[turn.job_id, turn.attempt] = _Run(snapshots, scene, 0.0)
    return run


def _snapshots(scene: Scene, target: Target, settings: Settings, checkpoint: str | None) -> Iterator[Snapshot]:
    import renderer

    start = renderer.Estimate.read(checkpoint) if checkpoint else None
    yield from renderer.progressive(scene, target, settings, start=start)


def kept_scene(source: str, settings: Settings) -> Scene:
    """The compiled scene, from the most recently used ones if it is among them."""
    import renderer

    colour = _own_colours.get(source, "auto") if settings.colour == "auto" else settings.colour
    if (source, colour) not in _scenes:
        # At its own size: whoever asks for it later may want that one.
        loaded = renderer.load_scene(source, settings=replace(settings, width=None, height=None))
        colour = loaded.colour
        if settings.colour == "auto":
            _own_colours[source] = colour
        _scenes[source, colour] = loaded
        while len(_scenes) > _KEPT_SCENES:
            _scenes.popitem(last=False)
    _scenes.move_to_end((source, colour))
    return _scenes[source, colour].sized(settings)


def _render(run: _Run, turn: Turn) -> tuple[dict[str, float], ...]:
    """Advance a run to the snapshot nearest the end of its turn; a run without any picture shows its first at once."""
    curve: list[dict[str, float]] = []
    is_first = run.last is None
    latest = time.perf_counter()
    ends = latest + turn.seconds
    for snapshot in run.snapshots:
        before, latest = latest, time.perf_counter()
        if is_first:
            run.saved_seconds = snapshot.seconds
        run.last = snapshot
        if snapshot.error is not None and math.isfinite(snapshot.error):
            curve.append({"seconds": snapshot.seconds, "spp": snapshot.spp, "error": snapshot.error})
        if snapshot.stopped_by is not None or is_first or latest + 0.5 * (latest - before) >= ends:
            return tuple(curve)
    raise RuntimeError("the renderer ended without saying why")


def _save(run: _Run, turn: Turn) -> Saved:
    """Save the newest estimate and wait until it is on disk."""
    if run.saving is not None:
        run.saving.result()
    run.saving = None
    return _start_saving(run, turn).result()


def _save_beside(run: _Run, turn: Turn) -> Saved | None:
    """Begin to save if it is due; say what was saved since the last turn."""
    done = None
    if run.saving is not None and run.saving.done():
        done, run.saving = run.saving.result(), None
    assert run.last is not None
    if run.saving is None and run.last.seconds - run.saved_seconds >= turn.checkpoint_seconds:
        run.saving = _start_saving(run, turn)
    return done


def _start_saving(run: _Run, turn: Turn) -> Future[Saved]:
    assert run.last is not None
    estimate, saved = run.last.estimate, Saved(f"{turn.job_id}/{run.last_seq:08d}.exr", _progress(run))
    run.saved_seconds = run.last.seconds

    def write() -> Saved:
        path = Path(turn.estimates_dir) / saved.name
        estimate.write(path, {"job": turn.job_id})
        _sync_folder(path.parent)
        return saved

    return _writer.submit(write)


def _sync_folder(folder: Path) -> None:
    """A rename lasts once its folder is on disk; Windows has no such call."""
    if os.name == "nt":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


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
        health=snapshot.health.as_dict(),
    )


def _finite(value: float | None) -> float | None:
    return float(value) if value is not None and math.isfinite(value) else None


def failure_of(error: Exception) -> Failure:
    """What to tell a user. Only the renderer's own errors are written for users; others may name paths."""
    import renderer

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
