"""The command `fredholm`: render, inspect, measure, merge, gallery, serve, key."""

from __future__ import annotations

import json
import os
import re
import signal
import sys
import time
from pathlib import Path
from types import FrameType
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn

from renderer.backend import versions
from renderer.errors import FredholmError, SettingsError
from renderer.estimate.estimate import Estimate, merge
from renderer.measure.command import measure_command
from renderer.progress import Snapshot, progressive
from renderer.region import Region
from renderer.replay import differences, replay, settings_of
from renderer.scene import gallery as scene_gallery
from renderer.scene.compile import load_scene
from renderer.scene.report import inspect
from renderer.scene.rewrite import passes
from renderer.settings import DEFAULT_CONFIDENCE, Settings, Target

DEFAULT_ERROR = 0.05
CHECKPOINT_SECONDS = 5.0  # of work that a killed render loses at most
CHECKPOINT_SHARE = 0.05  # of the time that writing may take: large images are saved less often
EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
)
err = Console(stderr=True)


def _say_version(is_asked: bool) -> None:
    if is_asked:
        print(" ".join(f"{name} {release}" for name, release in versions().items()))
        raise typer.Exit


@app.callback()
def fredholm(
    version: Annotated[
        bool, typer.Option("--version", help="Print the versions and exit.", is_eager=True, callback=_say_version)
    ] = False,
) -> None:
    """Fredholm renders Mitsuba 3 scenes and says how far off the image is."""


def parse_error(text: str, option: str = "--error") -> float:
    """'2%' or '0.02' as a fraction."""
    found = re.fullmatch(r"\s*([0-9.eE+-]+)\s*(%?)\s*", text)
    try:
        return float(found.group(1)) / (100 if found.group(2) else 1)  # type: ignore[union-attr]
    except (AttributeError, ValueError):
        raise SettingsError(f"{option} is {text!r}; write it as 2% or 0.02") from None


def parse_time(text: str) -> float:
    """'90', '90s', '1.5m', '1h' or '1m30s' in seconds."""
    units = {"": 1.0, "s": 1.0, "m": 60.0, "min": 60.0, "h": 3600.0}
    parts = re.findall(r"([0-9.]+)\s*(min|[smh]?)", text.strip())
    rebuilt = "".join(f"{n}{u}" for n, u in parts)
    try:
        if not parts or any(not unit for _, unit in parts[:-1]) or rebuilt != text.replace(" ", ""):
            raise ValueError
        return sum(float(n) * units[u] for n, u in parts)
    except ValueError:
        raise SettingsError(f"--time is {text!r}; write it as 30s, 1m30s or 2h") from None


def parse_size(text: str) -> tuple[int, int]:
    """'640x480' as (640, 480)."""
    found = re.fullmatch(r"\s*(\d+)\s*[x×X]\s*(\d+)\s*", text)
    if not found:
        raise SettingsError(f"--size is {text!r}; write it as WIDTHxHEIGHT, for example 640x480")
    return int(found.group(1)), int(found.group(2))


def parse_region(text: str) -> Region:
    """'10,20,300,200' as x, y, width and height, or the path of an image as a mask."""
    numbers = re.fullmatch(r"\s*(\d+)\s*,\s*(\d+)\s*,\s*(\d+)\s*,\s*(\d+)\s*", text)
    return Region.of([int(n) for n in numbers.groups()]) if numbers else Region.read(text)


def say_seconds(seconds: float) -> str:
    """A duration as people say it."""
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes < 60 else f"{minutes // 60} h {minutes % 60} min"


def _names(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(",") if name.strip())


