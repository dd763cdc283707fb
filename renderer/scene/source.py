"""Where a scene comes from, and its parsed intermediate form.

Enters: an .xml file, a .zip bundle, a .json document, a Mitsuba dictionary or a gallery name. Leaves: Mitsuba's parser
state, vetted, upgraded and with references resolved, plus a digest of everything that the scene is made of (its
identity). Nothing is instantiated here.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from renderer.backend import mitsuba
from renderer.errors import SceneError
from renderer.scene import gallery
from renderer.scene.assets import Assets, look
from renderer.scene.bundle import LOCAL_LIMITS, BundleError, unpack
from renderer.scene.geometry import Placed, placed_shapes
from renderer.scene.identity import digest_of
from renderer.scene.limits import SceneLimits
from renderer.scene.messages import has_place, place_of, plain
from renderer.scene.vet.dictionary import read_document
from renderer.scene.vet.nodes import check_nodes
from renderer.scene.vet.plugins import refuse_libraries
from renderer.scene.vet.xml import check_xml

if TYPE_CHECKING:
    from collections.abc import Iterator

_AT_INFINITY = frozenset("constant envmap sunsky timed_sunsky directional".split())


@dataclass(frozen=True, slots=True)
class Parsed:
    """A parsed scene: Mitsuba's parser state, a name to show, a digest, the folders that its files are in, what those
    files hold, and where its shapes lie. keep: what must live as long as the scene is loaded from its files.
    """

    state: Any
    name: str
    digest: str
    folders: tuple[str, ...]
    assets: Assets
    shapes: list[Placed]
    keep: Any = field(default=None, repr=False)

    def place(self, node: Any) -> str:
        """Where a node stands: "scene.xml:12", or "scene.ball" for a dictionary."""
        return place_of(self.state, node, self.folders)


@contextmanager
def _file_resolver(paths: tuple[str, ...]) -> Iterator[Any]:
    """Mitsuba's file resolver with these paths first (as `mi.load_file` does), restored afterwards."""
    resolver = mitsuba().file_resolver()
    before = [str(resolver[i]) for i in range(len(resolver))]
    for path in reversed(paths):
        resolver.prepend(path)
    try:
        yield resolver
    finally:
        resolver.clear()
        for path in before:
            resolver.append(path)


def _resolved(resolver: Any, name: str) -> str:
    """The path that Mitsuba would take for a file name: that in the first folder that has it, else the name itself."""
    near = os.path.join(str(resolver[0]), name) if len(resolver) else name
    return near if os.path.exists(near) else str(resolver.resolve(name))


def parse(source: str | Path | dict[str, Any], limits: SceneLimits | None = None, *, exact: bool = False) -> Parsed:
    """Parses and vets any source. exact: count the triangles of long files one by one.

    Raises SceneError with the place and the cause.
    """
    mi = mitsuba()
    limits = limits or SceneLimits()
    config = mi.parser.ParserConfig(mi.variant())
    opened = _open(source, config, limits)
    with _file_resolver(opened.folders) as resolver:
        mitsuba_folders = [str(resolver[i]) for i in range(len(opened.folders), len(resolver))]
        refuse_libraries(opened.folders, mitsuba_folders)
        state = guarded(opened.read, opened.name, opened.folders)
        folders = tuple(str(resolver[i]) for i in range(len(resolver)))  # scenes add folders by <path>
        refuse_libraries(folders, mitsuba_folders)

        def place(node: Any) -> str:
            return place_of(state, node, folders)

        check_nodes(state, Path(opened.folders[0]) if opened.folders else None, limits, place)
        guarded(lambda: mi.parser.transform_upgrade(config, state), opened.name, folders)
        guarded(lambda: mi.parser.transform_resolve(config, state), opened.name, folders)
        inside = Path(opened.folders[0]) if opened.folders else None
        assets = look(state, partial(_resolved, resolver), limits, place, exact=exact, folder=inside)
        shapes = placed_shapes(state, assets)
        return Parsed(state, opened.name, digest_of(state, assets), folders, assets, shapes, opened.keep)


