"""The command `fredholm gallery`."""

from __future__ import annotations

from rich.console import Console

from renderer.scene import gallery


def show_gallery() -> None:
    """List the built-in scenes and what each teaches."""
    out = Console()
    for found in gallery.list_scenes():
        out.print(f"[bold]{found.name}[/bold]  {found.title}, {found.width}×{found.height}", highlight=False)
        out.print(f"    {found.teaches}", highlight=False)
