"""Which files an uploaded scene names: all of them must lie in its own folder.

Looked at twice: in the XML before Mitsuba parses it, because includes are read while parsing, and in the
parsed nodes, because only there `$parameters` have their values.
"""

from __future__ import annotations

import re
from pathlib import Path
from xml.parsers import expat

_MAX_XML_BYTES = 64 << 20


def refuse_outside_references(scene: Path, folder: Path) -> None:
    """Raises renderer.errors.SceneError if the scene names a file outside `folder`."""
    folder = folder.resolve()
    for path in folder.rglob("*"):
        if path.suffix.lower() == ".xml":
            _check_xml(path, folder, scene.parent.resolve())
    _check_nodes(scene, folder)


def _check_xml(path: Path, folder: Path, base: Path) -> None:
    from renderer.errors import SceneError

    shown = path.relative_to(folder)
    if path.stat().st_size > _MAX_XML_BYTES:
        raise SceneError(f"{shown} is larger than {_MAX_XML_BYTES >> 20} MiB; keep meshes in files of their own")
    parser = expat.ParserCreate()

    def here() -> str:
        return f"{shown}:{parser.CurrentLineNumber}"

    def on_element(tag: str, attributes: dict[str, str]) -> None:
        named = attributes.get("filename")
        if named is not None and "$" in named:
            raise SceneError(f"{here()}: the file name {named!r} has a parameter in it; write the name itself")
        if named is None and (tag == "path" or attributes.get("name", "").lower() == "filename"):
            named = attributes.get("value")
        if named and "$" not in named and _is_outside(named, folder, base):
            raise SceneError(f"{here()}: {named!r} is outside the upload; put the file beside the scene")

    def on_doctype(*_: object) -> None:
        raise SceneError(f"{here()}: document types and entities are not accepted; remove the DOCTYPE")

    parser.StartElementHandler = on_element
    parser.StartDoctypeDeclHandler = on_doctype
    try:
        with path.open("rb") as file:
            parser.ParseFile(file)
    except expat.ExpatError as error:
        raise SceneError(f"{shown}:{error.lineno}: not well-formed XML ({expat.ErrorString(error.code)})") from None


def _check_nodes(scene: Path, folder: Path) -> None:
    from renderer.errors import SceneError
    from renderer.scene.source import parse

    for node in parse(scene).state.nodes:
        for key in node.props.keys():  # noqa: SIM118 (Mitsuba's Properties is no mapping)
            value = node.props[key]
            if isinstance(value, str) and key.lower().endswith("filename") and _is_outside(value, folder, scene.parent):
                raise SceneError(f"{scene.name}: {value!r} is outside the upload; put the file beside the scene")


def _is_outside(name: str, folder: Path, base: Path) -> bool:
    """Whether a file name leads out of the folder. One that Mitsuba made absolute may still be inside."""
    if re.match(r"^([A-Za-z]:|\\\\|~)", name) or "\0" in name:
        return True
    return not (base / name.replace("\\", "/")).resolve().is_relative_to(folder)
