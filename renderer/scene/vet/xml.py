"""Looks at a scene's XML before Mitsuba's parser does: size, nesting, entities, includes, and files outside.

Mitsuba reads included files and spectra while parsing and recurses over elements, so what is refused here must be
refused before. Parameters (`$name`) have no value yet: the parsed nodes are looked at again by `nodes.py`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from renderer.errors import SceneError
from renderer.scene.limits import SceneLimits
from renderer.scene.vet.plugins import check_plugin
from renderer.scene.vet.references import check_reference

_CONTAINERS = frozenset(
    "scene shape bsdf emitter texture medium phase volume sensor film rfilter sampler integrator spectrum".split()
)
_NEVER_LOADED = frozenset({"integrator", "sampler", "scene"})  # replaced by ours


@dataclass
class _Totals:
    """What the files of one scene add up to."""

    files: int = 0  # one that is included twice counts twice
    xml_bytes: int = 0
    elements: int = 0
    seen: set[Path] = field(default_factory=set)
    folders: list[Path] = field(default_factory=list)  # that scenes add by <path>


def check_xml(scene: Path, limits: SceneLimits) -> None:
    """Refuses XML that must not reach the parser. Raises SceneError with file, line, what and why.

    A confined scene has all XML files of its folder looked at, because any of them could be included.
    """
    folder = scene.parent.resolve()
    totals = _Totals()
    _check_file(scene, folder, limits, totals, ())
    if limits.is_confined:
        for path in sorted(folder.rglob("*")):
            if path.suffix.lower() == ".xml" and path.resolve() not in totals.seen:
                _check_file(path, folder, limits, totals, ())


def _check_file(path: Path, folder: Path, limits: SceneLimits, totals: _Totals, above: tuple[Path, ...]) -> None:
    shown = path.name if not path.resolve().is_relative_to(folder) else str(path.resolve().relative_to(folder))
    resolved = path.resolve()
    if resolved in above:
        raise SceneError(f"{shown}: the file includes itself; remove that include")
    if len(above) > limits.include_depth:
        raise SceneError(f"{shown}: files include each other more than {limits.include_depth} deep; put them together")
    totals.files += 1
    if totals.files > limits.include_count:
        raise SceneError(f"{shown}: more than {limits.include_count} files are included; put some of them together")
    totals.seen.add(resolved)  # and read again each time that it is included, as Mitsuba does
    if not path.is_file():
        raise SceneError(f"{shown}: no such file")
    totals.xml_bytes += path.stat().st_size
    if totals.xml_bytes > limits.xml_bytes:
        raise SceneError(
            f"{shown}: the XML files are larger than {limits.xml_bytes >> 20} MiB; keep meshes in files of their own"
        )
    _Walk(path, shown, folder, limits, totals, (*above, resolved)).run()


class _Walk:
    """One pass over one file."""

    def __init__(
        self, path: Path, shown: str, folder: Path, limits: SceneLimits, totals: _Totals, above: tuple[Path, ...]
    ) -> None:
        self.path, self.shown, self.folder = path, shown, folder
        self.limits, self.totals, self.above = limits, totals, above
        self.depth = 0
        self.parser = expat.ParserCreate()
        self.parser.StartElementHandler = self.on_start
        self.parser.EndElementHandler = self.on_end
        self.parser.StartDoctypeDeclHandler = self.on_doctype

    def run(self) -> None:
        try:
            with self.path.open("rb") as file:
                self.parser.ParseFile(file)
        except expat.ExpatError as error:
            why = expat.ErrorString(error.code)
            raise SceneError(f"{self.shown}:{error.lineno}: not well-formed XML ({why}); mend that line") from None
        except (ValueError, LookupError) as error:
            raise SceneError(f"{self.shown}: the text encoding cannot be read ({error}); save it as UTF-8") from None

    def here(self) -> str:
        return f"{self.shown}:{self.parser.CurrentLineNumber}"

    def on_doctype(self, *_: object) -> None:
        raise SceneError(f"{self.here()}: document types and entities are not accepted; remove the DOCTYPE")

    def on_end(self, _: str) -> None:
        self.depth -= 1

    def on_start(self, tag: str, attributes: dict[str, str]) -> None:
        self.depth += 1
        self.totals.elements += 1
        if self.depth > self.limits.xml_depth:
            raise SceneError(f"{self.here()}: elements are nested more than {self.limits.xml_depth} deep; flatten them")
        if self.totals.elements > self.limits.xml_elements:
            raise SceneError(
                f"{self.here()}: the scene has more than {self.limits.xml_elements} elements; use meshes and instances"
            )
        plugin = attributes.get("type")
        if plugin is not None and tag in _CONTAINERS - _NEVER_LOADED and "$" not in plugin:
            check_plugin(plugin, self.here())
        self.check_files(tag, attributes)

    def check_files(self, tag: str, attributes: dict[str, str]) -> None:
        named = attributes.get("filename")
        is_read_at_once = named is not None or tag == "path"  # before the parsed nodes can be looked at
        if named is None and (tag == "path" or re.search("filename$", attributes.get("name", ""), re.IGNORECASE)):
            named = attributes.get("value")
        if not named:
            return
        if "$" in named:
            if is_read_at_once and self.limits.is_confined:
                raise SceneError(f"{self.here()}: the file name {named!r} has a parameter in it; write the name itself")
            return
        if self.limits.is_confined:
            check_reference(named, self.folder, self.path.parent, self.here())
        found = self.found(named, tag)
        if tag == "path":
            self.totals.folders += found
        elif tag == "include":
            for inner in found:  # Mitsuba takes one of them
                _check_file(inner, self.folder, self.limits, self.totals, self.above)
        if not found and is_read_at_once and self.limits.is_confined:
            # Mitsuba would go on to look in the folder that the process runs in.
            raise SceneError(f"{self.here()}: {named[:200]!r} is missing; put that file beside the scene")

    def found(self, named: str, tag: str) -> list[Path]:
        """The files or folders of the scene that Mitsuba may take for a name."""
        # Only a <path> is looked for beside the file that it stands in.
        bases = [self.folder, *([self.path.parent] if tag == "path" else []), *self.totals.folders]
        return [path for path in {(base / named).resolve() for base in bases} if path.exists()]
