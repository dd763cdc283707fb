"""Several pictures of one `fredholm render`: all sensors of a scene, or values of its parameters."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

from renderer.errors import SettingsError
from renderer.series import Member
from renderer.settings import Target
from service.command.console import Stop, progress_bar, title
from service.command.output import OutputFiles
from service.command.rendering import Rendering, report, summarise


def refuse_for_several(options: Mapping[str, Any]) -> None:
    """Raises SettingsError for options that one picture alone can have. options: values by name, None for not given."""
    for name, value in options.items():
        if value is not None:
            raise SettingsError(f"{name} is {value}, which is for one picture; leave it out, or render one by one")


def render_series(members: Iterable[Member], target: Target, files: OutputFiles, scene: str) -> dict[str, Any]:
    """Renders them one after the other under one progress, until all are done or one is interrupted.

    Returns what to say of them: `series`, a report of each with its output, sensor and parameters; `seconds` in all;
    `stopped_by`, of the last one.
    """
    stop, found = Stop(), []
    with progress_bar() as bar:
        task = bar.add_task("loading", total=1.0, detail="")
        for member in members:
            own = _named(files, member.label)
            part = 1 / member.count
            rendering = Rendering(target, own, stop, bar, task, member.place * part, part)
            said = f"{title(scene)} {member.place + 1} of {member.count}"
            last = rendering.run(member.scene, member.settings, said)
            summarise(last, target, own.picture)
            what = {"output": str(own.picture), "sensor": member.sensor, "parameters": dict(member.parameters)}
            found.append(report(last, target) | what)
            if last.stopped_by == "interrupted":
                break
    seconds = round(sum(one["seconds"] for one in found), 4)
    return {"series": found, "seconds": seconds, "stopped_by": found[-1]["stopped_by"]}


def _named(files: OutputFiles, label: str) -> OutputFiles:
    """The files of one member: OUT-LABEL.exr, and its checkpoint beside it."""
    picture = files.picture.with_name(f"{files.picture.stem}-{label}.exr")
    checkpoint = None if files.checkpoint is None else picture.with_name(f"{picture.stem}.checkpoint.exr")
    return replace(files, picture=picture, checkpoint=checkpoint)
