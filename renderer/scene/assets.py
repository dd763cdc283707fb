"""The files that a parsed scene names: found, inside, and small enough, before Mitsuba reads them.

Enters: parsed nodes. Leaves: `Assets`, what each node's file holds, with totals for the memory estimate.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from renderer.backend import mitsuba
from renderer.errors import SceneError
from renderer.scene.files.mesh import MeshFacts, read_mesh
from renderer.scene.files.picture import GridFacts, PictureFacts, read_grid, read_picture
from renderer.scene.files.tables import check_curves, check_ellipsoids, check_tensors
from renderer.scene.files.voxels import check_file
from renderer.scene.limits import MEBIBYTE, SceneLimits
from renderer.scene.plugins import PLUGINS, having
from renderer.scene.vet.nodes import value_of

SKY_BYTES = 24  # per pixel of an environment map, of the tables that it is sampled by
# Measured on Mitsuba 3.9 with Embree: faces and ray-casting structure; positions, normals and texture coordinates.
TRIANGLE_BYTES, VERTEX_BYTES = 110, 32


@dataclass(frozen=True, slots=True)
class Assets:
    """What the files hold, by the index of the node that names them.

    paths: file of each such node. digests: SHA-256 of those that were read on the way. memory_bytes: estimate for the
    scene once loaded.
    """

    paths: dict[int, Path] = field(default_factory=dict)
    digests: dict[int, bytes] = field(default_factory=dict)
    meshes: dict[int, MeshFacts] = field(default_factory=dict)
    pictures: dict[int, PictureFacts] = field(default_factory=dict)
    grids: dict[int, GridFacts] = field(default_factory=dict)
    triangles: int = 0
    texture_pixels: int = 0
    memory_bytes: int = 0


def look(
    state: Any,
    resolve: Callable[[str], str],
    limits: SceneLimits,
    place: Any,
    *,
    exact: bool,
    folder: Path | None = None,
) -> Assets:
    """Looks at every file that the nodes name. resolve: name → its path; place: node → "file:line".

    exact: see `read_mesh`. folder: where the files must lie, if the limits say so. Raises SceneError for files that are
    missing, damaged or too large.
    """
    mi = mitsuba()
    paths: dict[int, Path] = {}
    digests: dict[int, bytes] = {}
    read: dict[str, bytes] = {}  # digests by path
    meshes: dict[int, MeshFacts] = {}
    pictures: dict[int, PictureFacts] = {}
    grids: dict[int, GridFacts] = {}
    seen: dict[tuple[str, int], Any] = {}
    seen_grids: set[Any] = set()
    triangles = texture_pixels = memory = 0
    skipped = (mi.ObjectType.Integrator, mi.ObjectType.Sampler, mi.ObjectType.Film)
    for index, node in enumerate(state.nodes):
        name = value_of(node, "filename")
        if not isinstance(name, str) or node.type in skipped:
            continue
        plugin = node.props.plugin_name()
        found = resolve(name)
        path = paths[index] = Path(found)
        # What lies elsewhere is as missing as what is not there, and told with the same words.
        is_elsewhere = limits.is_confined and folder is not None and not path.resolve().is_relative_to(folder.resolve())
        if is_elsewhere or not is_file(found):
            what = "is a folder" if not is_elsewhere and path.is_dir() else "is missing"
            raise SceneError(f"{place(node)}: {name[:200]!r} {what}; put that file beside the scene")
        asked = value_of(node, "shape_index", 0)
        key = (found, asked if isinstance(asked, int) else 0)
        try:
            if plugin in having("mesh"):
                mesh = seen.get(key)
                if mesh is None:
                    with open(found, "rb") as file:
                        data = file.read()
                    mesh = seen[key] = read_mesh(data, path.name, plugin, key[1], exact=exact)
                    if found not in read:
                        read[found] = hashlib.sha256(data).digest()
                meshes[index], digests[index] = mesh, read[found]
                triangles += mesh.triangles
                memory += mesh.triangles * TRIANGLE_BYTES + mesh.vertices * VERTEX_BYTES
            elif plugin in having("picture"):
                picture = pictures[index] = seen.get(key) or read_picture(path)
                pixels = picture.width * picture.height
                if pixels > limits.texture_pixels:
                    raise SceneError(_too_large("picture", pixels, limits.texture_pixels, "pixels"))
                if key not in seen:
                    texture_pixels += pixels
                memory += pixels * picture.channels * max(2, picture.value_bytes)  # Mitsuba reads it for each node
                memory += pixels * SKY_BYTES if plugin == "envmap" else 0
                seen[key] = picture
            elif plugin in having("grid"):
                is_distance = plugin == "sdfgrid"
                grid = grids[index] = read_grid(path, 2 if is_distance else 1)
                memory += 4 * grid.values
                if memory <= limits.memory_bytes and (key, is_distance) not in seen_grids:
                    check_file(path, grid, is_signed=is_distance)
                    seen_grids.add((key, is_distance))
            else:
                check_other(plugin, path)
                memory += 4 * path.stat().st_size
        except SceneError as error:
            raise SceneError(f"{place(node)}: {error}") from None
        if triangles > limits.triangles:
            raise SceneError(f"{place(node)}: {_too_large('scene', triangles, limits.triangles, 'triangles')}")
        if memory > limits.memory_bytes:
            raise SceneError(
                f"{place(node)}: the scene would take more than {memory // MEBIBYTE} MiB of memory, and the limit is "
                f"{limits.memory_bytes // MEBIBYTE} MiB; use smaller pictures, fewer triangles or instances"
            )
    return Assets(paths, digests, meshes, pictures, grids, triangles, texture_pixels, memory)


def check_other(plugin: str, path: Path) -> None:
    """Looks through a file that is neither mesh, picture nor grid. Raises SceneError."""
    if plugin in having("curves"):
        check_curves(path, PLUGINS[plugin].points)
    elif plugin in having("splats"):
        check_ellipsoids(path)
    elif plugin in having("tensor"):
        check_tensors(path)


def is_file(path: str) -> bool:
    """Whether there is a file; not for names that no file can have."""
    try:
        return os.path.isfile(path)
    except (OSError, ValueError):
        return False


def _too_large(what: str, found: int, limit: int, unit: str) -> str:
    return f"the {what} has {found} {unit}, and the limit is {limit}; use a smaller one"