@app.command()
def render(
    scene: Annotated[str, typer.Argument(help="A Mitsuba .xml, .zip or .json, or a gallery name.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="EXR to write; it is also the checkpoint.")] = Path(
        "out.exr"
    ),
    spp: Annotated[int | None, typer.Option(help="Stop at this many samples per pixel.")] = None,
    error: Annotated[str | None, typer.Option(help="Stop at this relative error, for example 2% or 0.02.")] = None,
    time_limit: Annotated[str | None, typer.Option("--time", help="Stop after this time: 30s, 1m30s, 2h.")] = None,
    size: Annotated[str | None, typer.Option(help="WIDTHxHEIGHT in pixels; the scene's own by default.")] = None,
    seed: Annotated[int, typer.Option(help="Equal seeds give equal images, bit for bit.")] = 0,
    max_depth: Annotated[int | None, typer.Option(help="Path depth as in Mitsuba; -1 is unlimited.")] = None,
    technique: Annotated[str, typer.Option(help="mis, bsdf, emitter, cosine or uniform.")] = "mis",
    replicate_size: Annotated[int | None, typer.Option(help="Samples in one replicate, a power of two.")] = None,
    confidence: Annotated[
        str | None, typer.Option(help="How sure to be that the error is below the one asked for: 95% by default.")
    ] = None,
    share: Annotated[
        str | None, typer.Option(help="Stop when this share of the pixels, for example 90%, is within the error.")
    ] = None,
    region: Annotated[
        str | None, typer.Option(help="x,y,width,height, or an image as a mask: only there does the error count.")
    ] = None,
    adaptive: Annotated[
        bool, typer.Option("--adaptive/--uniform", help="More samples where they lower the error most, or all alike.")
    ] = True,
    colour: Annotated[str, typer.Option(help="mono, rgb or spectral; auto takes the leanest that fits.")] = "auto",
    channels: Annotated[
        str, typer.Option(help="Also write these, for example albedo,normal,depth,position,shape_index.")
    ] = "",
    without: Annotated[
        str, typer.Option(help="Rewrites of the scene to leave out, for comparison: similarity, flat faces, …")
    ] = "",
    resume: Annotated[Path | None, typer.Option(help="Go on from this EXR (same scene, settings and seed).")] = None,
    threads: Annotated[
        int | None, typer.Option(min=1, max=9999, help="Of the processor; all by default.", envvar="FREDHOLM_THREADS")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one last line of JSON.")] = False,
) -> None:
    """Render a scene until the first of the given limits; 5 % error where none is given.

    [bold]Examples[/bold]

      fredholm render cornell-box -o box.exr
      fredholm render scene.xml -o out.exr --error 2% --time 10m
      fredholm render scene.xml -o out.exr --spp 256 --size 640x480 --seed 7 --json
      fredholm render scene.xml -o out.exr --resume out.exr --error 1%

    Ctrl-C saves what there is. Exit codes: 0 done, 2 bad input, 130 interrupted (the image is saved).
    """
    if threads is not None:
        os.environ["FREDHOLM_THREADS"] = str(threads)
    width, height = parse_size(size) if size else (None, None)
    settings = Settings(width, height, seed, max_depth, technique, replicate_size, colour, adaptive, _names(channels))
    is_open = spp is None and error is None and time_limit is None
    target = Target(
        error=DEFAULT_ERROR if is_open else parse_error(error) if error else None,
        seconds=parse_time(time_limit) if time_limit else None,
        spp=spp,
        confidence=parse_error(confidence, "--confidence") if confidence else None,
        share=parse_error(share, "--share") if share else None,
        region=parse_region(region) if region else None,
    )
    if output.suffix.lower() != ".exr":
        raise SettingsError(f"--output is {output}; the name must end in .exr")
    start = Estimate.read(resume) if resume else None
    source = load_scene(scene, settings=settings, rewrites=passes.all_but(_names(without))) if without else scene

    interrupted = False

    def on_signal(number: int, frame: FrameType | None) -> None:
        nonlocal interrupted
        if interrupted:
            raise KeyboardInterrupt
        interrupted = True
        err.print("\nStopping after this pass; Ctrl-C again to leave without saving.")

    signal.signal(signal.SIGINT, on_signal)
    signal.signal(signal.SIGTERM, on_signal)
    last: Snapshot | None = None
    saved, cost = time.monotonic(), 0.0
    with _progress_bar() as bar:
        task = bar.add_task("loading", total=1.0, detail="")
        for last in progressive(source, target, settings, start=start, should_stop=lambda: interrupted):
            bar.update(task, description=_title(scene), completed=_share_done(last, target), detail=_detail(last))
            now = time.monotonic()
            if now - saved > max(CHECKPOINT_SECONDS, cost / CHECKPOINT_SHARE) and last.stopped_by is None:
                _save(last, output)
                saved = time.monotonic()
                cost = saved - now
        assert last is not None
        bar.update(task, completed=1.0 if last.stopped_by != "interrupted" else _share_done(last, target))
    _save(last, output)
    _summarise(last, target, output)
    if as_json:
        print(json.dumps(_report(last)), flush=True)
    if last.stopped_by == "interrupted":
        raise typer.Exit(EXIT_INTERRUPTED)


def _progress_bar() -> Progress:
    columns = (TextColumn("{task.description}"), BarColumn(bar_width=30), TextColumn("{task.detail}"))
    return Progress(*columns, console=err, disable=not err.is_terminal)


def _title(scene: str) -> str:
    path = Path(scene)
    return path.parent.name if path.stem == "scene" else path.stem


def _share_done(snapshot: Snapshot, target: Target) -> float:
    shares = [0.0]
    if target.spp:
        shares.append(snapshot.spp / target.spp)
    if target.seconds:
        shares.append(snapshot.seconds / target.seconds)
    if target.error and snapshot.error:
        shares.append((target.error / (snapshot.upper or snapshot.error)) ** 2)
    return min(1.0, max(shares))


def _detail(snapshot: Snapshot) -> str:
    error = "error –" if snapshot.error is None else f"error {100 * snapshot.error:.2f} %"
    parts = [error, f"{snapshot.spp:.0f} spp", say_seconds(snapshot.seconds)]
    if snapshot.forecast is not None:
        parts.append(f"about {say_seconds(snapshot.forecast.seconds_left)} left")
    return " · ".join(parts)


def _save(snapshot: Snapshot, output: Path) -> None:
    snapshot.estimate.write(output, {"stopped_by": snapshot.stopped_by or "checkpoint"})


def _summarise(snapshot: Snapshot, target: Target, output: Path) -> None:
    error = "not known yet" if snapshot.error is None else f"{100 * snapshot.error:.2f} %"
    if snapshot.upper is not None:
        sure = 100 * (target.confidence or DEFAULT_CONFIDENCE)
        error += f" (below {100 * snapshot.upper:.2f} % with {sure:g} % confidence)"
    reasons = {
        "error": "target error reached",
        "seconds": "time used up",
        "spp": "samples done",
        "interrupted": "interrupted",
    }
    short = target.error is not None and snapshot.stopped_by in ("seconds", "spp") and snapshot.error is not None
    missed = f" (asked {100 * (target.error or 0):.2f} %)" if short else ""
    err.print(
        f"{output}: error {error}{missed}, {snapshot.spp:.0f} spp, {say_seconds(snapshot.seconds)}, "
        f"{reasons.get(snapshot.stopped_by or '', '')}; {100 * snapshot.share_trusted:.1f} % of pixels trusted",
        highlight=False,
        markup=False,
        soft_wrap=True,
    )
    for sentence in snapshot.health.sentences():
        err.print(sentence, style="yellow", highlight=False, markup=False, soft_wrap=True)


def _report(snapshot: Snapshot) -> dict[str, Any]:
    return {
        "seconds": round(snapshot.seconds, 4),
        "spp": snapshot.spp,
        "error": snapshot.error,
        "estimated_rel_mse": None if snapshot.error is None else snapshot.error**2,
        "samples": snapshot.samples,
        "stopped_by": snapshot.stopped_by,
        "scene": snapshot.estimate.identity.scene_name,
        "scene_digest": snapshot.estimate.identity.scene,
        "seed": snapshot.estimate.identity.seed,
        "width": snapshot.estimate.width,
        "height": snapshot.estimate.height,
        "share_trusted": snapshot.share_trusted,
        "invalid": snapshot.invalid,
        "error_upper": snapshot.upper,
        "share_within": snapshot.share_within,
        "health": snapshot.health.as_dict(),
    }


app.command("measure")(measure_command)


@app.command("merge")
def merge_files(
    inputs: Annotated[list[Path], typer.Argument(help="Two or more EXR files that `fredholm render` wrote.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="EXR to write.")],
) -> None:
    """Merge estimates of the same scene and settings with different seeds; overlap is refused.

    [bold]Example[/bold]   fredholm merge a.exr b.exr -o c.exr
    """
    if len(inputs) < 2:
        raise SettingsError("merge needs at least two files")
    result = Estimate.read(inputs[0])
    for path in inputs[1:]:
        result = merge(result, Estimate.read(path))
    result.write(output)
    err.print(f"{output}: {result.spp:.0f} spp from {len(inputs)} files", highlight=False, markup=False, soft_wrap=True)


app.command()(inspect)


@app.command("replay")
def replay_pixel(
    scene: Annotated[str, typer.Argument(help="The scene that the file is an image of.")],
    source: Annotated[Path, typer.Argument(help="EXR that `fredholm render` wrote.")],
    pixel: Annotated[str, typer.Argument(help="X,Y: column and row, from the top left.")],
    replicate: Annotated[int | None, typer.Option(help="This replicate alone, from 0; all of them by default.")] = None,
) -> None:
    """Render one pixel of a finished image again, alone, and compare it bit by bit.

    [bold]Example[/bold]   fredholm replay scene.xml out.exr 320,200

    Prints the radiance of each replicate. Exit codes: 0 the same bits, 1 not the same, 2 bad input.
    """
    found = re.fullmatch(r"\s*(\d+)\s*,\s*(\d+)\s*", pixel)
    if not found:
        raise SettingsError(f"pixel is {pixel!r}; write it as X,Y, for example 320,200")
    x, y = int(found.group(1)), int(found.group(2))
    held = Estimate.read(source)
    count = held.pixel(x, y).replicates + int(held.moments.tried[y * held.width + x] - held.count[y, x])
    if not 0 <= (replicate or 0) < count:
        raise SettingsError(f"replicate is {replicate}; pixel ({x}, {y}) has {count} of them, counted from 0")
    loaded = load_scene(scene, settings=settings_of(held))
    if loaded.digest != held.identity.scene:
        raise SettingsError(f"{source} is an image of another scene ({held.identity.scene_name}) than {scene}")
    again = replay(loaded, settings_of(held), (x, y), range(count) if replicate is None else replicate)
    for index, radiance, invalid in zip(again.replicates, again.radiance, again.invalid, strict=True):
        note = f"   {invalid} samples not finite" if invalid else ""
        print(f"{index:6d}  " + "  ".join(f"{v:.9g}" for v in radiance) + note)
    if replicate is not None:
        return
    if changed := differences(held, (x, y), again):
        err.print(f"not the same bits: {', '.join(changed)} differ", style="red", highlight=False)
        raise typer.Exit(1)
    err.print(f"{count} replicates, the same bits as in {source}", highlight=False, markup=False, soft_wrap=True)


@app.command("gallery")
def show_gallery() -> None:
    """List the built-in scenes and what each teaches."""
    out = Console()
    for found in scene_gallery.list_scenes():
        out.print(f"[bold]{found.name}[/bold]  {found.title}, {found.width}×{found.height}", highlight=False)
        out.print(f"    {found.teaches}", highlight=False)


@app.command()
def serve(
    host: Annotated[str | None, typer.Option(help="Address to listen on; 127.0.0.1 by default.")] = None,
    port: Annotated[int | None, typer.Option(help="Port to listen on; 8017 by default.")] = None,
    data: Annotated[Path | None, typer.Option(help="Folder for jobs, scenes and images.")] = None,
    open_browser: Annotated[bool, typer.Option("--open/--no-open", help="Open the page in a browser.")] = True,
) -> None:
    """Serve the page and the HTTP API. What is not given comes from FREDHOLM_HOST, FREDHOLM_PORT, FREDHOLM_DATA_DIR.

    [bold]Example[/bold]   fredholm serve --port 8017 --data ~/fredholm
    """
    from service.serve import run

    run(host=host, port=port, data_dir=data, open_browser=open_browser)


def main() -> None:
    """Entry point: errors of ours become one sentence and an exit code."""
    from service.key_commands import app as key_commands  # the command knows the service; the renderer does not

    app.add_typer(key_commands, name="key")
    try:
        app()
    except FredholmError as problem:
        err.print("[red]error:[/red]", escape(str(problem)), highlight=False, soft_wrap=True)
        sys.exit(EXIT_BAD_INPUT)
    except OSError as problem:
        err.print("[red]error:[/red]", escape(str(problem)), highlight=False, soft_wrap=True)
        sys.exit(1)
    except KeyboardInterrupt:
        sys.exit(EXIT_INTERRUPTED)


if __name__ == "__main__":
    main()
