"""Where a scene comes from, and its parsed intermediate form.

Enters: an .xml file, a .zip bundle, a .json document, a Mitsuba dictionary or a gallery name. Leaves: Mitsuba's parser
state, vetted, upgraded and with references resolved, plus a digest of everything that the scene is made of (its
identity). Nothing is instantiated here.
"""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from renderer.backend import mitsuba, mitsuba_folder, reading_files
from renderer.errors import SceneError, check_name
from renderer.scene import gallery
from renderer.scene.assets import Assets, is_file, look
from renderer.scene.bundle import LOCAL_LIMITS, BundleError, unpack
from renderer.scene.geometry import Placed, placed_shapes, take_meters_off
from renderer.scene.identity import digest_of
from renderer.scene.limits import SceneLimits
from renderer.scene.messages import has_place, place_of, plain
from renderer.scene.parameters import SceneFile, Source, refuse_unknown
from renderer.scene.plugins import having
from renderer.scene.vet.dictionary import check_values, read_document
from renderer.scene.vet.media import check_media
from renderer.scene.vet.nodes import check_nodes, value_of
from renderer.scene.vet.plugins import INTEGRATORS, refuse_libraries
from renderer.scene.vet.references import meant
from renderer.scene.vet.xml import check_xml

if TYPE_CHECKING:
    from collections.abc import Iterator


@dataclass(frozen=True, slots=True)
class Parsed:
    """A parsed scene: Mitsuba's parser state, a name to show, a digest, the folders that its files are in, what those
    files hold, and where its shapes lie. keep: what must live as long as the scene is loaded from its files.
    defaults: of its parameters, by name.
    """

    state: Any
    name: str
    digest: str
    folders: tuple[str, ...]
    assets: Assets
    shapes: list[Placed]
    keep: Any = field(default=None, repr=False)
    defaults: Mapping[str, str] = field(default_factory=dict)

    def place(self, node: Any) -> str:
        """Where a node stands: "scene.xml:12", or "scene.ball" for a dictionary."""
        return place_of(self.state, node, self.folders)


@contextmanager
def _file_resolver(folders: tuple[str, ...]) -> Iterator[Any]:
    """Mitsuba's file resolver with these folders and no others, restored afterwards."""
    resolver = mitsuba().file_resolver()
    before = [str(resolver[i]) for i in range(len(resolver))]
    resolver.clear()
    for path in folders:
        resolver.append(path)
    try:
        yield resolver
    finally:
        resolver.clear()
        for path in before:
            resolver.append(path)


def resolved(folders: tuple[str, ...], name: str) -> str:
    """The path that Mitsuba would take for a file name: that in the first folder that has it, else the name itself."""
    near = (os.path.join(folder, name) for folder in folders)
    return next((path for path in near if os.path.exists(path)), name)


def _mitsuba_folders(limits: SceneLimits) -> tuple[str, ...]:
    """Where Mitsuba looks whatever the scene: first for its own data, which no file of a scene may stand in for (a
    table that is read once serves all scenes of a process). The folder in which the process was started, which it looks
    in by itself, is for one's own scenes alone.
    """
    own = str(mitsuba_folder())
    resolver = mitsuba().file_resolver()
    others = (str(resolver[i]) for i in range(len(resolver)))
    return (own, *(() if limits.is_confined else (path for path in others if path != own)))


def _name_integrators(state: Any) -> None:
    """Says what those integrators are that Mitsuba has in Python: its parser of dictionaries does not know them."""
    kinds = mitsuba().ObjectType
    for node in state.nodes:
        if node.type == kinds.Unknown and node.props.plugin_name() in INTEGRATORS:
            node.type = kinds.Integrator


def _correct_names(state: Any, resolve: Callable[[str], str], folders: tuple[str, ...]) -> None:
    """Names the file that is meant where a name differs from it in case or in the kind of its slashes alone."""
    for node in state.nodes:
        name = value_of(node, "filename")
        if isinstance(name, str) and not is_file(resolve(name)):
            found = meant(name, [Path(folder) for folder in folders])
            if found is not None:
                was_queried = node.props.was_queried("filename")
                node.props["filename"] = found
                node.props.mark_queried("filename", was_queried)


def parse(source: Source, limits: SceneLimits | None = None, *, exact: bool = False) -> Parsed:
    """Parses and vets any source. exact: count the triangles of long files one by one.

    Raises SceneError with the place and the cause.
    """
    mi = mitsuba()
    limits = limits or SceneLimits()
    config = mi.parser.ParserConfig(mi.variant())
    opened = _open(source, config, limits)
    own, *elsewhere = mitsuba_folders = _mitsuba_folders(limits)
    with _file_resolver((own, *opened.folders, *elsewhere)) as resolver:
        refuse_libraries(opened.folders, mitsuba_folders)
        state = guarded(opened.read, opened.name, opened.folders)
        _name_integrators(state)
        # Scenes add folders by <path>, in front of all others: Mitsuba's own data stay before those too.
        searched = (str(resolver[i]) for i in range(len(resolver)))
        folders = (own, *(one for one in searched if one != own))
        refuse_libraries(folders, mitsuba_folders)

        def place(node: Any) -> str:
            return place_of(state, node, folders)

        check_nodes(state, Path(opened.folders[0]) if opened.folders else None, limits, place)
        check_media(state, place)
        guarded(lambda: mi.parser.transform_upgrade(config, state), opened.name, folders)
        guarded(lambda: mi.parser.transform_resolve(config, state), opened.name, folders)
        inside = limits.root or (Path(opened.folders[0]) if opened.folders else None)
        _correct_names(state, partial(resolved, folders), tuple(one for one in folders if one not in mitsuba_folders))
        assets = look(state, partial(resolved, folders), limits, place, exact=exact, folder=inside)
        shapes = placed_shapes(state, assets)
        return Parsed(
            state, opened.name, digest_of(state, assets), folders, assets, shapes, opened.keep, opened.defaults
        )


