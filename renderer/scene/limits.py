"""What one scene may ask for, before any of it is loaded."""

from __future__ import annotations

from dataclasses import dataclass

MEBIBYTE = 1 << 20
GIBIBYTE = 1 << 30


@dataclass(frozen=True, slots=True)
class SceneLimits:
    """Upper bounds. The defaults suit one's own files on one's own machine; `UNTRUSTED` suits what strangers send.

    xml_bytes, xml_depth, xml_elements: of all XML files of a scene together (depth: of any). include_depth: of files
    that include each other. include_count: files read in all, where one that is included twice counts twice.
    texture_pixels: of one picture. triangles: of all meshes. memory_bytes: estimated, of the loaded scene.
    is_confined: every file that the scene names must lie in its own folder.
    """

    xml_bytes: int = 256 * MEBIBYTE
    xml_depth: int = 64
    xml_elements: int = 2_000_000
    include_depth: int = 15
    include_count: int = 100_000
    texture_pixels: int = 1 << 30
    triangles: int = 1 << 31
    memory_bytes: int = 1 << 50
    is_confined: bool = False


UNTRUSTED = SceneLimits(
    xml_bytes=32 * MEBIBYTE,
    xml_depth=32,
    xml_elements=200_000,
    include_depth=8,
    include_count=1000,
    texture_pixels=1 << 27,
    triangles=20_000_000,
    memory_bytes=2 * GIBIBYTE,
    is_confined=True,
)