@dataclass(frozen=True, slots=True)
class _Opened:
    """A source that was found: a name to show, its folders, and the call that parses it."""

    name: str
    folders: tuple[str, ...]
    read: Callable[[], Any]
    keep: Any = None


def _open(source: str | Path | dict[str, Any], config: Any, limits: SceneLimits) -> _Opened:
    parser = mitsuba().parser
    if isinstance(source, dict):
        return _Opened("scene", (), lambda: parser.parse_dict(config, source))
    path = Path(source)
    if not path.suffix and not path.is_file():
        found = gallery.find(str(source))
        return _Opened(found.name, (), lambda: parser.parse_dict(config, found.build()))
    kind = path.suffix.lower()
    if kind not in (".xml", ".zip", ".json"):
        raise SceneError(f"{path}: a scene is an .xml file, a .zip bundle, a .json document or a gallery name")
    if not path.is_file():
        raise SceneError(f"{path}: no such file")
    if kind == ".zip":
        return _open_bundle(path, config, limits)
    folder = path.resolve().parent
    name = folder.name if path.stem == "scene" else path.stem
    if kind == ".json":
        document = read_document(path.read_bytes(), path.name, folder, limits)
        return _Opened(name, (str(folder),), lambda: parser.parse_dict(config, document))
    check_xml(path, limits)
    return _Opened(name, (str(folder),), lambda: parser.parse_file(config, str(path.resolve())))


def _open_bundle(path: Path, config: Any, limits: SceneLimits) -> _Opened:
    """The scene in a zip, unpacked for as long as it is used."""
    unpacked = tempfile.TemporaryDirectory(prefix="fredholm-scene-")
    folder = Path(unpacked.name)
    try:
        with path.open("rb") as file:
            bundle = unpack(file, path.name, folder, LOCAL_LIMITS)
    except BundleError as error:
        raise SceneError(f"{path.name}: {error}") from None
    inner = _open(folder / bundle.scene, config, limits)
    return _Opened(bundle.name, inner.folders, inner.read, unpacked)


def instantiate(parsed: Parsed) -> Any:
    """The Mitsuba scene of a parsed one: merges equal materials and, without lights at infinity, meshes.

    A merged mesh has no bounds in Mitsuba 3.9.1, and light from infinity comes from just outside of the scene's: what
    lay beyond hid nothing, and a wall of merged meshes let the sky through.
    """
    mi = mitsuba()
    state = mi.parser.ParserState(parsed.state)  # the passes change it; the parsed form is kept as it was read
    emitters = {node.props.plugin_name() for node in state.nodes if node.type == mi.ObjectType.Emitter}
    scene = _instantiate(parsed, state, merges_meshes=not emitters & _AT_INFINITY)
    if not isinstance(scene, mi.Scene):
        raise SceneError(f"{parsed.name}: the outermost element is no scene but {type(scene).__name__}")
    return scene


def load_part(parsed: Parsed, description: dict[str, Any]) -> Any:
    """A Mitsuba object that belongs to a parsed scene, from its dictionary."""
    mi = mitsuba()
    with _file_resolver(parsed.folders):
        config = mi.parser.ParserConfig(mi.variant())
        state = guarded(lambda: mi.parser.parse_dict(config, description), parsed.name, parsed.folders)
    return _instantiate(parsed, state)


def _instantiate(parsed: Parsed, state: Any, merges_meshes: bool = True) -> Any:
    mi = mitsuba()
    config = mi.parser.ParserConfig(mi.variant())
    config.merge_meshes = merges_meshes
    with _file_resolver(parsed.folders):
        guarded(lambda: mi.parser.transform_all(config, state), parsed.name, parsed.folders)
        made = guarded(lambda: mi.parser.instantiate(config, state), parsed.name, parsed.folders)
    return made[0] if isinstance(made, (list, tuple)) else made


def guarded(call: Callable[[], Any], what: str, folders: tuple[str, ...]) -> Any:
    """The result of a call into Mitsuba, its errors as SceneError with file and line, and what to do."""
    try:
        return call()
    except (RuntimeError, ValueError, KeyError, TypeError, IndexError, OverflowError, MemoryError) as cause:
        told = plain(str(cause), folders)
        raise SceneError(told if has_place(told) else f"{what}: {told}") from cause