@dataclass(frozen=True, slots=True)
class _Opened:
    """A source that was found: a name to show, its folders, the call that parses it, and its parameters' defaults."""

    name: str
    folders: tuple[str, ...]
    read: Callable[[], Any]
    keep: Any = None
    defaults: Mapping[str, str] = field(default_factory=dict)


def _open(source: Source, config: Any, limits: SceneLimits) -> _Opened:
    parser = mitsuba().parser
    parameters: Mapping[str, str] = {}
    if isinstance(source, SceneFile):
        source, parameters = source.path, source.parameters
    if isinstance(source, dict):
        check_values(source, "scene")
        return _Opened("scene", (), lambda: parser.parse_dict(config, source))
    if not isinstance(source, (str, os.PathLike)):
        kind = type(source).__name__
        raise SceneError(
            f"the scene is of the type {kind}; give a file, a gallery name, or the dictionary or file that a Mitsuba "
            "scene was made from"
        )
    path = Path(source)
    if not path.suffix and not path.is_file():
        found = gallery.find(str(source))
        refuse_unknown(parameters, (), found.name)
        return _Opened(found.name, (), lambda: parser.parse_dict(config, found.build()))
    kind = path.suffix.lower()
    if kind not in (".xml", ".zip", ".json"):
        raise SceneError(f"{path}: a scene is an .xml file, a .zip bundle, a .json document or a gallery name")
    check_name(path, "the scene", SceneError)
    if not path.is_file():
        raise SceneError(f"{path}: no such file")
    if kind == ".zip":
        return _open_bundle(path, config, limits, parameters)
    folder = path.resolve().parent
    name = folder.name if path.stem == "scene" else path.stem
    if kind == ".json":
        refuse_unknown(parameters, (), path.name)
        document = read_document(path.read_bytes(), path.name, folder, limits)
        return _Opened(name, (str(folder),), lambda: parser.parse_dict(config, document))
    defaults = check_xml(path, limits, parameters)
    refuse_unknown(parameters, tuple(defaults), path.name)

    def read() -> Any:
        return parser.parse_file(config, str(path.resolve()), **parameters)

    return _Opened(name, (str(folder),), read, defaults=defaults)


def _open_bundle(path: Path, config: Any, limits: SceneLimits, parameters: Mapping[str, str]) -> _Opened:
    """The scene in a zip, unpacked for as long as it is used."""
    unpacked = tempfile.TemporaryDirectory(prefix="fredholm-scene-")
    folder = Path(unpacked.name)
    try:
        with path.open("rb") as file:
            bundle = unpack(file, path.name, folder, LOCAL_LIMITS)
    except BundleError as error:
        raise SceneError(f"{path.name}: {error}") from None
    inner = _open(SceneFile(folder / bundle.scene, parameters), config, limits)
    return _Opened(bundle.name, inner.folders, inner.read, unpacked, inner.defaults)


def instantiate(parsed: Parsed) -> Any:
    """The Mitsuba scene of a parsed one: merges equal materials and, without lights at infinity, meshes.

    A merged mesh has no bounds in Mitsuba 3.9.1, and light from infinity comes from just outside of the scene's: what
    lay beyond hid nothing, and a wall of merged meshes let the sky through.
    """
    mi = mitsuba()
    state = mi.parser.ParserState(parsed.state)  # the passes change it; the parsed form is kept as it was read
    take_meters_off(state)
    _take_grids(state)
    emitters = {node.props.plugin_name() for node in state.nodes if node.type == mi.ObjectType.Emitter}
    scene = _instantiate(parsed, state, merges_meshes=not emitters & having("far"))
    if not isinstance(scene, mi.Scene):
        raise SceneError(f"{parsed.name}: the outermost element is no scene but {type(scene).__name__}")
    return scene


def _take_grids(state: Any) -> None:
    """Makes grids that were handed over in memory this variant's own: Mitsuba takes no other's."""
    mi = mitsuba()
    for node in state.nodes:
        for key in ("grid", "data") if node.props.plugin_name() == "gridvolume" else ():
            if (value := value_of(node, key)) is not None:
                del node.props[key]
                node.props["grid"] = mi.VolumeGrid(np.ascontiguousarray(value, np.float32))


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
    with _file_resolver(parsed.folders), reading_files():
        guarded(lambda: mi.parser.transform_all(config, state), parsed.name, parsed.folders)
        made = guarded(lambda: mi.parser.instantiate(config, state), parsed.name, parsed.folders)
    return made[0] if isinstance(made, (list, tuple)) else made


def guarded(call: Callable[[], Any], what: str, folders: tuple[str, ...]) -> Any:
    """The result of a call into Mitsuba, its errors as SceneError with file and line, and what to do."""
    try:
        return call()
    except (RuntimeError, ValueError, KeyError, TypeError, IndexError, OverflowError, MemoryError) as cause:
        told = plain(_said(cause), folders)
        raise SceneError(told if has_place(told) else f"{what}: {told}") from cause


def _said(cause: Exception) -> str:
    """What an exception says, also where Mitsuba quotes a file that is no text."""
    if isinstance(cause, UnicodeDecodeError):
        return re.sub(r"[\x00-\x1f\x7f\ufffd]+", "?", cause.object.decode("utf-8", "replace").replace("\n", " "))
    return str(cause)
