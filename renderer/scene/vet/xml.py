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

    xml_bytes: int = 0
    elements: int = 0
    seen: set[Path] = field(default_factory=set)


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
    if resolved in totals.seen:
        return
    totals.seen.add(resolved)
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
        if named is not None and "$" in named and self.limits.is_confined:
            raise SceneError(f"{self.here()}: the file name {named!r} has a parameter in it; write the name itself")
        if named is None and (tag == "path" or re.search("filename$", attributes.get("name", ""), re.IGNORECASE)):
            named = attributes.get("value")
        if not named or "$" in named:
            return
        if self.limits.is_confined:
            check_reference(named, self.folder, self.path.parent, self.here())
        if tag == "include":
            self.follow(named)

    def follow(self, named: str) -> None:
        for base in (self.folder, self.path.parent):
            if (inner := base / named).is_file():
                _check_file(inner, self.folder, self.limits, self.totals, self.above)
                return
