"""The command `fredholm merge`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from renderer.errors import SettingsError
from renderer.estimate.estimate import Estimate, merge_sorted
from renderer.image.exr import merge_order_of
from service.command.console import say
from service.command.output import output_files


def merge_files(
    inputs: Annotated[list[Path], typer.Argument(help="Two or more EXR files that `render` or `passes` wrote.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="EXR to write; its checkpoint goes beside it.")],
) -> None:
    """Merge estimates of the same scene and settings: of different seeds, or parts of one render, in any order. Overlap
    is refused, and gaps are said. Inputs are checkpoints, parts, or pictures with their checkpoints beside them.

    [bold]Examples[/bold]

      fredholm merge a.exr b.exr -o c.exr
      fredholm merge part-*.exr -o out.exr

    Parts of `fredholm passes` become, to the bit, what one render would have made. While some are missing, their
    replicates wait in the checkpoint: merge it with the missing ones later.
    """
    if len(inputs) < 2:
        raise SettingsError("merge needs at least two files")
    files = output_files(output, None)
    result = merge_sorted(Estimate.read(path) for path in sorted(inputs, key=merge_order_of))
    files.save(result)
    say(f"{output}: {result.spp:.0f} spp from {len(inputs)} files")
    for sentence in _said_missing(result):
        say(sentence, "yellow")


def _said_missing(estimate: Estimate) -> list[str]:
    """What parts are not there yet, in sentences."""
    said, tried = [], estimate.moments.tried
    if estimate.held is not None:
        said.append(
            f"replicates {estimate.held.said_missing} are missing: later ones wait for them, "
            "and the bits are not yet those of a straight render"
        )
    if is_empty := int((tried == 0).sum()):
        said.append(f"{is_empty} of {len(tried)} pixels have no samples: parts of other regions are missing")
    return said
