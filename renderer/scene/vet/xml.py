"""Looks at a scene's XML before Mitsuba's parser does: size, nesting, entities, includes, and files outside.

Mitsuba reads included files and spectra while parsing and recurses over elements, so what is refused here must be
refused before. Parameters (`$name`) have no value yet: the parsed nodes are looked at again by `nodes.py`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from xml.parsers import expat

from renderer.errors import SceneError
from renderer.scene.files.tables import check_spectrum
from renderer.scene.limits import SceneLimits
from renderer.scene.vet.budget import Budget
from renderer.scene.vet.plugins import check_plugin
from renderer.scene.vet.references import check_reference, meant

_CONTAINERS = frozenset(
    "scene shape bsdf emitter texture medium phase volume sensor film rfilter sampler integrator spectrum".split()
)
_MOST_FOLDERS = 50  # each name is looked for in each
_SHORT = 500  # characters; shorter than any limit
# That Mitsuba's parser and expat read alike; whatever calls itself otherwise may be plain ASCII.
_ENCODINGS = frozenset("utf-8 utf8 us-ascii ascii utf-16 iso-8859-1 latin1".split())
_NEVER_LOADED = frozenset({"integrator", "sampler", "scene"})  # replaced by ours
NO_PARAMETERS: Mapping[str, str] = MappingProxyType({})


@dataclass
class _Totals:
    """What the files of one scene add up to."""

    limits: SceneLimits
    files: int = 0  # one that is included twice counts twice
    xml_bytes: int = 0
    elements: int = 0
    folders: list[Path] = field(default_factory=list)  # that scenes add by <path>
    defaults: dict[str, str] = field(default_factory=dict)  # of parameters, by name

    def __post_init__(self) -> None:
        self.budget = Budget(self.limits)


def check_xml(scene: Path, limits: SceneLimits, parameters: Mapping[str, str] = NO_PARAMETERS) -> dict[str, str]:
    """Refuses XML that must not reach the parser. Raises SceneError with file, line, what and why.

    parameters: values that stand in for defaults. Returns the scene's own, by name.

    Only files that are included are looked at: an include that is not found, or whose name is a parameter, is refused
    in a confined scene, so that Mitsuba reads none that was not.
    """
    totals = _Totals(limits)
    for name, value in parameters.items():
        totals.budget.define(name, value, scene.name)
    _check_file(scene, scene.parent.resolve(), limits, totals, ())
    return totals.defaults


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
        self.encoding = "utf-8"
        self.parser = expat.ParserCreate()
        self.parser.XmlDeclHandler = self.on_declaration
        self.parser.StartElementHandler = self.on_start
        self.parser.EndElementHandler = self.on_end
        self.parser.StartDoctypeDeclHandler = self.on_doctype

    def run(self) -> None:
        try:
            data = self.path.read_bytes()
            self.parser.Parse(data, True)
        except expat.ExpatError as error:
            why = expat.ErrorString(error.code)
            raise SceneError(f"{self.shown}:{error.lineno}: not well-formed XML ({why}); mend that line") from None
        except (ValueError, LookupError) as error:
            raise SceneError(f"{self.shown}: the text encoding cannot be read ({error}); save it as UTF-8") from None
        if self.encoding.lower() not in _ENCODINGS and not data.isascii():
            raise SceneError(f"{self.shown}: Mitsuba cannot read the text encoding {self.encoding}; save it as UTF-8")

    def on_declaration(self, _version: str, encoding: str | None, _is_alone: int) -> None:
        self.encoding = encoding or "utf-8"

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
        if tag == "default" and "name" in attributes:
            self.totals.budget.define(attributes["name"], attributes.get("value", ""), self.here())
            self.totals.defaults.setdefault(attributes["name"], attributes.get("value", ""))
        self.check_cost(tag, attributes)
        plugin = attributes.get("type")
        if plugin is not None and tag in _CONTAINERS - _NEVER_LOADED and "$" not in plugin:
            check_plugin(plugin, self.here())
        self.check_files(tag, attributes)

    def check_cost(self, tag: str, attributes: dict[str, str]) -> None:
        budget = self.totals.budget
        for key, value in attributes.items():
            # A place is slow to find: most texts are short.
            if len(value) > _SHORT or "$" in value:
                budget.text(key, value, self.here())
        if tag in _CONTAINERS:
            budget.count(self.shown, is_shape=tag == "shape")

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
            bases = [self.path.parent, self.folder, *self.totals.folders]
            check_reference(named, self.limits.root or self.folder, bases, self.here())
        found = self.found(named, tag)
        if tag == "path":
            self.totals.folders += [folder for folder in found if folder not in self.totals.folders]
            if self.limits.is_confined and len(self.totals.folders) > _MOST_FOLDERS:
                raise SceneError(f"{self.here()}: files are looked for in more than {_MOST_FOLDERS} folders; use fewer")
        elif tag == "include":
            for inner in found:  # Mitsuba takes one of them
                _check_file(inner, self.folder, self.limits, self.totals, self.above)
        elif tag == "spectrum":
            for path in found:
                if path.is_file():
                    self.check_spectrum(path)
        if not found and is_read_at_once and self.limits.is_confined:
            # Mitsuba would go on to look in the folder that the process runs in.
            near = meant(named, [self.folder, *self.totals.folders])
            hint = "put that file beside the scene" if near is None else f"did you mean {near[:200]!r}?"
            raise SceneError(f"{self.here()}: {named[:200]!r} is missing; {hint}")

    def check_spectrum(self, path: Path) -> None:
        try:
            check_spectrum(path)
        except SceneError as error:
            raise SceneError(f"{self.here()}: {error}") from None

    def found(self, named: str, tag: str) -> list[Path]:
        """The files or folders of the scene that Mitsuba may take for a name."""
        # Only a <path> is looked for beside the file that it stands in.
        bases = [self.folder, *([self.path.parent] if tag == "path" else []), *self.totals.folders]
        return [path for path in {(base / named).resolve() for base in bases} if path.exists()]
