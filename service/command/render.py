"""The command `fredholm render`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from renderer.estimate.estimate import Estimate
from renderer.scene.compile import load_scene
from renderer.scene.parameters import with_parameters
from renderer.scene.rewrite import passes
from renderer.series import series
from renderer.settings import Settings, Target
from service.command.arguments import (
    limit_threads,
    names,
    parse_camera,
    parse_error,
    parse_region,
    parse_sweep,
    parse_time,
    sides,
)
from service.command.console import EXIT_INTERRUPTED, Stop, progress_bar, title
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
    Side,
    Size,
    Technique,
    Threads,
    Without,
)
from service.command.output import output_files
from service.command.rendering import Rendering, report, summarise
from service.command.several import refuse_for_several, render_series

DEFAULT_ERROR = 0.05


def render(
    scene: SceneName,
    output: Annotated[Path, typer.Option("-o", "--output", help="EXR to write, to be opened and measured.")] = Path(
        "out.exr"
    ),
    checkpoint: Annotated[
        Path | None,
        typer.Option(help="EXR with all moments, to go on from, merge and replay; beside the output by default."),
    ] = None,
    no_checkpoint: Annotated[bool, typer.Option("--no-checkpoint", help="Write the picture alone.")] = False,
    half: Annotated[bool, typer.Option("--half", help="Radiance in half precision in the picture.")] = False,
    spp: Annotated[int | None, typer.Option(help="Stop at this many samples per pixel.")] = None,
    error: Annotated[str | None, typer.Option(help="Stop at this relative error, for example 2% or 0.02.")] = None,
    time_limit: Annotated[str | None, typer.Option("--time", help="Stop after this time: 30s, 1m30s, 2h.")] = None,
    size: Size = None,
    width: Side = None,
    height: Side = None,
    sensor: Annotated[
        str | None, typer.Option(help="Which of the scene's, by name or by number from 0; all: one picture of each.")
    ] = None,
    camera: CameraParts = None,
    seed: Annotated[int, typer.Option(help="Equal seeds give equal images, bit for bit.")] = 0,
    max_depth: MaxDepth = None,
    technique: Technique = "mis",
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
    independent_pixels: IndependentPixels = False,
    guide: Guide = "off",
    colour: Colour = "auto",
    channels: Channels = "",
    without: Without = "",
    resume: Annotated[
        Path | None,
        typer.Option(help="Go on from this checkpoint, or from the one beside this picture (same scene and settings)."),
    ] = None,
    threads: Threads = None,
    define: Defines = None,
    sweep: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=V1,V2,…", help="One picture for each value of a <default>; several combine. Or V1;V2;…"
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Render a scene until the first of the given limits; 5 % error where none is given.

    [bold]Examples[/bold]

      fredholm render cornell-box -o box.exr
      fredholm render scene.xml -o out.exr --error 2% --time 10m
      fredholm render scene.xml -o out.exr --spp 256 --size 640x480 --seed 7 --json
      fredholm render scene.xml -o out.exr --resume out.exr --error 1%
      fredholm render scene.xml -o thin.exr -D thickness=0.01 -D tint=red
      fredholm render scene.xml -o above.exr --camera "origin=0,9,0 target=0,0,0 up=0,0,1 fov=35"
      fredholm render scene.xml -o turn.exr --sensor all --error 2%
      fredholm render scene.xml -o thin.exr --sweep thickness=0.01,0.02,0.05 --sweep "tint=1,0,0;0,1,0"

    OUT.exr is the picture; OUT.checkpoint.exr beside it holds what --resume, merge and replay need, and is found by the
    picture's name. Several pictures are OUT-LABEL.exr, by sensor and values, and each has the limits for itself. Ctrl-C
    saves what there is. Exit codes: 0 done, 2 bad input, 130 interrupted (the image is saved).
    """
    limit_threads(threads)
    width, height = sides(size, width, height)
    is_all = sensor == "all"
    estimator = (seed, max_depth, technique, replicate_size, colour, adaptive, names(channels))
    apart, placed = independent_pixels or None, parse_camera(camera or [])
    settings = Settings(width, height, *estimator, None if is_all else sensor, apart, placed, guide)
    is_open = spp is None and error is None and time_limit is None
    target = Target(
        error=DEFAULT_ERROR if is_open else parse_error(error) if error else None,
        seconds=parse_time(time_limit) if time_limit else None,
        spp=spp,
        confidence=parse_error(confidence, "--confidence") if confidence else None,
        share=parse_error(share, "--share") if share else None,
        region=parse_region(region) if region else None,
    )
    files = output_files(output, checkpoint, no_checkpoint, half)
    source = with_parameters(scene, define or [])
    if is_all or sweep:
        refuse_for_several({"--resume": resume, "--checkpoint": checkpoint, "--without": without or None})
        several = series(source, settings, sensors="all" if is_all else None, sweep=parse_sweep(sweep or []))
        found = render_series(several, target, files, scene)
    else:
        start = Estimate.read(resume) if resume else None
        source = load_scene(source, settings=settings, rewrites=passes.all_but(names(without))) if without else source
        with progress_bar() as bar:
            rendering = Rendering(target, files, Stop(), bar, bar.add_task("loading", total=1.0, detail=""))
            last = rendering.run(source, settings, title(scene), start)
        summarise(last, target, output)
        found = report(last, target)
    if as_json:
        print(json.dumps(found), flush=True)
    if found["stopped_by"] == "interrupted":
        raise typer.Exit(EXIT_INTERRUPTED)
