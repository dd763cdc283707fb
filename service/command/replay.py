"""The command `fredholm replay`."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

import typer

from renderer.errors import SettingsError
from renderer.estimate.estimate import Estimate
from renderer.replay import differences, replay, settings_of
from renderer.scene.compile import load_scene
from renderer.scene.parameters import with_parameters
from service.command.console import err, say
from service.command.options import Defines


def replay_pixel(
    scene: Annotated[str, typer.Argument(help="The scene that the file is an image of.")],
    source: Annotated[Path, typer.Argument(help="EXR that `fredholm render` wrote.")],
    pixel: Annotated[str, typer.Argument(help="X,Y: column and row, from the top left.")],
    replicate: Annotated[int | None, typer.Option(help="This replicate alone, from 0; all of them by default.")] = None,
    define: Defines = None,
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
    loaded = load_scene(with_parameters(scene, define or []), settings=settings_of(held))
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
    say(f"{count} replicates, the same bits as in {source}")
