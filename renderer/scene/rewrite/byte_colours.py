"""Has meshes whose colours are in bytes loaded with what they mean: display colours, as in an 8-bit picture.

Mitsuba takes the bytes for reflectances of up to 255, and finds no colours beside an alpha. Meshes are found by their
nodes, so that those in shape groups are as those that stand alone.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from renderer.backend import mitsuba
from renderer.scene.files.ply_colours import with_display_colours
from renderer.scene.source import Parsed, resolved
from renderer.scene.vet.nodes import value_of


@contextmanager
def display_colours(parsed: Parsed) -> Iterator[tuple[Parsed, tuple[str, ...]]]:
    """The scene to instantiate, and notes; what it names beside its own files is there until the end of the block."""
    wanted = {value_of(n, "name") for n in parsed.state.nodes if n.props.plugin_name() == "mesh_attribute"}
    if not wanted & {"vertex_color", "face_color"}:
        yield parsed, ()
        return
    with tempfile.TemporaryDirectory(prefix="fredholm-colours-") as folder:
        changed = _changed(parsed, lambda name: Path(resolved(parsed.folders, name)), Path(folder))
        yield (parsed, ()) if changed is None else changed


def _changed(parsed: Parsed, find: Callable[[str], Path], folder: Path) -> tuple[Parsed, tuple[str, ...]] | None:
    state, made = mitsuba().parser.ParserState(parsed.state), dict[str, str]()
    for node in state.nodes:
        name = value_of(node, "filename") if node.props.plugin_name() == "ply" else None
        if not isinstance(name, str):
            continue
        if name not in made:
            data = with_display_colours(find(name).read_bytes())
            made[name] = ""
            if data is not None:
                path = folder / f"{len(made)}.ply"
                path.write_bytes(data)
                made[name] = str(path)
        if made[name]:
            node.props["filename"] = made[name]
    names = [Path(name).name for name, path in made.items() if path]
    if not names:
        return None
    note = f"colours in bytes are display colours, without their alpha: {', '.join(names)}"
    return replace(parsed, state=state), (note,)
