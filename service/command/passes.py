"""The command `fredholm passes`: a part of an image that several machines render."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from renderer.part import PartProgress, part_steps
from renderer.scene.compile import load_scene
from renderer.scene.parameters import with_parameters
from renderer.scene.rewrite import passes
from renderer.settings import DEFAULT_REPLICATE_SIZE, Settings
from service.command.arguments import check_is_exr, limit_threads, names, parse_camera, parse_range, parse_region, sides
from service.command.console import EXIT_INTERRUPTED, Stop, progress_bar, say, say_seconds, title
from service.command.options import (
    AsJson,
    CameraParts,
    Channels,
    Colour,
    Defines,
    Guide,
    IndependentPixels,
    MaxDepth,
    SceneName,
    Sensor,
    Side,
    Size,
    Technique,
    Threads,
    Without,
)


def render_part(
    scene: SceneName,
    replicates: Annotated[str, typer.Option(help="FIRST:END, counted from 0; END is the first not rendered.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="EXR to write, to be merged.")] = Path("part.exr"),
    region: Annotated[
        str | None, typer.Option(help="x,y,width,height, or an image as a mask: render these pixels alone.")
    ] = None,
    size: Size = None,
    width: Side = None,
    height: Side = None,
    sensor: Sensor = None,
    camera: CameraParts = None,
    seed: Annotated[int, typer.Option(help="The same for all parts of one image.")] = 0,
    max_depth: MaxDepth = None,
    technique: Technique = "mis",
    replicate_size: Annotated[
        int, typer.Option(help="Samples in one replicate, a power of two up to 64; the same for all parts.")
    ] = DEFAULT_REPLICATE_SIZE,
    independent_pixels: IndependentPixels = False,
    guide: Guide = "off",
    colour: Colour = "auto",
    channels: Channels = "",
    without: Without = "",
    threads: Threads = None,
    define: Defines = None,
    as_json: AsJson = False,
) -> None:
    """Render a range of replicates, as a part of an image that several machines render; no service is needed.

    [bold]Examples[/bold]

      fredholm passes scene.xml --replicates 0:64 -o part-0.exr
      fredholm passes scene.xml --replicates 64:128 -o part-1.exr
      fredholm passes scene.xml --replicates 0:128 --region 0,0,640,90 -o strip-0.exr
      fredholm merge part-*.exr -o out.exr

    A replicate is --replicate-size samples of every pixel. Parts merge in any order; all of them together are, to the
    bit, `fredholm render --uniform` with the same --replicate-size and as many samples, made by the same versions on
    the same kind of device. A part that does not begin at 0 keeps its replicates one by one, 12 bytes a pixel for each,
    or 4 in a scene without colours: large replicates make small parts.

    Ctrl-C and SIGTERM save the replicates that all pixels have by then. Exit codes: 0 done, 2 bad input, 130
    interrupted (what is whole is saved).
    """
    limit_threads(threads)
    asked = parse_range(replicates)
    check_is_exr(output)
    width, height = sides(size, width, height)
    estimator = (seed, max_depth, technique, replicate_size, colour, False, names(channels), sensor)
    apart, placed = independent_pixels or None, parse_camera(camera or [])
    settings = Settings(width, height, *estimator, independent_pixels=apart, camera=placed, guide=guide)
    pixels = parse_region(region) if region else None
    source = with_parameters(scene, define or [])
    source = load_scene(source, settings=settings, rewrites=passes.all_but(names(without))) if without else source
    stop, last = Stop(), None
    with progress_bar() as bar:
        task = bar.add_task("loading", total=1.0, detail="")
        for last in part_steps(source, asked, settings, region=pixels, should_stop=stop.is_asked):
            detail = f"replicates {last.done.start}:{last.done.stop} · {say_seconds(last.seconds)}"
            bar.update(task, description=title(scene), completed=last.share, detail=detail)
    assert last is not None
    told = {"stopped_by": "interrupted" if last.done != asked else "replicates"}
    if last.estimate is not None:
        last.estimate.write(output, told)
    _say_part(last, asked, output)
    if as_json:
        print(json.dumps(_part_report(last, asked)), flush=True)
    if last.done != asked:
        raise typer.Exit(EXIT_INTERRUPTED)


def _say_part(last: PartProgress, asked: range, output: Path) -> None:
    rest = f"{last.done.stop}:{asked.stop} of {asked.start}:{asked.stop}"
    if last.estimate is None:
        said = f"interrupted before any replicate was whole; {output} is not written, {rest} are to be rendered"
    else:
        held = f"replicates {last.done.start}:{last.done.stop}, {say_seconds(last.seconds)}"
        said = f"{output}: {held}" + ("" if last.done == asked else f"; interrupted, {rest} are to be rendered")
    say(said)


def _part_report(last: PartProgress, asked: range) -> dict[str, Any]:
    """first, end: replicates that are written. None stands for what there is not."""
    estimate = last.estimate
    return {
        "seconds": round(last.seconds, 4),
        "first": last.done.start,
        "end": last.done.stop,
        "asked": [asked.start, asked.stop],
        "samples": estimate.samples if estimate else 0,
        "stopped_by": "replicates" if last.done == asked else "interrupted",
        "scene": estimate.identity.scene_name if estimate else None,
        "scene_digest": estimate.identity.scene if estimate else None,
        "seed": estimate.identity.seed if estimate else None,
        "replicate_size": estimate.replicate_size if estimate else None,
        "width": estimate.width if estimate else None,
        "height": estimate.height if estimate else None,
        "invalid": int(estimate.invalid.sum()) if estimate else None,
    }
