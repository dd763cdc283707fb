"""Where a scene comes from, and its parsed intermediate form.

Enters: a path to an XML file, a Mitsuba dictionary or a gallery name. Leaves: Mitsuba's parser state, upgraded and with
references resolved, plus a digest of everything that the scene is made of (its identity).
"""

from __future__ import annotations

import hashlib
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from renderer.backend import mitsuba
from renderer.errors import SceneError
from renderer.scene import gallery

if TYPE_CHECKING:
    from collections.abc import Iterator

_FILE_PROPERTIES = ("filename",)


@dataclass(frozen=True, slots=True)
class Parsed:
    """A parsed scene: Mitsuba's parser state, a name to show, a digest, and the folders that its files are in.

    variant: of Mitsuba, that it was parsed for.
    """

    state: Any
    name: str
    digest: str
    folders: tuple[str, ...]
    variant: str


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


def parse(source: str | Path | dict[str, Any]) -> Parsed:
    """Parses any source. Raises SceneError with the place and the cause."""
    mi = mitsuba()
    config = mi.parser.ParserConfig(mi.variant())
    name, folders, read = _reader(source, config)
    with _file_resolver(folders) as resolver:
        state = _guarded(read, name)
        folders = tuple(str(resolver[i]) for i in range(len(resolver)))  # scenes add folders by <path>
        _guarded(lambda: mi.parser.transform_upgrade(config, state), name)
        _guarded(lambda: mi.parser.transform_resolve(config, state), name)
        return Parsed(state, name, _digest(state, resolver), folders, mi.variant())


def _reader(source: str | Path | dict[str, Any], config: Any) -> tuple[str, tuple[str, ...], Any]:
    """Name, folders and the call that parses a source."""
    parser = mitsuba().parser
    if isinstance(source, dict):
        return "scene", (), lambda: parser.parse_dict(config, source)
    path = Path(source)
    if not path.suffix and not path.is_file():
        found = gallery.find(str(source))
        return found.name, (), lambda: parser.parse_dict(config, found.build())
    if path.suffix.lower() != ".xml":
        raise SceneError(f"{path}: a scene is an .xml file, a Mitsuba dictionary or a gallery name")
    if not path.is_file():
        raise SceneError(f"{path}: no such file")
    folder = path.resolve().parent
    name = folder.name if path.stem == "scene" else path.stem
    return name, (str(folder),), lambda: parser.parse_file(config, str(path))


def instantiate(parsed: Parsed) -> Any:
    """The Mitsuba scene of a parsed one (merges meshes and equal materials, as Mitsuba does)."""
    mi = mitsuba()
    state = mi.parser.ParserState(parsed.state)  # the passes change it; the parsed form is kept as it was read
    scene = _instantiate(parsed, state)
    if not isinstance(scene, mi.Scene):
        raise SceneError(f"{parsed.name}: the outermost element is no scene but {type(scene).__name__}")
    return scene


def load_part(parsed: Parsed, description: dict[str, Any]) -> Any:
    """A Mitsuba object that belongs to a parsed scene, from its dictionary."""
    mi = mitsuba()
    with _file_resolver(parsed.folders):
        state = _guarded(lambda: mi.parser.parse_dict(mi.parser.ParserConfig(mi.variant()), description), parsed.name)
    return _instantiate(parsed, state)


def _instantiate(parsed: Parsed, state: Any) -> Any:
    mi = mitsuba()
    config = mi.parser.ParserConfig(mi.variant())
    with _file_resolver(parsed.folders):
        _guarded(lambda: mi.parser.transform_all(config, state), parsed.name)
        made = _guarded(lambda: mi.parser.instantiate(config, state), parsed.name)
    return made[0] if isinstance(made, (list, tuple)) else made


def _guarded(call: Any, what: str) -> Any:
    try:
        return call()
    except (RuntimeError, ValueError, KeyError, TypeError) as cause:
        raise SceneError(f"{what}: {_plain(str(cause))}") from cause


def _plain(message: str) -> str:
    """A parser's message without Mitsuba's source positions."""
    lines = [line.strip() for line in message.splitlines() if line.strip()]
    kept = [line.split("] ", 1)[-1] if line.startswith("[") else line for line in lines]
    return " ".join(kept)[:600]


def _digest(state: Any, resolver: Any) -> str:
    """SHA-256 over all nodes, in order, and the contents of every file they name."""
    h = hashlib.sha256()
    mi = mitsuba()
    for node in state.nodes:
        if node.type in (mi.ObjectType.Integrator, mi.ObjectType.Sampler):
            continue
        h.update(f"\n{node.type}:{node.props.plugin_name()}".encode())
        for key in node.props.keys():  # noqa: SIM118 (Mitsuba's Properties is no mapping)
            if node.type == mi.ObjectType.Film and key in (
                "width",
                "height",
                "file_format",
                "component_format",
            ):
                continue
            was_queried = node.props.was_queried(key)
            value = node.props[key]
            node.props.mark_queried(key, was_queried)  # reading must not hide a misspelt name from Mitsuba
            h.update(f"\n {key}={_fingerprint(value)}".encode())
            if key in _FILE_PROPERTIES and (file := Path(str(resolver.resolve(str(value))))).is_file():
                with open(file, "rb") as contents:
                    h.update(hashlib.file_digest(contents, "sha256").digest())
    return h.hexdigest()


def _fingerprint(value: Any) -> str:
    """Text that changes when a property's value does."""
    if isinstance(value, (bool, int, float, str)):
        return repr(value)
    mi = mitsuba()
    if "Transform" in type(value).__name__:
        value = np.array(value.matrix)  # its text has six digits only
    if isinstance(value, mi.Object) and not isinstance(value, mi.Bitmap):
        parameters = mi.traverse(value)
        parts = [f"{k}:{_fingerprint(parameters[k])}" for k in sorted(parameters.keys())]
        return f"{type(value).__name__}({','.join(parts)})"
    try:
        array = np.asarray(value)
    except (TypeError, ValueError, RuntimeError):
        array = None
    if array is not None and array.dtype != object and array.size:
        return f"{array.dtype}{array.shape}{hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest()}"
    return str(value)
