"""`fredholm inspect`: what a scene requires, as plain values and as a page of text."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from renderer.backend import one_at_a_time
from renderer.errors import UnsupportedScene
from renderer.scene.compile import load_parsed
from renderer.scene.limits import SceneLimits
from renderer.scene.parameters import Source, with_parameters
from renderer.scene.probe import closed_room_warning
from renderer.scene.requirements import measure
from renderer.scene.rewrite import sensors_of, several_sensors
from renderer.scene.source import parse
from renderer.settings import Settings


def inspect_scene(source: Source, limits: SceneLimits | None = None) -> dict[str, Any]:
    """Parses, measures and loads a scene. Returns name, digest, width, height (of the first sensor's image),
    sensor_choices (index, name, plugin, width, height of each), parameters (default by name), load_seconds (None where
    the scene is not supported), and all fields of `Requirements`. Raises SceneError if it cannot be read.
    """
    with one_at_a_time:
        return _inspected(source, limits)


def _inspected(source: Source, limits: SceneLimits | None) -> dict[str, Any]:
    from renderer.audit.behind import lights_behind

    parsed = parse(source, limits, exact=True)
    needs = measure(parsed)
    sensors = sensors_of(parsed.state)
    width, height = sensors[0].width, sensors[0].height
    load_seconds = None
    if not needs.unsupported:
        began = time.perf_counter()
        scene = load_parsed(source, parsed, Settings())
        load_seconds = round(time.perf_counter() - began, 3)
        width, height, needs = scene.width, scene.height, scene.requirements
        if warning := closed_room_warning(scene):
            needs = replace(needs, warnings=(*needs.warnings, warning))
        settings = scene.resolved(Settings(), 1)
        missed, behind = scene.missed_lights(settings), lights_behind(scene, settings)
        needs = replace(needs, warnings=(*needs.warnings, *needs.unheard, *missed, *behind))
    if several := several_sensors(sensors):
        needs = replace(needs, warnings=(*needs.warnings, several))
    head = {"name": parsed.name, "digest": parsed.digest, "width": width, "height": height}
    head |= {"sensor_choices": [sensor.as_dict() for sensor in sensors], "load_seconds": load_seconds}
    head |= {"parameters": dict(parsed.defaults)}
    return head | needs.as_dict()


def inspect(
    scene: Annotated[str, typer.Argument(help="A .xml, .zip or .json file, or a name that `fredholm gallery` lists.")],
    define: Annotated[
        list[str] | None,
        typer.Option("-D", metavar="NAME=VALUE", help="A value for a <default> of the scene; may be given again."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one line of JSON instead.")] = False,
) -> None:
    """Say what a scene requires, what is numerically risky in it, and what is not supported, without rendering it.

    [bold]Example[/bold]   fredholm inspect scene.xml --json

    Exit codes: 0 it can be rendered, 2 it cannot.
    """
    found = inspect_scene(with_parameters(scene, define or []))
    if as_json:
        print(json.dumps(found), flush=True)
    else:
        show(found, Console(width=None if Console().is_terminal else 120))
    refuse(found)


def refuse(found: Mapping[str, Any]) -> None:
    """Raises UnsupportedScene if what `inspect_scene` returned names something that is not supported."""
    if found["unsupported"]:
        raise UnsupportedScene(found["unsupported"][0])


def show(found: Mapping[str, Any], out: Console) -> None:
    """Prints what `inspect_scene` returns."""
    out.print(f"[bold]{escape(found['name'])}[/bold]  {found['width']}×{found['height']}", highlight=False)
    table = Table(show_header=False, box=None, padding=(0, 2, 0, 2))
    table.add_column(style="dim", no_wrap=True)
    table.add_column()
    for label, text in _rows(found):
        table.add_row(label, escape(text))
    out.print(table)
    for label, style in (("notes", ""), ("warnings", "yellow"), ("unsupported", "red")):
        for line in found[label]:
            out.print(
                f"  {label.removesuffix('s')}: {line}", style=style, highlight=False, markup=False, soft_wrap=True
            )


def _rows(found: Mapping[str, Any]) -> list[tuple[str, str]]:
    rows = [(kind, _counts(found[kind])) for kind in ("shapes", "emitters", "bsdfs", "textures", "media", "sensors")]
    rows = [(kind, text) for kind, text in rows if text] or [("shapes", "none")]
    if len(choices := found["sensor_choices"]) > 1:
        told = (f"{one['name'] or one['index']} {one['width']}×{one['height']} ({one['plugin']})" for one in choices)
        rows.append(("choose one of", ", ".join(told)))
    if found["parameters"]:
        rows.append(("parameters", ", ".join(f"{name}={value}" for name, value in found["parameters"].items())))
    rows.append(("triangles", f"{found['triangles']:,}"))
    if found["texture_pixels"]:
        rows.append(("texture pixels", f"{found['texture_pixels']:,}"))
    rows.append(("memory", f"{found['memory_bytes'] / 2**20:.1f} MiB estimated"))
    if found["low"] is not None:
        sides = (high - low for low, high in zip(found["low"], found["high"], strict=True))
        rows.append(("size", " × ".join(f"{side:.4g}" for side in sides)))
    colour = f"yes, by {found['coloured_by']}" if found["is_coloured"] else "no: one channel is enough"
    rows.append(("colour", colour))
    if (asks := found["polarised_by"]) is not None:
        rows.append(("polarisation", f"yes, by {asks}: S0 to S3 with their standard errors"))
    rows.append(("motion", "none"))
    rows.append(("kernel", ", ".join([found["variant"], *found["features"]])))
    asked = "unlimited" if found["max_depth"] < 0 else str(found["max_depth"])
    rows.append(("depth", f"{asked}. {found['depth_advice']}"))
    if found["load_seconds"] is not None:
        rows.append(("loaded in", f"{found['load_seconds']:.2f} s"))
    rows.append(("digest", found["digest"][:16]))
    return rows


def _counts(kinds: Mapping[str, int]) -> str:
    return ", ".join(name if n == 1 else f"{n} {name}" for name, n in sorted(kinds.items(), key=lambda item: -item[1]))
