"""The command `fredholm`: puts the commands together, and turns errors of ours into a sentence and an exit code."""

from __future__ import annotations

import sys
from typing import Annotated

import typer
from rich.markup import escape

from renderer.backend import versions
from renderer.errors import FredholmError
from renderer.scene.report import inspect
from service.command.cluster import app as cluster_commands
from service.command.cluster import work
from service.command.console import EXIT_BAD_INPUT, EXIT_INTERRUPTED, err
from service.command.gallery import show_gallery
from service.command.measure import measure_command
from service.command.merge import merge_files
from service.command.passes import render_part
from service.command.render import render
from service.command.replay import replay_pixel
from service.command.serve import serve
from service.extras import explained
from service.key_commands import app as key_commands

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_show_locals=False,  # some are secrets
)


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


app.command()(render)
app.command("measure")(measure_command)
app.command("passes")(render_part)
app.command("merge")(merge_files)
app.command()(inspect)
app.command("replay")(replay_pixel)
app.command("gallery")(show_gallery)
app.command()(serve)
app.command("worker")(work)
app.add_typer(key_commands, name="key")
app.add_typer(cluster_commands, name="cluster")


def main() -> None:
    """Entry point: errors of ours become one sentence and an exit code."""
    try:
        with explained("this command"):
            app()
    except FredholmError as problem:
        err.print("[red]error:[/red]", escape(str(problem)), highlight=False, soft_wrap=True)
        sys.exit(EXIT_BAD_INPUT)
    except OSError as problem:
        err.print("[red]error:[/red]", escape(str(problem)), highlight=False, soft_wrap=True)
        sys.exit(1)
    except KeyboardInterrupt:
        sys.exit(EXIT_INTERRUPTED)
