"""The command `fredholm measure`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn

from renderer.errors import SettingsError
from renderer.measure.chart import svg
from renderer.measure.run import DEFAULT_SECONDS, measure, shrunk
from renderer.measure.table import recommendations, settings_table
from renderer.scene.parameters import Source, with_parameters
from renderer.settings import Settings
from service.command.arguments import parse_camera, sides
from service.command.options import CameraParts, Defines, MaxDepth, SceneName, Sensor, Side, Size

TABLE_WIDTH = 132  # where the output is no terminal


def measure_command(
    scene: SceneName,
    techniques: Annotated[bool, typer.Option("--techniques", help="Compare techniques only.")] = False,
    model: Annotated[bool, typer.Option("--model", help="What each thing that the kernel leaves out saves.")] = False,
    seconds: Annotated[float, typer.Option(help="Render time of each setting.")] = DEFAULT_SECONDS,
    reference: Annotated[Path | None, typer.Option(help="Converged EXR: measure true errors as well.")] = None,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write everything to this JSON file.")] = None,
    chart: Annotated[Path | None, typer.Option(help="Draw error over time to this SVG file.")] = None,
    size: Size = None,
    width: Side = None,
    height: Side = None,
    sensor: Sensor = None,
    camera: CameraParts = None,
    seed: Annotated[int, typer.Option(help="Of the random numbers.")] = 0,
    max_depth: MaxDepth = None,
    define: Defines = None,
) -> None:
    """Measure what settings give for their time: error over time, variance × time, and which to choose.

    Techniques, replicate sizes and depths take turns on the scene. Efficiency is 1 / (variance × seconds); times to
    10, 5, 2 and 1 % are measured where a setting got there, else forecast.

    [bold]Examples[/bold]

      fredholm measure cornell-box --techniques
      fredholm measure scene.xml --size 320x240 --seconds 5 --chart speed.svg --json speed.json
      fredholm measure scene.xml --reference converged.exr
      fredholm measure scene.xml --model
    """
    _check_writable(chart, ".svg", "--chart")
    _check_writable(json_file, ".json", "--json")
    width, height = sides(size, width, height)
    settings = Settings(width, height, seed, max_depth, sensor=sensor, camera=parse_camera(camera or []))
    notes, out = Console(stderr=True), Console()
    source = with_parameters(scene, define or [])
    if model:
        _refuse_with_model(techniques, reference, chart)
        _measure_model(source, settings, seconds, json_file, out)
        return
    columns = (TextColumn("{task.description}"), BarColumn(bar_width=30))
    with Progress(*columns, console=notes, disable=not notes.is_terminal, transient=True) as bar:
        task = bar.add_task("loading", total=1.0)
        found = measure(
            source,
            seconds=seconds,
            settings=settings,
            techniques_only=techniques,
            reference=reference,
            on_progress=lambda name, share: bar.update(task, description=name, completed=share),
        )
    if not out.is_terminal:
        out.width = max(out.width, TABLE_WIDTH)
    out.print(settings_table(found))
    if not techniques:
        out.print("\n[bold]Recommended[/bold] for a budget of")
        for line in recommendations(found):
            out.print(f"  {line}", highlight=False)
    if json_file is not None:
        json_file.write_text(json.dumps(found.as_dict(), indent=1) + "\n", encoding="utf-8")
    if chart is not None:
        chart.write_text(svg(found), encoding="utf-8")


def _measure_model(scene: Source, settings: Settings, seconds: float, json_file: Path | None, out: Console) -> None:
    from renderer.measure.model import as_dict, model_costs, model_table
    from renderer.scene.compile import load_scene

    loaded = shrunk(load_scene(scene, settings=settings), settings)
    costs = model_costs(loaded, settings, seconds)
    if not out.is_terminal:
        out.width = max(out.width, TABLE_WIDTH)
    out.print(model_table(loaded, costs))
    if json_file is not None:
        json_file.write_text(json.dumps(as_dict(loaded, costs), indent=1) + "\n", encoding="utf-8")


def _refuse_with_model(techniques: bool, reference: Path | None, chart: Path | None) -> None:
    if techniques or reference is not None or chart is not None:
        raise SettingsError("--model compares kernels alone; leave out --techniques, --reference and --chart")


def _check_writable(path: Path | None, suffix: str, option: str) -> None:
    """Bad names are refused before any time is spent."""
    if path is None:
        return
    if path.suffix.lower() != suffix:
        raise SettingsError(f"{option} is {path}; the name must end in {suffix}")
    if not path.parent.is_dir():
        raise SettingsError(f"{option} is {path}; the folder {path.parent} does not exist")
