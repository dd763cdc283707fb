"""What one scene may ask for, before any of it is loaded."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

MEBIBYTE = 1 << 20
GIBIBYTE = 1 << 30


@dataclass(frozen=True, slots=True)
class SceneLimits:
    """Upper bounds. The defaults suit one's own files on one's own machine; `UNTRUSTED` suits what strangers send.

    xml_bytes, xml_depth, xml_elements: of all XML files of a scene together (depth: of any). include_depth: of files
    that include each other. include_count: files read in all, where one that is included twice counts twice.
    objects, shapes: that plugins make. name_length, value_length: characters of one name or id, and of one value, with
    parameters put in place; parameters, parameter_uses: `$name`s that are defined and named.
    texture_pixels: of one picture. triangles: of all meshes. memory_bytes: estimated, of the loaded scene.
    is_confined: every file that the scene names must lie in its own folder, or in `root` where one is given: the folder
    of the bundle that the scene came in, which may keep scenes and textures side by side.
    """

    xml_bytes: int = 256 * MEBIBYTE
    xml_depth: int = 64
    xml_elements: int = 2_000_000
    include_depth: int = 15
    include_count: int = 100_000
    objects: int = 2_000_000
    shapes: int = 1_000_000
    name_length: int = 1 << 20
    value_length: int = 256 * MEBIBYTE
    parameters: int = 100_000
    parameter_uses: int = 2_000_000
    texture_pixels: int = 1 << 30
    triangles: int = 1 << 31
    memory_bytes: int = 1 << 50
    is_confined: bool = False
    root: Path | None = None


UNTRUSTED = SceneLimits(
    xml_bytes=32 * MEBIBYTE,
    xml_depth=32,
    xml_elements=200_000,
    include_depth=8,
    include_count=1000,
    objects=20_000,
    shapes=5000,
    name_length=1000,
    value_length=256 << 10,
    parameters=1000,
    parameter_uses=20_000,
    texture_pixels=1 << 27,
    triangles=20_000_000,
    memory_bytes=2 * GIBIBYTE,
    is_confined=True,
)
