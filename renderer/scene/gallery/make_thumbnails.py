"""Render the gallery's thumbnails with this renderer: `python -m renderer.scene.gallery.make_thumbnails [name …]`.

Writes thumbnails/NAME.png beside this file, 256 pixels wide, for all scenes or those named. One or two minutes each
on two cores.
"""

from __future__ import annotations

import argparse
import sys
import time

import renderer

from .catalogue import find, list_scenes
from .gallery_scene import GalleryScene
from .indexed_png import encode

WIDTH = 256
SEED = 1
ERROR, SPP = 0.01, 1024  # whichever comes first
LARGEST_BYTES = 60_000


def make(entry: GalleryScene, spp: int) -> int:
    """Render one thumbnail and write it; the size of the file in bytes."""
    settings = renderer.Settings(width=WIDTH, height=round(WIDTH * entry.height / entry.width), seed=SEED)
    scene = renderer.load_scene(entry.name, settings=settings)
    estimate = renderer.render(scene, renderer.Target(error=ERROR, spp=spp), settings)
    png = encode(estimate.picture())
    entry.thumbnail.parent.mkdir(exist_ok=True)
    entry.thumbnail.write_bytes(png)
    return len(png)


def main(arguments: list[str] | None = None) -> int:
    """Make the thumbnails asked for; 1 where one is too large to ship."""
    parser = argparse.ArgumentParser(prog="python -m renderer.scene.gallery.make_thumbnails", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="name", help="scenes to render; all if none is given")
    parser.add_argument("--spp", type=int, default=SPP, help=f"samples per pixel at most (default {SPP})")
    asked = parser.parse_args(arguments)
    too_large = 0
    for entry in [find(name) for name in asked.names] or list_scenes():
        began = time.monotonic()
        size = make(entry, asked.spp)
        too_large += size > LARGEST_BYTES
        print(
            f"{entry.name}: {size:,} bytes (limit {LARGEST_BYTES:,}), {time.monotonic() - began:.0f} s",
            flush=True,
        )
    return 1 if too_large else 0


if __name__ == "__main__":
    sys.exit(main())
