"""Options that several commands have: what is typed, and what help says of it. Defaults stand with each command."""

from __future__ import annotations

from typing import Annotated

import typer

from renderer.settings import TECHNIQUES

SceneName = Annotated[str, typer.Argument(help="A Mitsuba .xml, .zip or .json, or a gallery name.")]
Size = Annotated[str | None, typer.Option(help="WIDTHxHEIGHT in pixels; the scene's own by default.")]
Side = Annotated[int | None, typer.Option(help="In pixels; alone it keeps the proportions.")]
Sensor = Annotated[str | None, typer.Option(help="Which of the scene's, by name or by number from 0.")]
CameraParts = Annotated[
    list[str] | None,
    typer.Option(help="origin=X,Y,Z target=X,Y,Z up=X,Y,Z fov=DEGREES, any of them, instead of the scene's."),
]
MaxDepth = Annotated[int | None, typer.Option(help="Path depth as in Mitsuba; -1 is unlimited.")]
Technique = Annotated[str, typer.Option(help=f"{', '.join(TECHNIQUES[:-1])} or {TECHNIQUES[-1]}.")]
IndependentPixels = Annotated[
    bool, typer.Option("--independent-pixels", help="Give each sample to one pixel: white noise, but more of it.")
]
Guide = Annotated[
    str, typer.Option(help="on: learn first where light comes from, for light that arrives by bounces; or off.")
]
Colour = Annotated[str, typer.Option(help="mono, rgb or spectral; auto takes the leanest that fits.")]
Channels = Annotated[
    str, typer.Option(help="Also write these, for example albedo,normal,depth,position; stokes polarises.")
]
Without = Annotated[
    str, typer.Option(help="Rewrites of the scene to leave out, for comparison: similarity, flat faces, …")
]
Threads = Annotated[
    int | None, typer.Option(min=1, max=9999, help="Of the processor; all by default.", envvar="FREDHOLM_THREADS")
]
Defines = Annotated[
    list[str] | None,
    typer.Option("-D", metavar="NAME=VALUE", help="A value for a <default> of the scene; may be given again."),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print one last line of JSON.")]
